"""Satellite fixes in meters."""

import numpy as np
from jaxtyping import Float64

_EARTH_RADIUS = 6_378_137.0
"""Equatorial radius, meters (WGS 84)."""


def east_north(positions: Float64[np.ndarray, "M 3"]) -> Float64[np.ndarray, "M 2"]:
    """Return meters east and north of the first fix, on the plane tangent to the Earth there.

    Args:
        positions: `[M, 3]` latitude and longitude in degrees, altitude; M ≥ 1.
    """
    latitude, longitude = np.deg2rad(positions[:, 0]), np.deg2rad(positions[:, 1])
    east = (longitude - longitude[0]) * np.cos(latitude[0])
    return _EARTH_RADIUS * np.stack([east, latitude - latitude[0]], axis=-1)
