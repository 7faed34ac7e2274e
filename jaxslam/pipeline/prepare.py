"""From a log and a configuration to a filter and what it runs over."""

from dataclasses import dataclass, replace

from jaxslam.config.slam import SlamConfig
from jaxslam.fusion import Fused, YawTrack, tells_turning
from jaxslam.io.log import SensorLog
from jaxslam.motion import GaussianMotion
from jaxslam.pipeline.build import build
from jaxslam.pipeline.fusion import with_fused_odometry
from jaxslam.pipeline.inputs import PreparedInputs, prepare_inputs
from jaxslam.preprocess.deskew import SweepTiming
from jaxslam.preprocess.ranges import correct_scans
from jaxslam.range_network.network import RangeNetwork
from jaxslam.slam.rbpf import RBPF


@dataclass(frozen=True)
class Prepared:
    """All that `run_log` needs, and how it came about.

    Attributes:
        slam: the filter, its maps sized for the log.
        inputs: the log made ready for it.
        timing: of the scans against the odometry; None where the log cannot tell.
        fused: odometry and IMU at the processed scans; None where the wheels move the particles.
        yaw: how the IMU was read for that.
    """

    slam: RBPF
    inputs: PreparedInputs
    timing: SweepTiming | None = None
    fused: Fused | None = None
    yaw: YawTrack | None = None

    def __repr__(self) -> str:
        grid = self.slam.grid
        maps = f"maps of {grid.width} × {grid.height} cells of {float(grid.resolution):.3g} m"
        parts = [f"{self.slam.num_particles} particles", maps, repr(self.inputs)]
        parts += [f"fused with {self.fused.readings['imu']} IMU readings"] if self.fused is not None else []
        return f"Prepared({', '.join(parts)})"


def prepare(log: SensorLog, configuration: SlamConfig, range_network: RangeNetwork | None = None) -> Prepared:
    """Corrects and thins the scans, fuses odometry and IMU if asked to, and sizes the filter's maps.

    Where odometry is fused, `GaussianMotion` moves the particles, by the fused covariance. A range
    network, if given, becomes a part of the filter.

    Raises:
        LogError: the log lacks what the configuration needs.
        ValueError: the maps would not fit into memory.
    """
    log, timing = correct_scans(log, configuration.lidar)
    inputs, fused, yaw = prepare_inputs(log, configuration.thinning), None, None
    if _is_fused(log, configuration.fusion.use):
        inputs, fused, yaw = with_fused_odometry(inputs, log, configuration.fusion)
        if not isinstance(configuration.motion, GaussianMotion):
            # The others know the noise of wheels, and not what the fused covariance says.
            configuration = replace(configuration, motion=GaussianMotion())
    return Prepared(build(configuration, inputs.odometry_bounds, range_network), inputs, timing, fused, yaw)


def _is_fused(log: SensorLog, use: str) -> bool:
    return use == "on" or (use == "auto" and log.imu is not None and tells_turning(log.imu))
