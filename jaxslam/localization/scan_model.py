"""How well a scan fits a known map, for all particles at once."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.core.validation import require_at_least_zero, require_one_of
from jaxslam.grid.distance import MAX_RADIUS
from jaxslam.grid.field import Field, field_of_map
from jaxslam.lidar.beams import spread_beams
from jaxslam.localization.known_map import BORDER, KnownMap
from jaxslam.sensor.beam import Beam

_UNROLL = 5
"""Beams per trip of the loop: more spill out of the registers."""


class AbstractScanModel(eqx.Module):
    """p(z_t | x_t, m) on a known map, of all particles."""

    @property
    @abc.abstractmethod
    def beams_per_scan(self) -> int:
        """How many beams of a scan are looked at, at most."""

    @property
    @abc.abstractmethod
    def independent_count(self) -> float | Float[Array, ""]:
        """How many independent beams a scan counts for: the likelihood is of about this many factors."""

    def num_scored(self, scan: LidarScan) -> Float[Array, ""]:
        """How many of the beams that are looked at returned."""
        return jnp.sum(scan.valid[spread_beams(scan.num_beams, self.beams_per_scan)], dtype=jnp.float32)

    @abc.abstractmethod
    def prepare(self, known: KnownMap) -> Any:
        """What `log_likelihoods` looks up, computed once per map."""

    @abc.abstractmethod
    def log_likelihoods(
        self,
        prepared: Any,
        known: KnownMap,
        scan: LidarScan,
        poses: Float[Array, "N 3"],
        live: Bool[Array, "N"],
        converged: Bool[Array, ""],
    ) -> Float[Array, "N"]:
        """Natural log of the likelihood of a scan at each pose `[N, 3]` (m, m, rad, world frame).

        Args:
            prepared: from `prepare`.
            known: the map.
            scan: ranges `[B]`, metres.
            poses: base poses.
            live: which of them count; of the others the result means nothing.
            converged: whether the particles agree on where the robot is.
        """


class BeamSkipping(eqx.Module):
    """Leaves out the beams that hardly any particle explains: people, and what has been moved.

    Only once the particles agree: before that most of them are elsewhere.

    Attributes:
        near: a beam agrees with the map if it ends within so many metres of an obstacle.
        min_share: beams that agree for a smaller share of the particles are left out.
        max_skipped: where more than this share of the beams would be left out, none is: then the particles
            are wrong and not the beams.
        enabled: whether it is done at all (static).
    """

    near: float | Float[Array, ""] = 0.5
    min_share: float | Float[Array, ""] = 0.3
    max_skipped: float | Float[Array, ""] = 0.9
    enabled: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        require_at_least_zero(self)

    def kept(
        self, shares: Float[Array, "B"], valid: Bool[Array, "B"], converged: Bool[Array, ""]
    ) -> Bool[Array, "B"]:
        """Which of the valid beams `[B]` are used.

        Args:
            shares: `[B]` share of the particles for which a beam ends near an obstacle.
            valid: `[B]` beams that returned.
            converged: whether the particles agree.
        """
        kept = valid & (shares > self.min_share)
        num_valid = jnp.maximum(jnp.sum(valid, dtype=jnp.float32), 1.0)
        skipped = 1.0 - jnp.sum(kept, dtype=jnp.float32) / num_valid
        return jnp.where(converged & (skipped <= self.max_skipped), kept, valid)


class FieldModel(AbstractScanModel):
    r"""The likelihood field: how far each beam ends from the nearest obstacle.

    $p_k = (z_{hit} e^{-d_k^2/2\sigma^2} + z_{rand}) / (z_{hit} + z_{rand})$, and by `combine`

    - "product": the product of all $p_k$, raised to `independent_beams` over the number of beams (1 where
      there are fewer), since neighbouring beams see the same wall and the error of the map is common to all;
    - "cubes": $1 + \sum_k p_k^3$ with $p_k = z_{hit} e^{-d_k^2/2\sigma^2} + z_{rand} / z_{max}$, as
      nav2's AMCL and ROS' before it compute it. It has no derivation; it is here for comparison.

    Attributes:
        sigma_hit: spread of end points around obstacles, metres.
        z_hit: weight of the beams that saw the map.
        z_rand: weight of those that saw something else.
        independent_beams: how many independent beams a scan counts for, in the product. More, and rooms that
            look alike are told apart by the map's own errors before the robot has seen the difference.
        max_range: of the lidar, for the cubes, metres.
        skipping: of beams that the map does not explain.
        combine: "product" or "cubes" (static).
        max_beams: beams that are scored, evenly spread over the scan (static).

    References:
        Thrun, Burgard, Fox, Probabilistic Robotics, table 6.3; the exponent is ours.

    Example:
        Default weights: a beam on an obstacle counts 1, one 0.2 m off 0.626, one far from all 0.05.
    """

    sigma_hit: float | Float[Array, ""] = 0.2
    z_hit: float | Float[Array, ""] = 0.95
    z_rand: float | Float[Array, ""] = 0.05
    independent_beams: float | Float[Array, ""] = 5.0
    max_range: float | Float[Array, ""] = 80.0
    skipping: BeamSkipping = BeamSkipping()
    combine: str = eqx.field(static=True, default="product")
    max_beams: int = eqx.field(static=True, default=60)

    def __check_init__(self):
        require_at_least_zero(self, positive=("sigma_hit", "z_rand", "max_range"))
        require_one_of(self, "combine", ("product", "cubes"))

    @property
    def beams_per_scan(self) -> int:
        """See `max_beams`."""
        return self.max_beams

    @property
    def independent_count(self) -> float | Float[Array, ""]:
        """See `independent_beams`; the sum of the cubes is no product."""
        return self.independent_beams if self.combine == "product" else 1.0

    def prepare(self, known: KnownMap) -> Float[Array, "cells"]:
        """What a beam adds that ends in a cell, row after row, with the border."""
        hit = jnp.exp(-0.5 * (known.distance / self.sigma_hit) ** 2)
        # As far from all as the map's distances tell is far from all.
        hit = jnp.where(known.distance < known.max_distance, hit, 0.0)
        if self.combine == "cubes":
            return ((self.z_hit * hit + self.z_rand / self.max_range) ** 3).reshape(-1)
        return jnp.log((self.z_hit * hit + self.z_rand) / (self.z_hit + self.z_rand)).reshape(-1)

    def log_likelihoods(
        self,
        prepared: Float[Array, "cells"],
        known: KnownMap,
        scan: LidarScan,
        poses: Float[Array, "N 3"],
        live: Bool[Array, "N"],
        converged: Bool[Array, ""],
    ) -> Float[Array, "N"]:
        """See `AbstractScanModel`; a scan without a return says 0 everywhere."""
        points, valid = ends_in_cells(known, scan, self.max_beams)
        cells = known.in_cells(poses)
        if self.skipping.enabled:
            near = jnp.minimum(self.skipping.near, known.max_distance)
            is_near = (known.distance.reshape(-1) < near).astype(jnp.float32)
            shares = share_near(known, is_near, cells, points, live)
            valid = self.skipping.kept(shares, valid, converged)
        counted = valid.astype(jnp.float32)
        total = sum_over_beams(known, prepared, cells, points, counted)
        if self.combine == "cubes":
            return jnp.log1p(total)
        return total * jnp.minimum(self.independent_beams / jnp.maximum(jnp.sum(counted), 1.0), 1.0)


class BeamModel(AbstractScanModel):
    """The beam model on a known map: exact, and slower by the casting of every beam.

    Attributes:
        beam: the mixture over ranges.
    """

    beam: Beam = Beam(80.0)

    @property
    def beams_per_scan(self) -> int:
        """Those that are cast."""
        return self.beam.max_beams

    @property
    def independent_count(self) -> float | Float[Array, ""]:
        """By the weight of a beam."""
        return self.beam.beam_weight * self.beam.max_beams

    def prepare(self, known: KnownMap) -> Field:
        """The map's distance field, in the map's own frame."""
        zero = jnp.zeros(2, jnp.float32)
        return field_of_map(known.occupied, zero, known.resolution, MAX_RADIUS)

    def log_likelihoods(
        self,
        prepared: Field,
        known: KnownMap,
        scan: LidarScan,
        poses: Float[Array, "N 3"],
        live: Bool[Array, "N"],
        converged: Bool[Array, ""],
    ) -> Float[Array, "N"]:
        """See `AbstractScanModel`."""
        local = jax.vmap(se2.relative, (None, 0))(known.origin, poses)
        return jax.vmap(lambda pose: self.beam.log_prob(prepared, scan, pose))(local)


def share_on_map(
    known: KnownMap, scan: LidarScan, pose: Float[Array, "3"], near: float | Float[Array, ""]
) -> Float[Array, ""]:
    """Share of a scan's valid beams that end within `near` metres of an obstacle; NaN without a valid beam.

    Args:
        known: the map.
        scan: ranges `[B]`, metres.
        pose: `[3]` of the base (m, m, rad, world frame).
        near: metres.
    """
    points, valid = ends_in_cells(known, scan, scan.num_beams)
    # The map's distances go no farther than `max_distance`, which stands for all that are.
    is_near = (known.distance.reshape(-1) < jnp.minimum(near, known.max_distance)).astype(jnp.float32)
    weights = valid.astype(jnp.float32)
    total = sum_over_beams(known, is_near, known.in_cells(pose[None]), points, weights)[0]
    return total / jnp.sum(weights)


def ends_in_cells(
    known: KnownMap, scan: LidarScan, max_beams: int
) -> tuple[Float[Array, "B 2"], Bool[Array, "B"]]:
    """End points `[B, 2]` of evenly spread beams in the base frame, in cells of the map; which are valid."""
    chosen = spread_beams(scan.num_beams, max_beams)
    angles, valid = scan.angles()[chosen], scan.valid[chosen]
    ranges = jnp.where(valid, scan.ranges[chosen], 0.0)
    points = jnp.stack([ranges * jnp.cos(angles), ranges * jnp.sin(angles)], axis=-1)
    return se2.apply(scan.pose_base_lidar, points) / known.resolution, valid


def sum_over_beams(
    known: KnownMap,
    table: Float[Array, "cells"],
    poses: Float[Array, "N 3"],
    points: Float[Array, "B 2"],
    weights: Float[Array, "B"],
) -> Float[Array, "N"]:
    """For every pose the weighted sum of a table's entries where the end points of a scan lie.

    Args:
        known: the map.
        table: one value per cell, row after row, with the border.
        poses: `[N, 3]` of the base: column, row, radians, as `KnownMap.in_cells` gives them.
        points: `[B, 2]` in cells, base frame.
        weights: `[B]` of the beams; 0 leaves one out.
    """
    x, y = poses[:, 0] + np.float32(BORDER), poses[:, 1] + np.float32(BORDER)
    cos, sin = jnp.cos(poses[:, 2]), jnp.sin(poses[:, 2])

    def add(total: Float[Array, "N"], beam: Float[Array, "3"]) -> tuple[Float[Array, "N"], None]:
        along, left, weight = beam
        column, row = x + cos * along - sin * left, y + sin * along + cos * left
        return total + weight * _entries(known.shape, table, column, row), None

    # Beam after beam and all particles at once: so the CPU takes eight or sixteen of them in one instruction.
    beams = jnp.concatenate([points, weights[:, None]], axis=-1)
    return jax.lax.scan(add, jnp.zeros_like(x), beams, unroll=_UNROLL)[0]


def share_near(
    known: KnownMap,
    is_near: Float[Array, "cells"],
    poses: Float[Array, "N 3"],
    points: Float[Array, "B 2"],
    live: Bool[Array, "N"],
) -> Float[Array, "B"]:
    """For every beam the share of the live particles for which it ends in a cell of a table of 0 and 1.

    Arguments as `sum_over_beams`.
    """
    x, y = poses[:, 0] + np.float32(BORDER), poses[:, 1] + np.float32(BORDER)
    cos, sin = jnp.cos(poses[:, 2]), jnp.sin(poses[:, 2])
    weight = live.astype(jnp.float32) / jnp.maximum(jnp.sum(live, dtype=jnp.float32), 1.0)

    def share(point: Float[Array, "2"]) -> Float[Array, ""]:
        column, row = x + cos * point[0] - sin * point[1], y + sin * point[0] + cos * point[1]
        return jnp.sum(weight * _entries(known.shape, is_near, column, row))

    return jax.lax.map(share, points)


def _entries(
    shape: tuple[int, int], table: Float[Array, "cells"], column: Float[Array, "N"], row: Float[Array, "N"]
) -> Float[Array, "N"]:
    height, width = shape
    # What lies off the map is moved to its border; a NaN, too.
    column = jnp.where(column > 0.0, jnp.minimum(column, np.float32(width + BORDER)), 0.0)
    row = jnp.where(row > 0.0, jnp.minimum(row, np.float32(height + BORDER)), 0.0)
    index = row.astype(jnp.int32) * (width + 2 * BORDER) + column.astype(jnp.int32)
    return table.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
