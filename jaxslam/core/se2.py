"""Planar rigid motions, SE(2), on plain arrays `[..., 3]` = (x m, y m, theta rad).

`pose_a_b` is the pose of frame `b` in frame `a`; `compose(pose_a_b, pose_b_c)` is `pose_a_c`. Every function
takes JAX arrays (under `jit`, `vmap` and `grad`) or NumPy arrays (float64, on the host) and returns the same
kind. Leading axes broadcast; angles are returned in [−π, π).
"""

from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float


def wrap(angle: Float[Any, "*batch"] | float) -> Float[Any, "*batch"]:
    """Wrap an angle in radians into [−π, π).

    Example:
        `wrap(3π/2)` is `−π/2`; `wrap(π)` is `−π`.
    """
    xp = _namespace(angle)
    wrapped = xp.mod(angle + xp.pi, 2 * xp.pi) - xp.pi
    # Rounding can turn a tiny negative angle into exactly +π, which is outside the half-open interval.
    return xp.where(wrapped >= xp.pi, -xp.pi, wrapped).astype(wrapped.dtype)


def rotate(angle: Float[Any, "*#batch"], vector: Float[Any, "*#batch 2"]) -> Float[Any, "*batch 2"]:
    """Rotate vectors `[..., 2]` counter-clockwise by `angle` radians `[...]`."""
    xp = _namespace(vector)
    cos, sin = xp.cos(angle), xp.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    return xp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def compose(pose_a_b: Float[Any, "*#batch 3"], pose_b_c: Float[Any, "*#batch 3"]) -> Float[Any, "*batch 3"]:
    """Return the pose of `c` in `a`, given the poses of `b` in `a` and of `c` in `b` (⊕ in the literature).

    Example:
        `compose([1, 0, π/2], [2, 0, 0])` is `[1, 2, π/2]`.
    """
    position = pose_a_b[..., :2] + rotate(pose_a_b[..., 2], pose_b_c[..., :2])
    return _pose(position, pose_a_b[..., 2] + pose_b_c[..., 2])


def inverse(pose_a_b: Float[Any, "*batch 3"]) -> Float[Any, "*batch 3"]:
    """Return the pose of `a` in `b`."""
    return _pose(rotate(-pose_a_b[..., 2], -pose_a_b[..., :2]), -pose_a_b[..., 2])


def relative(pose_a_b: Float[Any, "*#batch 3"], pose_a_c: Float[Any, "*#batch 3"]) -> Float[Any, "*batch 3"]:
    """Return the pose of `c` in `b`, both given in `a` (`c ⊖ b`).

    This is the inverse of `compose`: `compose(b, relative(b, c))` is `c`.
    """
    position = rotate(-pose_a_b[..., 2], pose_a_c[..., :2] - pose_a_b[..., :2])
    return _pose(position, pose_a_c[..., 2] - pose_a_b[..., 2])


def apply(pose_a_b: Float[Any, "3"], points_b: Float[Any, "*points 2"]) -> Float[Any, "*points 2"]:
    """Transform points `[..., 2]` from frame `b` into frame `a`."""
    turned = rotate(pose_a_b[2], points_b)
    xp = _namespace(turned)
    return xp.stack([turned[..., 0] + pose_a_b[0], turned[..., 1] + pose_a_b[1]], axis=-1)


def _pose(position: Float[Any, "*batch 2"], heading: Float[Any, "*batch"]) -> Float[Any, "*batch 3"]:
    xp = _namespace(position)
    return xp.concatenate([position, wrap(heading)[..., None]], axis=-1)


def _namespace(array: Any) -> ModuleType:
    """Return `jax.numpy` for JAX arrays, else NumPy; reading a log must not import JAX."""
    return np if isinstance(array, np.ndarray | np.generic | float) else array.__array_namespace__()
