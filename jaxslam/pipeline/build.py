"""Build a filter from its configuration."""

import math

import numpy as np
from jaxtyping import Float64

from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.slam import SlamConfig
from jaxslam.grid.field import window_rows
from jaxslam.grid.known_map import KnownMap
from jaxslam.grid.spec import GridSpec
from jaxslam.io.map_server import OccupancyMap
from jaxslam.localization.amcl import AMCL
from jaxslam.localization.kld import Bins
from jaxslam.range_network.network import RangeNetwork
from jaxslam.slam.rbpf import RBPF
from jaxslam.xla.resources import physical_memory

_MAX_COUNT = 2**31 - 1
_MAX_BINS = 2**27
_BYTES_PER_PARTICLE = 200
"""Memory of a step: 137 bytes according to the compiler, plus a reserve for the pictures."""


def build_slam(
    config: SlamConfig,
    odometry_bounds: Float64[np.ndarray, "2 2"],
    range_network: RangeNetwork | None = None,
) -> RBPF:
    """Build the filter of a configuration, with maps sized for an odometry path.

    Args:
        config: configuration, with a lidar.
        odometry_bounds: `[2, 2]` lower and upper corner of the odometry path, meters.
        range_network: network that corrects the ranges of every scan, or None.

    Raises:
        ValueError: the configuration has no lidar, or the maps would not fit into memory.

    Example:
        A path of 10 × 5 m, a margin of 12 m plus 0.3 m per meter, and a usable range of 8 m give maps of
        56 × 51 m.
    """
    if config.lidar is None:
        raise ValueError('config.lidar is None: set one, for example config.with_lidar("sick")')
    reach, resolution = float(config.lidar.usable_range), float(config.map.resolution)
    longer_side = float(np.max(odometry_bounds[1] - odometry_bounds[0]))
    margin = float(config.map.margin) + float(config.map.margin_share) * longer_side
    around = reach + margin
    radius = config.map.radius
    # Rounding errors must not add a cell to a range that is a whole number of cells.
    half_window = math.ceil(min(reach, float(config.map.window) / 2) / resolution - 1e-6) + radius + 1
    window_size = -(-2 * half_window // 4) * 4
    lower, upper = odometry_bounds[0] - around, odometry_bounds[1] + around
    # A map with a small margin must still be large enough for the window.
    missing = np.maximum(window_rows(window_size, radius) * resolution - (upper - lower), 0.0)
    lower, upper = lower - missing / 2, upper + missing / 2
    width, height = upper - lower
    cells = float(np.prod(np.ceil((upper - lower) / resolution)))
    _check_memory(
        f"{config.num_particles} maps of {width:.0f} × {height:.0f} m",
        cells,
        # One byte per cell and particle, and twice that while particles are resampled.
        2 * cells * config.num_particles,
        "lower num_particles or map.margin, or raise map.resolution",
    )
    return RBPF(
        grid=GridSpec.covering(lower, upper, resolution),
        motion=config.motion,
        sensor=config.sensor,
        proposal=config.proposal,
        resampling=config.resampling,
        occupancy=config.occupancy,
        usable_range=config.lidar.usable_range,
        range_network=range_network,
        num_particles=config.num_particles,
        window_size=window_size,
        radius=radius,
    )


def build_localizer(
    config: LocalizationConfig,
    occupancy: OccupancyMap,
    range_network: RangeNetwork | None = None,
) -> AMCL:
    """Build the localization filter of a configuration on a map.

    Args:
        config: configuration.
        occupancy: known map.
        range_network: network that corrects the ranges of every scan, or None.

    Raises:
        ValueError: the map has no obstacle or no free space, the bins are too small for the map, or the
            particles would not fit into memory.
    """
    count = config.max_particles
    _check_memory(f"{count} particles", count, count * _BYTES_PER_PARTICLE, "lower max_particles")
    map = KnownMap.from_map(occupancy, float(config.max_distance))
    bins = Bins.over(map, float(config.bins.translation), float(config.bins.rotation))
    if bins.count > _MAX_BINS:
        extent = np.asarray(map.shape) * float(map.resolution)
        raise ValueError(
            f"{occupancy.name}: {bins.count:.2g} bins on a map of {extent[1]:.0f} × {extent[0]:.0f} m: raise "
            "bins.translation or bins.rotation"
        )
    return AMCL(
        map=map,
        prepared=config.sensor.prepare(map),
        bins=bins,
        motion=config.motion,
        sensor=config.sensor,
        skipping=config.skipping,
        sampling=config.sampling,
        recovery=config.recovery,
        clustering=config.clustering,
        agreement=config.agreement,
        resample_below=config.resample_below,
        min_valid_beams=config.min_valid_beams,
        range_network=range_network,
        max_particles=config.max_particles,
    )


def _check_memory(items: str, count: float, needed: float, remedy: str) -> None:
    """Raise `ValueError` if there are too many items, or if they need more bytes than are available."""
    available = physical_memory()
    if count > _MAX_COUNT or needed > available:
        raise ValueError(
            f"{items} need {needed / 1e9:.3g} GB, but only {available / 1e9:.3g} GB are available: {remedy}"
        )
