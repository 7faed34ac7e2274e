"""Correlative scan matching: exhaustive search, coarse then fine, for a particle that has lost the map."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.validation import require_at_least_zero, require_odd
from jaxslam.grid.field import DistanceField, Field
from jaxslam.lidar.beams import ScanPoints, spread_beams
from jaxslam.matching.gauss_newton import PosePrior


class CorrelativeSearch(eqx.Module):
    """Best-scoring pose on a lattice around a start, on the coarse field and then on the fine one.

    The score of a pose is `beam_score` times the sum over beams of exp(−d²/2σ²), plus the log of the prior.

    Attributes:
        reach: half the side of the searched square, meters.
        reach_rotation: half the searched angle, radians.
        sigma_cells: σ, in cells of the searched level.
        beam_score: score of one beam on an obstacle relative to the prior, nats.
        unseen_score: score of a beam in unseen space, as a share of `beam_score`.
        num_translations: lattice points along x and y on the coarse level (static, odd).
        num_rotations: headings on the coarse level (static, odd).
        num_beams: beams scored on the coarse level (static).

    References:
        Olson 2009, Real-time correlative scan matching (two resolutions).
    """

    reach: float | Float[Array, ""] = 1.2
    reach_rotation: float | Float[Array, ""] = 0.6
    sigma_cells: float | Float[Array, ""] = 1.5
    beam_score: float | Float[Array, ""] = 0.2
    unseen_score: float | Float[Array, ""] = 0.6
    num_translations: int = eqx.field(static=True, default=9)
    num_rotations: int = eqx.field(static=True, default=13)
    num_beams: int = eqx.field(static=True, default=45)

    def __check_init__(self):
        require_at_least_zero(self, positive=("reach", "reach_rotation", "sigma_cells"))
        require_odd(self, "num_translations", "num_rotations")

    def search(
        self, field: Field, ends: ScanPoints, start: Float[Array, "3"], prior: PosePrior
    ) -> Float[Array, "3"]:
        """Return the best pose `[3]` of the lattice; the start itself is a lattice point."""
        total = ends.valid.shape[0]
        spread = spread_beams(total, self.num_beams)
        few = jax.tree.map(lambda leaf: leaf[spread], ends)
        share = total / len(spread)
        step = 2 * self.reach / (self.num_translations - 1)
        step_rotation = 2 * self.reach_rotation / (self.num_rotations - 1)
        coarse = _lattice(self.num_translations, self.num_rotations, step, step_rotation)
        found = self._best(field.coarse, few, start, prior, coarse, share)
        # Seven points per side over ±½ coarse step: at most one fine cell apart.
        fine = _lattice(7, 5, step / 6, step_rotation / 4)
        return self._best(field.fine, ends, found, prior, fine, 1.0)

    def _best(
        self,
        level: DistanceField,
        ends: ScanPoints,
        center: Float[Array, "3"],
        prior: PosePrior,
        lattice: Float[Array, "headings offsets 3"],
        share: float,
    ) -> Float[Array, "3"]:
        """Return the best of center + lattice, one heading at a time to limit memory."""
        sigma = self.sigma_cells * level.resolution

        def score(pose: Float[Array, "3"]) -> Float[Array, ""]:
            hits = level.sum_of_hits(ends, pose, sigma, self.unseen_score)
            return share * self.beam_score * hits + prior.log_prob(pose)

        def heading(offsets: Float[Array, "offsets 3"]) -> tuple[Float[Array, ""], Float[Array, "3"]]:
            poses = center[None] + offsets
            scores = jax.vmap(score)(poses)
            return jnp.max(scores), poses[jnp.argmax(scores)]

        scores, poses = jax.lax.map(heading, lattice)
        best = poses[jnp.argmax(scores)]
        return best.at[2].set(se2.wrap(best[2]))


def _lattice(
    num_translations: int,
    num_rotations: int,
    step: float | Float[Array, ""],
    step_rotation: float | Float[Array, ""],
) -> Float[Array, "headings offsets 3"]:
    side = jnp.asarray(np.arange(num_translations) - num_translations // 2, jnp.float32) * step
    turn = jnp.asarray(np.arange(num_rotations) - num_rotations // 2, jnp.float32) * step_rotation
    theta, x, y = jnp.meshgrid(turn, side, side, indexing="ij")
    return jnp.stack([x, y, theta], axis=-1).reshape(num_rotations, num_translations**2, 3)
