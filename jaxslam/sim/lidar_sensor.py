"""A planar lidar, and presets of common models."""

import math

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.sim.exact_ranges import cast_rays
from jaxslam.sim.numeric import Scalar, standard_normal
from jaxslam.sim.range_bias import RangeBias
from jaxslam.sim.worlds.world import World


class Lidar(eqx.Module):
    """Beam geometry, limits and noise of a lidar.

    A reading goes through these stages: true distance → short reading (an unmapped obstacle) →
    bias → noise → drop-out → limits. Noise is Gaussian with variance
    `sigma_constant² + (sigma_proportional · max(distance − proportional_from, 0))²`.
    Scans are instantaneous: all beams start from the pose at the stamp, without motion distortion.

    Attributes:
        num_beams: number of beams `B` (static).
        angle_min: angle of beam 0 in the lidar frame, radians.
        angle_increment: angle from one beam to the next, radians (negative: clockwise).
        range_min: shorter readings are no return, meters.
        range_max: readings at or over this are no return, meters.
        sigma_constant: constant part of the standard deviation, meters.
        sigma_proportional: proportional part of the standard deviation, as a fraction of the distance.
        proportional_from: distance at which the proportional part begins, meters.
        dropout_probability: probability that a beam has no return although it hits something.
        short_probability: probability that a beam ends on an object missing from the world (a person),
            at a distance uniform between 0 and the true one; 0 disables it.
        pose_base_lidar: mounting on the robot's base: m, m, rad.
        bias: mean reading minus distance; None for no bias.
        rate: scans per second (static).
    """

    num_beams: int = eqx.field(static=True)
    angle_min: Scalar
    angle_increment: Scalar
    range_min: Scalar
    range_max: Scalar
    sigma_constant: Scalar
    sigma_proportional: Scalar = 0.0
    proportional_from: Scalar = 0.0
    dropout_probability: Scalar = 0.0
    short_probability: Scalar = 0.0
    pose_base_lidar: tuple[Scalar, Scalar, Scalar] = (0.0, 0.0, 0.0)
    bias: RangeBias | None = None
    rate: float = eqx.field(default=10.0, static=True)

    def __check_init__(self) -> None:
        if self.num_beams < 1:
            raise ValueError(f"num_beams is {self.num_beams}: a lidar needs at least one beam")
        if not self.rate > 0:
            raise ValueError(f"rate is {self.rate}: give the lidar a positive number of scans per second")

    def angles(self) -> Float[Array, "B"]:
        """Return the beam angles `[B]` in the lidar frame, radians."""
        return self.angle_min + self.angle_increment * jnp.arange(self.num_beams, dtype=jnp.float32)

    def simulate(self, key: PRNGKeyArray, world: World, poses: Float[Array, "T 3"]) -> LidarScan:
        """Simulate scans `[T, B]` of a world from true base poses `[T, 3]` (m, m, rad, world frame)."""
        count = poses.shape[0]
        mounting = jnp.broadcast_to(jnp.array(self.pose_base_lidar, jnp.float32), (count, 3))
        distances = cast_rays(world, se2.compose(poses, mounting), self.angles())
        ranges, valid = self.measure(key, distances)
        return LidarScan(
            ranges=ranges,
            valid=valid,
            angle_min=jnp.full((count,), self.angle_min, jnp.float32),
            angle_increment=jnp.full((count,), self.angle_increment, jnp.float32),
            pose_base_lidar=mounting,
        )

    def measure(
        self, key: PRNGKeyArray, distances: Float[Array, "T B"]
    ) -> tuple[Float[Array, "T B"], Bool[Array, "T B"]]:
        """Turn true distances `[T, B]` (meters, infinite if nothing is hit) into readings.

        Readings are ranges `[T, B]` in meters, 0 where invalid, and a mask of valid ranges.
        """
        normal = standard_normal(key, (4, *distances.shape))
        noise = normal[0]
        chance_short, where_short, chance_dropout = ndtr(normal[1:])
        reach = jnp.minimum(distances, self.range_max)
        seen = jnp.where(chance_short < self.short_probability, reach * where_short, distances)
        # Keep infinite distances (nothing is hit) out of the arithmetic.
        finite = jnp.where(jnp.isfinite(seen), seen, 0.0)
        growing = jnp.maximum(finite - self.proportional_from, 0.0)
        sigma = jnp.hypot(jnp.asarray(self.sigma_constant), self.sigma_proportional * growing)
        biased = finite if self.bias is None else finite + self.bias(finite)
        measured = biased + sigma * noise
        valid = (
            jnp.isfinite(seen)
            & (chance_dropout >= self.dropout_probability)
            & (measured >= self.range_min)
            & (measured < self.range_max)
        )
        return jnp.where(valid, measured, 0.0), valid


