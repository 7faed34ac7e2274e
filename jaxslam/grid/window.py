"""Windows: the part of each particle's map around its robot, which is all that a step reads and writes."""

import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int, Int8

from jaxslam.grid.spec import GridSpec
from jaxslam.xla.sharding import PARTICLES, shard_map

_ROOM = 20
"""Smallest distance of the lidar from the window's edge, cells."""
_EDGE = 4
"""Cells at the window's edge where no beam may end, because the particles' poses differ slightly."""


def window_start(
    spec: GridSpec, position: Float[Array, "2"], shape: tuple[int, int], shift: Int[Array, "2"]
) -> tuple[Int[Array, "2"], Bool[Array, ""]]:
    """Return the first row and column of the window of `shape` centered `shift` cells from `position`.

    Args:
        spec: the map.
        position: `[2]` position of the lidar, meters, world frame.
        shape: rows and columns.
        shift: `[2]` rows and columns from the lidar's cell to the window's center cell.

    Returns:
        `[2]` int32 (row, column), clipped to lie on the map, and whether clipping changed it.
    """
    cell = jnp.floor(spec.cells(position)).astype(jnp.int32)
    start = cell[::-1] + shift - jnp.asarray([shape[0] // 2, shape[1] // 2], jnp.int32)
    last = jnp.asarray([spec.height - shape[0], spec.width - shape[1]], jnp.int32)
    inside = jnp.clip(start, 0, last)
    return inside, jnp.any(inside != start)


def window_origin(spec: GridSpec, start: Int[Array, "2"]) -> Float[Array, "2"]:
    """Return the world position of the lower-left corner of a window from (row, column), meters."""
    return spec.origin + spec.resolution * start[::-1].astype(jnp.float32)


def shift_to_scan(ends: Float[Array, "B 2"], resolution: Float[Array, ""], size: int) -> Int[Array, "2"]:
    """Return the rows and columns from the lidar to the middle of its scan.

    With the window shifted ahead, a forward-facing lidar can use twice the range in a window of the same
    size. The lidar itself stays on the window, a meter from its edge at 5 cm cells.

    Args:
        ends: `[B, 2]` end points relative to the lidar, meters, world axes; (0, 0) without a return.
        resolution: side of a cell, meters.
        size: cells along a side of the window.

    Returns:
        `[2]` int32 (row, column); 0 along an axis on which the whole scan fits around the lidar.
    """
    half = size // 2
    lowest, highest = jnp.min(ends, axis=0) / resolution, jnp.max(ends, axis=0) / resolution
    fits = jnp.maximum(-lowest, highest) < half - _EDGE
    limit = max(half - _ROOM, 0)
    middle = jnp.clip(jnp.round(0.5 * (lowest + highest)), -limit, limit)
    return jnp.where(fits, 0.0, middle).astype(jnp.int32)[::-1]


def inside_window(
    ends: Float[Array, "B 2"], resolution: Float[Array, ""], size: int, shift: Int[Array, "2"]
) -> Bool[Array, "B"]:
    """Return which beams end inside the window's outermost cells; arguments as for `shift_to_scan`."""
    from_center = ends / resolution - shift[None, ::-1].astype(jnp.float32)
    return jnp.all(jnp.abs(from_center) < size // 2 - _EDGE, axis=1)


def read_windows(
    maps: Int8[Array, "N H W"], starts: Int[Array, "N 2"], shape: tuple[int, int]
) -> Int8[Array, "N h w"]:
    """Cut one window of `shape` out of each map."""
    return jax.vmap(lambda grid, start: jax.lax.dynamic_slice(grid, start, shape))(maps, starts)


def write_windows(
    maps: Int8[Array, "N H W"],
    windows: Int8[Array, "N h w"],
    starts: Int[Array, "N 2"],
    mesh: Mesh | None = None,
) -> Int8[Array, "N H W"]:
    """Write each particle's window back in place at its first (row, column).

    The updates run in a loop, because a batched update would copy every map. `mesh` holds the devices that
    the particles are sharded over.
    """

    def write_all(
        maps: Int8[Array, "n H W"], windows: Int8[Array, "n h w"], starts: Int[Array, "n 2"]
    ) -> Int8[Array, "n H W"]:
        def write(index: Int[Array, ""], maps: Int8[Array, "n H W"]) -> Int8[Array, "n H W"]:
            row, column = starts[index, 0], starts[index, 1]
            return jax.lax.dynamic_update_slice(maps, windows[index][None], (index, row, column))

        return jax.lax.fori_loop(0, maps.shape[0], write, maps)

    return shard_map(mesh, write_all, (True, True, True))(maps, windows, starts)


def copy_maps(
    maps: Int8[Array, "N H W"], ancestors: Int[Array, "N"], mesh: Mesh | None = None
) -> Int8[Array, "N H W"]:
    """Give every slot its ancestor's map, copying only where the ancestor is another slot.

    Every ancestor must keep its own slot (`keep_survivors_in_place`), so that no source is overwritten.
    `mesh` holds the devices that the particles are sharded over.
    """
    slots = jnp.arange(maps.shape[0], dtype=jnp.int32)
    replaced = jnp.nonzero(ancestors != slots, size=maps.shape[0], fill_value=0)[0]

    def copy_all(
        maps: Int8[Array, "n H W"],
        ancestors: Int[Array, "N"],
        replaced: Int[Array, "N"],
        count: Int[Array, ""],
    ) -> Int8[Array, "n H W"]:
        def copy(index: Int[Array, ""], maps: Int8[Array, "n H W"]) -> Int8[Array, "n H W"]:
            slot = replaced[index]
            if mesh is None:
                source = jax.lax.dynamic_slice_in_dim(maps, ancestors[slot], 1)
            else:
                source = _sent_to_all(maps, ancestors[slot])
                slot, here = _own_slot(slot, maps.shape[0])
                source = jnp.where(here, source, jax.lax.dynamic_slice_in_dim(maps, slot, 1))
            return jax.lax.dynamic_update_slice_in_dim(maps, source, slot, 0)

        return jax.lax.fori_loop(0, count, copy, maps)

    copy_each = shard_map(mesh, copy_all, (True, False, False, False))
    return copy_each(maps, ancestors, replaced, jnp.sum(ancestors != slots))


def _sent_to_all(maps: Int8[Array, "n H W"], slot: Int[Array, ""]) -> Int8[Array, "1 H W"]:
    """Return the map of a slot, broadcast from the device that holds it."""
    own, here = _own_slot(slot, maps.shape[0])
    source = jax.lax.dynamic_slice_in_dim(maps, own, 1)
    return jax.lax.psum(jnp.where(here, source, jnp.zeros_like(source)), PARTICLES)


def _own_slot(slot: Int[Array, ""], count: int) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """Return a slot's index among the `count` of this device, and whether this device holds the slot."""
    own = slot - jax.lax.axis_index(PARTICLES).astype(jnp.int32) * count
    return jnp.clip(own, 0, count - 1), (own >= 0) & (own < count)
