"""Planar rigid motions, SE(2), on plain arrays `[..., 3]` = (x m, y m, theta rad).

`pose_a_b` is the pose of frame `b` in frame `a`; `compose(pose_a_b, pose_b_c)` is `pose_a_c`. All
functions broadcast over leading axes of equal rank, run under `jit`, `vmap` and `grad`, and return
angles in [−π, π).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float


def wrap(angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Wraps an angle in radians into [−π, π).

    Example:
        `wrap(3π/2)` is `−π/2`; `wrap(π)` is `−π`.
    """
    wrapped = jnp.mod(angle + jnp.pi, 2 * jnp.pi) - jnp.pi
    # Rounding can carry a tiny negative angle to exactly +π; the interval is half-open.
    return jnp.where(wrapped >= jnp.pi, -jnp.pi, wrapped).astype(wrapped.dtype)


def rotate(angle: Float[Array, "*batch"], vector: Float[Array, "*batch 2"]) -> Float[Array, "*batch 2"]:
    """Rotates vectors `[..., 2]` counter-clockwise by `angle` radians `[...]`."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    return jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def rotate_all(angle: Float[Array, ""], vectors: Float[Array, "*points 2"]) -> Float[Array, "*points 2"]:
    """Vectors `[*points, 2]` turned by one angle (rad), counter-clockwise."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def compose(
    pose_a_b: Float[Array, "*batch 3"], pose_b_c: Float[Array, "*batch 3"]
) -> Float[Array, "*batch 3"]:
    """Pose of `c` in `a` from the pose of `b` in `a` and of `c` in `b` (the ⊕ of the literature).

    Example:
        `compose([1, 0, π/2], [2, 0, 0])` is `[1, 2, π/2]`.
    """
    position = pose_a_b[..., :2] + rotate(pose_a_b[..., 2], pose_b_c[..., :2])
    heading = wrap(pose_a_b[..., 2] + pose_b_c[..., 2])
    return jnp.concatenate([position, heading[..., None]], axis=-1)


def inverse(pose_a_b: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """Pose of `a` in `b`."""
    position = rotate(-pose_a_b[..., 2], -pose_a_b[..., :2])
    return jnp.concatenate([position, wrap(-pose_a_b[..., 2])[..., None]], axis=-1)


def relative(
    pose_a_b: Float[Array, "*batch 3"], pose_a_c: Float[Array, "*batch 3"]
) -> Float[Array, "*batch 3"]:
    """Pose of `c` in `b`, both given in `a` (`c ⊖ b`).

    The inverse of composition: `compose(b, relative(b, c))` is `c`.
    """
    position = rotate(-pose_a_b[..., 2], pose_a_c[..., :2] - pose_a_b[..., :2])
    heading = wrap(pose_a_c[..., 2] - pose_a_b[..., 2])
    return jnp.concatenate([position, heading[..., None]], axis=-1)


def apply(pose_a_b: Float[Array, "3"], points_b: Float[Array, "*points 2"]) -> Float[Array, "*points 2"]:
    """Moves points `[..., 2]` given in frame `b` into frame `a`."""
    turned = rotate_all(pose_a_b[2], points_b)
    return jnp.stack([turned[..., 0] + pose_a_b[0], turned[..., 1] + pose_a_b[1]], axis=-1)