# Data sheets give an interval ("±"): its half width is taken as three standard deviations, a plain
# "~1 %" as one. Drop-outs stay at 0, because no data sheet gives them.


def sick(*, num_beams: int = 181) -> Lidar:
    """Return a SICK LMS-200: 180°, 0–80 m, precision 5 mm (1 σ), 10 scans per second.

    `num_beams` is 180 (step 180°/180, as in CARMEN logs), or 181 or 361 (with both end points).
    """
    intervals = num_beams if num_beams % 2 == 0 else num_beams - 1
    return Lidar(
        num_beams=num_beams,
        angle_min=-math.pi / 2,
        angle_increment=math.pi / intervals,
        range_min=0.05,
        range_max=80.0,
        sigma_constant=0.005,
    )


def urg_04lx() -> Lidar:
    """Return a Hokuyo URG-04LX: 682 beams over 240°, 0.02–5.6 m, ±10 mm to 1 m, ±1 % beyond, 10 Hz."""
    increment = 2 * math.pi / 1024
    return Lidar(
        num_beams=682,
        angle_min=-681 / 2 * increment,
        angle_increment=increment,
        range_min=0.02,
        range_max=5.6,
        sigma_constant=0.01 / 3,
        sigma_proportional=0.01 / 3,
    )


def rplidar_a1() -> Lidar:
    """Return a Slamtec RPLIDAR A1: 360 beams over 360°, 0.15–6 m, ~1 %, 5.5 Hz."""
    return Lidar(
        num_beams=360,
        angle_min=0.0,
        angle_increment=2 * math.pi / 360,
        range_min=0.15,
        range_max=6.0,
        sigma_constant=0.0,
        sigma_proportional=0.01,
        rate=5.5,
    )


def lds_01(bias: RangeBias | None = None) -> Lidar:
    """Return an LDS-01 on a TurtleBot3: 360 beams, 0.12–3.5 m, ±10 mm to 0.5 m, then up to ±3.5 %, 5 Hz.

    These numbers are the precision. The accuracy of one device (±15 mm, ±5 %) is given by `bias`, see
    `draw_lds_01_bias`; None for no bias.
    """
    return Lidar(
        num_beams=360,
        angle_min=0.0,
        angle_increment=2 * math.pi / 360,
        range_min=0.12,
        range_max=3.5,
        sigma_constant=0.01 / 3,
        sigma_proportional=0.035 / 3,
        proportional_from=0.5,
        pose_base_lidar=(-0.032, 0.0, 0.0),
        bias=bias,
        rate=5.0,
    )


def lds_02() -> Lidar:
    """Return an LDS-02 on a TurtleBot3: 260 beams over 360°, 0.16–8 m, ±10 mm and ±3 %, 9 Hz."""
    return Lidar(
        num_beams=260,
        angle_min=0.0,
        angle_increment=2 * math.pi / 260,
        range_min=0.16,
        range_max=8.0,
        sigma_constant=0.01 / 3,
        sigma_proportional=0.03 / 3,
        pose_base_lidar=(-0.032, 0.0, 0.0),
        rate=9.0,
    )


def vlp16_ring(*, num_beams: int = 900) -> Lidar:
    """Return one horizontal ring of a Velodyne VLP-16: 360°, 0.5–100 m, ±30 mm, 10 Hz.

    The device has 1800 beams at this rate; the default `num_beams` keeps every second one.
    """
    return Lidar(
        num_beams=num_beams,
        angle_min=-math.pi,
        angle_increment=2 * math.pi / num_beams,
        range_min=0.5,
        range_max=100.0,
        sigma_constant=0.03 / 3,
    )
