"""The containers that a filter reads: scans, odometry increments and step inputs.

All are frozen pytrees of device arrays. Poses are plain arrays `[..., 3]`: x and y in meters, theta in
radians. `lax.scan` runs over containers stacked over time, with a leading axis `T` on every leaf.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Scalar = float | Float[Array, ""]
"""A setting of a model: a Python float, or a traced scalar under `jit`."""


class LidarScan(eqx.Module):
    """One planar scan and the geometry needed to place it.

    Beam `i` points at `angle_min + i * angle_increment` in the lidar frame, counter-clockwise positive.

    Attributes:
        ranges: `[B]` meters. Where `valid` is false the value is 0 and means "no return".
        valid: `[B]` true where the beam hit something within the usable range interval.
        angle_min: angle of beam 0, radians, lidar frame.
        angle_increment: angle between neighboring beams, radians (negative if clockwise).
        pose_base_lidar: `[3]` pose of the lidar in the robot's base frame.
    """

    ranges: Float[Array, "*batch B"]
    valid: Bool[Array, "*batch B"]
    angle_min: Float[Array, "*batch"]
    angle_increment: Float[Array, "*batch"]
    pose_base_lidar: Float[Array, "*batch 3"]

    @property
    def num_beams(self) -> int:
        """Return the number of beams `B`, valid or not."""
        return self.ranges.shape[-1]

    def angles(self) -> Float[Array, "*batch B"]:
        """Return the beam angles `[B]` in the lidar frame, radians."""
        index = jnp.arange(self.num_beams, dtype=self.ranges.dtype)
        return self.angle_min[..., None] + self.angle_increment[..., None] * index


class OdometryIncrement(eqx.Module):
    """The motion between two steps as measured by the odometry.

    Attributes:
        delta: `[3]` pose of the base at the end in the frame of the base at the start (m, m, rad).
        covariance: `[3, 3]` covariance of `delta` (m², m·rad, rad²); zeros if the source gives none.
        dt: duration in seconds.
    """

    delta: Float[Array, "*batch 3"]
    covariance: Float[Array, "*batch 3 3"]
    dt: Float[Array, "*batch"]


class StepInputs(eqx.Module):
    """The input of one filter step: the odometry since the last step and the scan at its end."""

    odometry: OdometryIncrement
    scan: LidarScan
