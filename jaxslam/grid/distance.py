"""Truncated distance transform of an occupancy window, in integers."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, UInt8

MAX_RADIUS = 10
"""Largest radius in cells whose squares fit a byte: (r² + 1) + r² ≤ 255."""


def squared_distance(occupied: Bool[Array, "H W"], radius: int) -> UInt8[Array, "H W"]:
    """Squared Euclidean distance in cells to the nearest occupied cell, truncated to `radius² + 1`.

    Example:
        One occupied cell and `radius=2`: 0 there, 1 beside it, 2 across the corner, 4 two cells away, else 5.
    """
    height, width = occupied.shape
    # Empty columns between the rows keep a flat shift from reaching into the neighbouring row.
    padded = jnp.pad(occupied, ((margin_rows(radius),) * 2, (0, radius)))
    return squared_distance_flat(padded, radius).reshape(height, width + radius)[:, :width]


def margin_rows(radius: int) -> int:
    """Rows above and below that `squared_distance_flat` reads and does not return."""
    return radius + 1


def squared_distance_flat(occupied: Bool[Array, "H W"], radius: int) -> UInt8[Array, "HW"]:
    """As `squared_distance`, row after row, without the margin rows and wrong near the sides.

    The first and last `margin_rows(radius)` rows are read only; the result has the others. Within
    `radius` columns of the left and right side a distance may be taken to the neighbouring row's other
    end. For that the whole transform is `4 · radius` shifted reads of flat arrays and compiles to a few
    vector instructions per cell.

    Separable min-plus (lower envelope of parabolas): along the rows, then along the columns.
    """
    if not 1 <= radius <= MAX_RADIUS:
        raise ValueError(f"radius is {radius} cells: choose 1 to {MAX_RADIUS}")
    height, width = occupied.shape
    far = jnp.uint8(radius * radius + 1)
    values = jnp.where(occupied, jnp.uint8(0), far).reshape(-1)
    rows = _lower_envelope(values, (height - 2) * width, radius, stride=1, far=far)
    return _lower_envelope(rows, (height - 2 * margin_rows(radius)) * width, radius, stride=width, far=far)


def _lower_envelope(
    values: UInt8[Array, "n"], size: int, radius: int, stride: int, far: UInt8[Array, ""]
) -> UInt8[Array, "size"]:
    first = (values.shape[0] - size) // 2

    def shifted(steps: int) -> UInt8[Array, "size"]:
        return values[first + steps * stride : first + steps * stride + size]

    result = shifted(0)
    for steps in range(1, radius + 1):
        nearer = jnp.minimum(shifted(-steps), shifted(steps))
        result = jnp.minimum(result, nearer + jnp.uint8(steps * steps))
    return jnp.minimum(result, far)
