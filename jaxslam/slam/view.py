"""The part of the particles' maps around the scan, which a step reads, scores and writes back."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int, Int8

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.grid.field import Field, prepare_field, window_rows
from jaxslam.grid.occupancy import OccupancyModel, add_scan, cells_from_lidar, quantize, range_table
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.walls import thin_walls
from jaxslam.grid.window import (
    inside_window,
    read_windows,
    shift_to_scan,
    window_origin,
    window_start,
    write_windows,
)
from jaxslam.lidar.beams import scan_points
from jaxslam.xla.materialize import materialize


class ScanView(eqx.Module):
    """A scan and the placement of the map windows around it.

    Attributes:
        scan: the scan without returns beyond the usable range or outside the windows; used for matching,
            weighting and mapping.
        clearing: the scan with longer returns shortened to the usable range; clears free space up to it.
        shift: `[2]` int32 rows and columns from the lidar to the center of the windows.
    """

    scan: LidarScan
    clearing: LidarScan
    shift: Int[Array, "2"]


class MapView(eqx.Module):
    """Windows of the maps around the scan; the attributes are those of `RBPF`."""

    grid: GridSpec
    occupancy: OccupancyModel
    usable_range: float | Float[Array, ""]
    window_size: int = eqx.field(static=True)
    radius: int = eqx.field(static=True)

    def look(self, scan: LidarScan, heading: Float[Array, ""]) -> ScanView:
        """Place the windows and select the returns on them.

        All particles share one view, because their headings differ little.

        Args:
            scan: ranges `[B]` in meters and mask `[B]`.
            heading: predicted heading of the base in the world, radians.
        """
        reach = jnp.asarray(self.usable_range, jnp.float32)
        clearing = eqx.tree_at(lambda s: s.ranges, scan, jnp.minimum(scan.ranges, reach))
        heading = heading + scan.pose_base_lidar[2]
        bearings = scan.angles() + jnp.where(jnp.isfinite(heading), heading, 0.0)
        ends = clearing.ranges[:, None] * jnp.stack([jnp.cos(bearings), jnp.sin(bearings)], axis=-1)
        ends = jnp.where(scan.valid[:, None], ends, 0.0)
        shift = shift_to_scan(ends, self.grid.resolution, self.window_size)
        seen = scan.valid & (scan.ranges < reach)
        seen = seen & inside_window(ends, self.grid.resolution, self.window_size, shift)
        return ScanView(eqx.tree_at(lambda s: s.valid, scan, seen), clearing, shift)

    def fields(self, maps: Int8[Array, "N H W"], predicted: Float[Array, "N 3"], view: ScanView) -> Field:
        """Build each particle's distance field around its odometry-predicted pose; leaves `[N, ...]`.

        Args:
            maps: `[N, H, W]` log-odds in fixed point.
            predicted: `[N, 3]` base poses (m, m, rad).
            view: from `look`.
        """
        shape = (window_rows(self.window_size, self.radius), self.window_size)
        _, starts, _ = self._place(predicted, view, shape)
        windows = jax.vmap(thin_walls, (None, 0))(self.occupancy, read_windows(maps, starts, shape))
        origins = jax.vmap(window_origin, (None, 0))(self.grid, starts)
        threshold = quantize(self.occupancy.occupied_above)
        return jax.vmap(prepare_field, (0, None, 0, None, None))(
            windows, threshold, origins, self.grid.resolution, self.radius
        )

    def update(
        self,
        maps: Int8[Array, "N H W"],
        poses: Float[Array, "N 3"],
        view: ScanView,
        mesh: Mesh | None = None,
    ) -> tuple[Int8[Array, "N H W"], Bool[Array, "N"]]:
        """Add the scan to each map at the pose of its particle.

        Args:
            maps: `[N, H, W]` log-odds in fixed point.
            poses: `[N, 3]` base poses of the scan (m, m, rad).
            view: from `look`.
            mesh: the devices that the particles are sharded over.

        Returns:
            The maps, and which windows crossed the edge of their map `[N]`.
        """
        shape = (self.window_size, self.window_size)
        table = range_table(view.clearing, self.grid.resolution, 2 * self.window_size)
        around = cells_from_lidar(self.window_size, view.shift)
        ends = scan_points(view.scan)
        # Otherwise XLA would recompute a particle's heading for each cell of its window.
        poses = materialize(lambda poses: poses + 0.0, poses)
        lidar, starts, off_map = self._place(poses, view, shape)

        def update(
            window: Int8[Array, "S S"],
            start: Int[Array, "2"],
            pose: Float[Array, "3"],
            heading: Float[Array, ""],
        ) -> Int8[Array, "S S"]:
            cells = jnp.floor(self.grid.cells(se2.apply(pose, ends.points))).astype(jnp.int32)
            hits = cells[:, ::-1] - start[None]
            return add_scan(self.occupancy, window, table, around, hits, ends.valid, heading)

        windows = read_windows(maps, starts, shape)
        windows = jax.vmap(update)(windows, starts, poses, lidar[:, 2])
        return write_windows(maps, windows, starts, mesh), off_map

    def _place(
        self, poses: Float[Array, "N 3"], view: ScanView, shape: tuple[int, int]
    ) -> tuple[Float[Array, "N 3"], Int[Array, "N 2"], Bool[Array, "N"]]:
        """Return the poses of the lidars, the starts of their windows, and which of these were moved."""
        lidar = jax.vmap(se2.compose, (0, None))(poses, view.scan.pose_base_lidar)
        starts, moved = jax.vmap(lambda pose: window_start(self.grid, pose[:2], shape, view.shift))(lidar)
        return lidar, starts, moved
