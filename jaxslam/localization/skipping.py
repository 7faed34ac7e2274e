"""Beam skipping: exclusion of beams that hardly any particle explains."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam.core.types import LidarScan, Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.known_map import KnownMap
from jaxslam.lidar.beams import end_points, spread_beams


class BeamSkipping(eqx.Module):
    """Exclusion of beams that hardly any particle explains, such as beams on people and moved objects.

    Beams are skipped only once the particles agree; before that, most particles are at wrong poses.

    Attributes:
        near: a beam matches the map if it ends within this distance of an obstacle, meters.
        min_share: beams that match for a smaller share of the particles are skipped.
        max_skipped: if more than this share of the beams would be skipped, none is, since the particles are
            then more likely wrong than the beams.
        enabled: whether beams are skipped at all (static).
    """

    near: Scalar = 0.5
    min_share: Scalar = 0.3
    max_skipped: Scalar = 0.9
    enabled: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        require_at_least_zero(self)

    def kept(
        self, shares: Float[Array, "B"], valid: Bool[Array, "B"], converged: Bool[Array, ""]
    ) -> Bool[Array, "B"]:
        """Return which valid beams `[B]` are used, given the share of particles for which each matches."""
        kept = valid & (shares > self.min_share)
        num_valid = jnp.maximum(jnp.sum(valid, dtype=jnp.float32), 1.0)
        skipped = 1.0 - jnp.sum(kept, dtype=jnp.float32) / num_valid
        return jnp.where(converged & (skipped <= self.max_skipped), kept, valid)

    def skip(
        self,
        map: KnownMap,
        scan: LidarScan,
        poses: Float[Array, "N 3"],
        active: Bool[Array, "N"],
        converged: Bool[Array, ""],
        max_beams: int,
    ) -> LidarScan:
        """Return the scan with the skipped beams marked as not valid.

        Args:
            map: the known map.
            scan: ranges `[B]` in meters and mask `[B]`.
            poses: `[N, 3]` base poses in the frame of the map (m, m, rad).
            active: `[N]` which particles are in use.
            converged: whether the particles agree.
            max_beams: beams that the sensor model scores, evenly spread over the scan.
        """
        if not self.enabled:
            return scan
        points, valid = end_points(scan, max_beams)
        weights = active.astype(jnp.float32) / jnp.maximum(jnp.sum(active, dtype=jnp.float32), 1.0)
        shares = map.near_obstacles(self.near).sum_over_poses(poses, points, weights)
        scored = spread_beams(scan.num_beams, max_beams)
        kept = scan.valid.at[scored].set(self.kept(shares, valid, converged))
        return eqx.tree_at(lambda s: s.valid, scan, kept)
