"""KLD sampling: a number of particles that follows the spread of the belief."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.known_map import KnownMap


class Bins(eqx.Module):
    """A grid over poses, for counting particles per bin.

    Attributes:
        translation: side of a bin, meters.
        num_headings: bins around the circle (static).
        rows: bins along y (static).
        columns: bins along x (static).
    """

    translation: Float[Array, ""]
    num_headings: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)
    columns: int = eqx.field(static=True)

    @classmethod
    def over(cls, map: KnownMap, translation: float, rotation: float) -> "Bins":
        """Return bins with a side in meters and a width in radians, adjusted to divide the circle equally."""
        height, width = map.shape
        resolution = float(map.resolution)
        return cls(
            translation=jnp.asarray(translation, jnp.float32),
            num_headings=max(1, round(2 * np.pi / rotation)),
            rows=int(np.ceil(height * resolution / translation)),
            columns=int(np.ceil(width * resolution / translation)),
        )

    @property
    def count(self) -> int:
        """Return the number of bins."""
        return self.num_headings * self.rows * self.columns

    def index(self, map: KnownMap, poses: Float[Array, "N 3"]) -> Int[Array, "N"]:
        """Return the bin `[N]` of each pose `[N, 3]` (world frame), clamped to the map."""
        cells = map.to_cells(poses)
        scale = map.resolution / self.translation
        column = jnp.clip(jnp.floor(cells[:, 0] * scale), 0, self.columns - 1).astype(jnp.int32)
        row = jnp.clip(jnp.floor(cells[:, 1] * scale), 0, self.rows - 1).astype(jnp.int32)
        turn = cells[:, 2] / (2.0 * jnp.pi)
        heading = jnp.floor((turn - jnp.floor(turn)) * self.num_headings).astype(jnp.int32)
        heading = jnp.minimum(heading, self.num_headings - 1)
        return (heading * self.rows + row) * self.columns + column


class KLDSampling(eqx.Module):
    r"""Number of particles that keeps the belief within `error` of its true shape, with probability 1 − δ.

    The distance is the Kullback-Leibler divergence between the belief's histogram and that of the samples.
    The bound depends on the number $k$ of bins that have samples:

    $n = \frac{k-1}{2\epsilon}\left(1 - \frac{2}{9(k-1)} + \sqrt{\frac{2}{9(k-1)}}\,z_{1-\delta}\right)^3$

    Attributes:
        error: ε, bound on the divergence, nats, > 0.
        quantile: $z_{1-\delta}$, quantile of the standard normal distribution: 2.326 for δ = 0.01.
        min_particles: lower limit on the number of particles.

    References:
        Fox 2003, Adapting the sample size in particle filters through KLD-sampling, IJRR 22, (13) and
        table 4.

    Example:
        ε = 0.05, z = 2.326: 1 bin needs `min_particles`, 2 bins 66 particles, 10 need 217 and 100 need 1347.
    """

    error: Scalar = 0.05
    quantile: Scalar = 2.326
    min_particles: Scalar = 500.0

    def __check_init__(self):
        require_at_least_zero(self, positive=("error", "min_particles"))

    def bound(self, num_bins: Int[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Return the number of particles needed if `num_bins` bins have samples."""
        freedom = jnp.maximum(num_bins.astype(jnp.float32) - 1.0, 1.0)
        ratio = 2.0 / (9.0 * freedom)
        needed = freedom / (2.0 * self.error) * (1.0 - ratio + jnp.sqrt(ratio) * self.quantile) ** 3
        needed = jnp.where(num_bins > 1, jnp.ceil(needed), 1.0)
        return jnp.maximum(needed, self.min_particles)

    def num_needed(self, bins: Int[Array, "N"], num_bins: int) -> Int[Array, ""]:
        """Return the smallest n that meets the bound computed from the first n samples.

        `bins` `[N]` are the bins of the samples, which were drawn independently in this order; `num_bins` is
        the total number of bins (static). The result is N if all samples together do not suffice.
        """
        count = bins.shape[0]
        order = jnp.arange(count, dtype=jnp.int32)
        first = jnp.full(num_bins, count, jnp.int32).at[bins].min(order)
        is_new: Bool[Array, "N"] = first[bins] == order
        occupied = jnp.cumsum(is_new.astype(jnp.int32), dtype=jnp.int32)
        enough = (order + 1).astype(jnp.float32) >= self.bound(occupied)
        return jnp.where(jnp.any(enough), jnp.argmax(enough).astype(jnp.int32) + 1, jnp.int32(count))
