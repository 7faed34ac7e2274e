"""A Gaussian fitted to the poses around a mode."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.linalg import LOG_TWO_PI, cholesky, inverse_symmetric
from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.lidar.beams import ScanPoints, wall_jacobian


class PoseGaussian(eqx.Module):
    """A normal density over poses.

    Attributes:
        mean: `[3]` (m, m, rad, world frame).
        factor: `[3, 3]` lower Cholesky factor of the covariance.
        log_eta: log of the mean of the fitted values, η of Yang et al. 2019 (20) up to a constant.
    """

    mean: Float[Array, "3"]
    factor: Float[Array, "3 3"]
    log_eta: Float[Array, ""]

    def sample(self, key: PRNGKeyArray) -> Float[Array, "3"]:
        """Draw a pose `[3]`."""
        offset = self.factor @ jax.random.normal(key, (3,), jnp.float32)
        return jnp.append(self.mean[:2] + offset[:2], se2.wrap(self.mean[2] + offset[2]))

    def log_prob(self, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return the natural log of the density per m²·rad; the heading error is wrapped."""
        offset = pose - self.mean
        offset = offset.at[2].set(se2.wrap(offset[2]))
        (a, _, _), (b, c, _), (d, e, f) = self.factor
        # Forward substitution in closed form: a batched solve compiles to a library call.
        first = offset[0] / a
        second = (offset[1] - b * first) / c
        third = (offset[2] - d * first - e * second) / f
        squared = first * first + second * second + third * third
        return -0.5 * squared - jnp.log(a * c * f) - 1.5 * LOG_TWO_PI


class PosesAround(eqx.Module):
    r"""K poses around a mode and their moments, Yang et al. 2019 (19)–(21).

    The paper's $|x_j - x^*| < \Delta$ is applied to the end points: the drawn poses move the end points by up
    to `spread` across their walls, so that the poses spread far along a corridor and little across it.

    Attributes:
        spread: Δ, root mean square distance that the end points move across their walls, meters.
        reach_translation: largest translation of a pose where no wall limits it, meters.
        reach_rotation: largest rotation of a pose where no wall limits it, radians.
        least_translation: smallest standard deviation in position, meters.
        least_rotation: smallest standard deviation in heading, radians.
        num_poses: K (static).

    References:
        Yang et al. 2019; Grisetti et al. 2007, section III-B.
    """

    spread: Scalar = 0.03
    reach_translation: Scalar = 0.2
    reach_rotation: Scalar = 0.05
    least_translation: Scalar = 0.002
    least_rotation: Scalar = 0.0005
    num_poses: int = eqx.field(static=True, default=50)

    def __check_init__(self):
        require_at_least_zero(
            self,
            positive=("spread", "reach_translation", "reach_rotation", "least_translation", "least_rotation"),
        )

    def fit(
        self,
        key: PRNGKeyArray,
        log_value: Callable[[Float[Array, "3"]], Float[Array, ""]],
        mode: Float[Array, "3"],
        ends: ScanPoints,
    ) -> PoseGaussian:
        """Return the Gaussian with the mean and covariance of poses around a mode, weighted by their values.

        Args:
            key: PRNG key.
            log_value: log p of a pose `[3]`; it is vmapped. A NaN counts as −inf.
            mode: `[3]` (m, m, rad, world frame).
            ends: the scan, whose walls determine how far the poses spread in each direction.
        """
        # (19)
        drawn = jax.random.uniform(key, ((self.num_poses + 1) // 2, 3), jnp.float32, -1.0, 1.0)
        # In symmetric pairs, so that sampling error alone does not shift the mean off the mode.
        drawn = jnp.concatenate([drawn, -drawn])[: self.num_poses]
        poses = mode[None] + drawn @ self._shape(ends, mode).T
        values = jax.vmap(log_value)(poses)
        values = jnp.where(jnp.isnan(values), -jnp.inf, values)
        largest = jnp.maximum(jnp.max(values), jnp.finfo(jnp.float32).min)
        weights = jnp.exp(values - largest)
        total = jnp.sum(weights)
        # If all weights are zero, all poses count equally.
        weights = jnp.where(total > 0, weights, 1.0)
        weights = weights / jnp.sum(weights)
        # (20), (21); headings as differences from the mode's, so that they do not wrap.
        mean = jnp.sum(weights[:, None] * poses, axis=0)
        offsets = poses - mean[None]
        covariance = (offsets * weights[:, None]).T @ offsets
        least = jnp.asarray([self.least_translation, self.least_translation, self.least_rotation])
        return PoseGaussian(
            mean=jnp.append(mean[:2], se2.wrap(mean[2])),
            factor=cholesky(covariance + jnp.diag(least * least), least * least),
            log_eta=jnp.log(total / self.num_poses) + largest,
        )

    def _shape(self, ends: ScanPoints, mode: Float[Array, "3"]) -> Float[Array, "3 3"]:
        """Return a factor of the inverse information of the walls seen, with `spread` across them."""
        rows = wall_jacobian(ends, mode[2]) * ends.valid.astype(jnp.float32)[None]
        count = jnp.maximum(jnp.sum(ends.valid, dtype=jnp.float32), 1.0)
        reach = jnp.asarray([self.reach_translation, self.reach_translation, self.reach_rotation])
        information = rows @ rows.T / (count * self.spread**2) + jnp.diag(1.0 / (reach * reach))
        return cholesky(inverse_symmetric(information), jnp.full(3, 1e-12, jnp.float32))
