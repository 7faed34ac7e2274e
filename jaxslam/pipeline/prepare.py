"""Prepare a filter and its scans from a log and a configuration."""

from dataclasses import replace

from jaxslam.config.lidar import LidarSettings
from jaxslam.config.lidar_presets import detect_lidar
from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.slam import SlamConfig
from jaxslam.core.validation import require_static_sizes, require_types
from jaxslam.fusion.imu import turning_is_known
from jaxslam.io.log import SensorLog
from jaxslam.io.map_server import OccupancyMap
from jaxslam.localization.amcl import AMCL
from jaxslam.motion.gaussian import GaussianMotion
from jaxslam.pipeline.build import build_localizer, build_slam
from jaxslam.pipeline.fusion import with_fused_odometry
from jaxslam.pipeline.inputs import PreparedScans, pair_scans
from jaxslam.preprocess.ranges import correct_scans
from jaxslam.range_network.network import RangeNetwork
from jaxslam.slam.rbpf import RBPF


def prepare(
    log: SensorLog, config: SlamConfig | None = None, *, range_network: RangeNetwork | None = None
) -> tuple[RBPF, PreparedScans]:
    """Correct and thin the scans of a log, fuse odometry and IMU if configured, and build the filter.

    If odometry is fused, `GaussianMotion` moves the particles with the fused covariance.

    Args:
        log: from `read_log` or the simulator.
        config: configuration; None for the defaults. If `config.lidar` is None, the lidar preset is detected
            from the scans.
        range_network: network that corrects the ranges of every scan; it becomes part of the filter.

    Returns:
        The filter and the scans, for `run_log` and `run_many`.

    Raises:
        LogError: the log lacks what the configuration needs.
        ValueError: the maps would not fit into memory.
    """
    config = SlamConfig() if config is None else config
    example = "a SlamConfig, such as jaxslam.SlamConfig(num_particles=15)"
    require_types(
        "prepare", log=(log, SensorLog, "the log from jaxslam.read_log"), config=(config, SlamConfig, example)
    )
    require_static_sizes(config)
    lidar = config.lidar or LidarSettings.from_preset(detect_lidar(log))
    log, timing = correct_scans(log, lidar)
    config = replace(config, lidar=lidar)
    scans = replace(pair_scans(log, config.thinning), timing=timing, config=config)
    motion = config.motion
    can_be_fused = log.imu is not None and turning_is_known(log.imu)
    if config.fusion.use == "on" or (config.fusion.use == "auto" and can_be_fused):
        scans = with_fused_odometry(scans, log, config.fusion)
        # Only GaussianMotion uses the fused covariance; the other models describe the noise of wheels.
        motion = motion if isinstance(motion, GaussianMotion) else GaussianMotion()
    return build_slam(replace(config, motion=motion), scans.odometry_bounds, range_network), scans


def prepare_localization(
    log: SensorLog,
    map: OccupancyMap,
    config: LocalizationConfig | None = None,
    *,
    range_network: RangeNetwork | None = None,
) -> tuple[AMCL, PreparedScans]:
    """Correct and thin the scans of a log, and build the localization filter on a map.

    Args:
        log: from `read_log` or the simulator.
        map: known map, from `jaxslam.io.read_map` or `RunResult.occupancy`.
        config: configuration; None for the defaults. If `config.lidar` is None, the lidar preset is detected
            from the scans.
        range_network: network that corrects the ranges of every scan; it becomes part of the filter.

    Returns:
        The filter and the scans, for `localize_log`.

    Raises:
        LogError: the log lacks scans or odometry.
        ValueError: the map has no obstacle or no free space, or the filter would not fit into memory.
    """
    config = LocalizationConfig() if config is None else config
    require_types(
        "prepare_localization",
        log=(log, SensorLog, "the log from jaxslam.read_log"),
        map=(map, OccupancyMap, "the map from jaxslam.io.read_map"),
        config=(config, LocalizationConfig, "a LocalizationConfig"),
    )
    require_static_sizes(config)
    lidar = config.lidar or LidarSettings.from_preset(detect_lidar(log))
    log, timing = correct_scans(log, lidar)
    scans = replace(pair_scans(log, config.thinning), timing=timing, config=replace(config, lidar=lidar))
    return build_localizer(config, map, range_network), scans
