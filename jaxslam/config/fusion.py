"""What is fused, and how."""

import equinox as eqx

from jaxslam.core.validation import require_one_of
from jaxslam.fusion.ekf import EKF
from jaxslam.fusion.imu import AXES
from jaxslam.fusion.stream import ImuNoise, OdometerNoise


class FusionSettings(eqx.Module):
    """Wheel odometry and IMU fused before the particle filter.

    Attributes:
        use: "off": the wheels alone; "auto": fused where the log has an IMU that turns; "on": fused, and a
            log without is refused (static).
        yaw_axis: of the IMU that points up: x, y, z, -x, -y or -z; "auto" is from the log, or gravity
            (static).
        read_poses: read the odometry's pose as well as its rates, as the paper has it (static).
        read_headings: read the IMU's heading as well as its rate; it may be a compass beside iron (static).
        ekf: the filter.
        odometer: noise of the wheels.
        imu: noise of the IMU.
    """

    use: str = eqx.field(static=True, default="off")
    yaw_axis: str = eqx.field(static=True, default="auto")
    read_poses: bool = eqx.field(static=True, default=False)
    read_headings: bool = eqx.field(static=True, default=False)
    ekf: EKF = EKF()
    odometer: OdometerNoise = OdometerNoise()
    imu: ImuNoise = ImuNoise()

    def __check_init__(self):
        require_one_of(self, "use", ("off", "auto", "on"))
        require_one_of(self, "yaw_axis", ("auto", *AXES))
