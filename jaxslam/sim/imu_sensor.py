"""An inertial measurement unit in the plane: yaw rate and heading."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.sim.numeric import Scalar, running_sum, standard_normal
from jaxslam.sim.robot import Drive


class Inertial(eqx.Module):
    """Samples of the IMU.

    Attributes:
        yaw_rates: `[M]` rad/s.
        headings: `[M]` radians in [−π, π), relative to the true heading at the start.
        rate_biases: `[M]` true bias of the yaw rate, rad/s (not visible to filters).
        heading_biases: `[M]` true bias of the heading, radians (not visible to filters).
    """

    yaw_rates: Float[Array, "*batch M"]
    headings: Float[Array, "*batch M"]
    rate_biases: Float[Array, "*batch M"]
    heading_biases: Float[Array, "*batch M"]


class Imu(eqx.Module):
    """Yaw rate and heading, each with white noise, a bias and a random walk of that bias.

    The heading is that of a unit which fuses its own sensors: it starts at 0, and its error is a slow random
    walk. The defaults are typical of a calibrated consumer (MEMS) unit.

    Attributes:
        rate_noise_density: white noise of the yaw rate, (rad/s)/√Hz; one sample has the standard
            deviation `rate_noise_density · √rate`.
        sigma_rate_bias: standard deviation of the yaw rate's bias at the start, rad/s.
        rate_bias_walk: growth of that bias, (rad/s)/√s.
        sigma_heading: white noise of one heading sample, rad.
        sigma_heading_bias: standard deviation of the heading's bias at the start, rad.
        heading_bias_walk: growth of that bias, rad/√s.
        rate: samples per second (static).
    """

    rate_noise_density: Scalar = 2e-4
    sigma_rate_bias: Scalar = 2e-3
    rate_bias_walk: Scalar = 5e-5
    sigma_heading: Scalar = 0.01
    sigma_heading_bias: Scalar = 0.0
    heading_bias_walk: Scalar = 1e-3
    rate: float = eqx.field(default=100.0, static=True)

    def __check_init__(self) -> None:
        if not self.rate > 0:
            raise ValueError(f"rate is {self.rate}: give the IMU a positive number of samples per second")

    def simulate(self, key: PRNGKeyArray, drive: Drive, times: Float64[np.ndarray, "M"]) -> Inertial:
        """Simulate samples of a drive at `times` `[M]` (seconds, host values, `rate` per second)."""
        poses, velocities = drive.at(times)
        noise = standard_normal(key, (len(times), 4))
        initial = jnp.array([self.sigma_rate_bias, self.sigma_heading_bias], jnp.float32)
        walk = jnp.array([self.rate_bias_walk, self.heading_bias_walk], jnp.float32)
        steps = noise[1:, :2] * (walk * self.rate**-0.5)[None]
        biases = running_sum(jnp.concatenate([noise[:1, :2] * initial[None], steps]))
        rate_noise = self.rate_noise_density * self.rate**0.5 * noise[:, 2]
        heading_noise = self.sigma_heading * noise[:, 3]
        headings = poses[:, 2] - drive.poses[0, 2]
        return Inertial(
            yaw_rates=velocities[:, 2] + biases[:, 0] + rate_noise,
            headings=se2.wrap(headings + biases[:, 1] + heading_noise),
            rate_biases=biases[:, 0],
            heading_biases=biases[:, 1],
        )
