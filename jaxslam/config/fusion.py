"""Settings for the fusion of wheel odometry and IMU."""

import equinox as eqx

from jaxslam.core.validation import require_one_of
from jaxslam.fusion.ekf import EKF
from jaxslam.fusion.imu import AXES
from jaxslam.fusion.stream import ImuNoise, OdometerNoise


class FusionSettings(eqx.Module):
    """Fusion of wheel odometry and IMU, before the particle filter.

    Attributes:
        use: "off" uses the wheel odometry alone. "auto" fuses if the log has an IMU that measures angular
            velocity. "on" always fuses, and a log without an IMU is an error (static).
        yaw_axis: IMU axis that points up: x, y, z, -x, -y or -z. "auto" takes the axis from the log or from
            gravity (static).
        read_poses: Use the poses of the odometry in addition to its velocities, as Liang et al. do (static).
        read_headings: Use the heading of the IMU in addition to its yaw rate. A compass near iron makes the
            heading unreliable (static).
        ekf: Kalman filter that fuses the readings.
        odometer: Noise of the wheel odometry.
        imu: Noise of the IMU.
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
