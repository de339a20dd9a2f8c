"""Interfaces of robots on ROS 2, as their makers publish them, with their limits and habits.

The motion is simple (motors with lag and limits, slip); the interface is what is accurate here.
Each is modelled on the public configuration of its maker, named beside it.
"""

from dataclasses import dataclass
from math import inf
from typing import Final

Names = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Velocities:
    """The topic that a base takes velocities from.

    Attributes:
        timeout_s: after the last velocity, it stops.
        age_checked: a stamped velocity older than the time-out is ignored (diff_drive_controller).
        quantum: a velocity is cut to a multiple of it.
    """

    topic: str = "cmd_vel"
    stamped: bool = True
    timeout_s: float = 0.5
    age_checked: bool = True
    quantum: float = 0.0


@dataclass(frozen=True, slots=True)
class Base:
    """How a base moves.

    Attributes:
        lag_s, dead_s: of the motors, and of the bus to them.
        slip: share of the way of the wheels that is lost.
        turn_slip: share of the turn of the wheels that is lost.
        wheelbase_m, steer_max_rad, steer_rate_radps: of a car; 0 for one that turns on the spot.
        backward_m: it drives backward over so much ground that it has not seen.
    """

    travel_mps: float = 1.0
    rotate_radps: float = 2.0
    travel_mps2: float = 2.0
    rotate_radps2: float = 4.0
    lag_s: float = 0.08
    dead_s: float = 0.02
    slip: float = 0.01
    turn_slip: float = 0.0
    wheelbase_m: float = 0.0
    steer_max_rad: float = 0.6
    steer_rate_radps: float = 1.5
    backward_m: float = inf


@dataclass(frozen=True, slots=True)
class OdometrySource:
    """Odometry of a robot.

    Attributes:
        mean_of: its twist is a mean over so many samples (velocity_rolling_window_size).
        gyro: its turn is that of a gyro, by an EKF or by the driver.
        age_s, jitter_s: by which it comes after its stamp.
        unwrapped: its rate is a difference of headings that is not wrapped.
    """

    topic: str = "odom"
    rate_hz: float = 50.0
    best_effort: bool = False
    frame: str = "odom"
    child: str = "base_link"
    mean_of: int = 1
    gyro: bool = False
    age_s: float = 0.0
    jitter_s: float = 0.0
    noise_m: float = 0.0
    unwrapped: bool = False


@dataclass(frozen=True, slots=True)
class ImuSource:
    """An IMU; without `oriented` its orientation is (0, 0, 0, 1) with zero covariance."""

    topic: str
    rate_hz: float = 100.0
    best_effort: bool = True
    oriented: bool = True


@dataclass(frozen=True, slots=True)
class JointSource:
    """Joint states of the wheels."""

    left: Names
    right: Names
    wheel_radius_m: float
    track_m: float
    topic: str = "joint_states"
    rate_hz: float = 50.0


@dataclass(frozen=True, slots=True)
class BatterySource:
    """A battery: a BatteryState, or its voltage as Float32."""

    topic: str
    voltage_v: float
    charge_ratio: float = 0.8
    rate_hz: float = 1.0
    best_effort: bool = True
    voltage_only: bool = False


@dataclass(frozen=True, slots=True)
class CameraSource:
    """A camera with raw pictures."""

    topic: str
    width_px: int = 320
    height_px: int = 240
    encoding: str = "rgb8"


@dataclass(frozen=True, slots=True)
class EmergencyStopSource:
    """An emergency stop, told as Bool.

    Attributes:
        latched: transient local.
        at_start: active at power-on.
        trigger, reset: services; none if empty.
    """

    topic: str
    latched: bool = False
    at_start: bool = False
    trigger: str = ""
    reset: str = ""


@dataclass(frozen=True, slots=True)
class Localization:
    """A localisation: odometry on /tf instead of its topic, and the map's transform, which jumps.

    Attributes:
        first, then: pose of odom in the map, in m and rad, before and after the jump.
        jump_m: the way of the rover after which it jumps.
        lose: a service after which it says nothing more.
    """

    first: tuple[float, float, float] = (10.0, 5.0, 1.5)
    then: tuple[float, float, float] = (10.1, 5.1, 1.6)
    jump_m: float = 0.5
    rate_hz: float = 10.0
    lose: str = "lose_localization"


@dataclass(frozen=True, slots=True)
class Interface:
    """A robot as it looks from ROS; a sensor that it has not is None."""

    about: str
    namespace: str = ""
    velocities: Velocities = Velocities()
    base: Base = Base()
    odometry: OdometrySource = OdometrySource()
    imu: ImuSource | None = None
    joints: JointSource | None = None
    battery: BatterySource | None = None
    camera: CameraSource | None = None
    emergency_stop: EmergencyStopSource | None = None
    scan_hz: float = 0.0
    localization: Localization | None = None


_TURTLEBOT4_ODOMETRY: Final = OdometrySource(rate_hz=20.0, best_effort=True, gyro=True, age_s=0.02)
_J100_BASE: Final = Base(2.0, 4.0, 20.0, 25.0, turn_slip=0.03)
_J100_JOINTS: Final = JointSource(
    ("front_left_wheel_joint", "rear_left_wheel_joint"),
    ("front_right_wheel_joint", "rear_right_wheel_joint"),
    wheel_radius_m=0.098,
    track_m=0.563,
    topic="platform/joint_states",
)

INTERFACES: Final = {
    # clearpath_common (j100/control.yaml, twist_mux.yaml, localization.yaml) and the Jazzy platform
    # API of its documentation: stamped velocities, a namespace, the stop that its MCU reports.
    "clearpath_j100": Interface(
        "Clearpath Jackal J100 on Jazzy, with its EKF",
        namespace="j100_0001",
        base=_J100_BASE,
        odometry=OdometrySource("platform/odom/filtered", gyro=True, noise_m=0.00005),
        imu=ImuSource("sensors/imu_0/data"),
        joints=_J100_JOINTS,
        battery=BatterySource("platform/bms/state", 26.4),
        camera=CameraSource("sensors/camera_0/color/image"),
        emergency_stop=EmergencyStopSource("platform/emergency_stop"),
    ),
    # Its wheels alone, by diff_drive_controller: the twist is a mean over 10 samples.
    "j100_wheels": Interface(
        "Clearpath Jackal J100 on Jazzy, without its EKF",
        namespace="j100_0001",
        base=Base(2.0, 4.0, 20.0, 25.0, turn_slip=0.1),
        odometry=OdometrySource("platform/odom", mean_of=10),
        imu=ImuSource("sensors/imu_0/data"),
        joints=_J100_JOINTS,
        battery=BatterySource("platform/bms/state", 26.4),
        camera=CameraSource("sensors/camera_0/color/image"),
        emergency_stop=EmergencyStopSource("platform/emergency_stop"),
    ),
    # create3_docs (ROS 2 API, odometry, safety, reflexes): 20 Hz, best effort, limit of backing up.
    "turtlebot4": Interface(
        "TurtleBot 4 on the Create 3",
        velocities=Velocities(stamped=False, age_checked=False),
        base=Base(0.306, 1.9, 0.9, 7.0, backward_m=0.15),
        odometry=_TURTLEBOT4_ODOMETRY,
        imu=ImuSource("imu"),
        battery=BatterySource("battery_state", 15.8, rate_hz=0.2),
        camera=CameraSource("oakd/rgb/preview/image_raw", 250, 250, "bgr8"),
        scan_hz=7.0,
    ),
    # The same with a localisation, such as slam_toolbox, and without a topic of its odometry.
    "localized": Interface(
        "a robot that is known by tf2",
        velocities=Velocities(stamped=False, age_checked=False),
        base=Base(0.306, 1.9, 0.9, 7.0, backward_m=0.15),
        odometry=_TURTLEBOT4_ODOMETRY,
        battery=BatterySource("battery_state", 15.8, rate_hz=0.2),
        localization=Localization(),
    ),
    # turtlebot3_node (enable_stamped_cmd_vel): velocities cut to 0.01, odometry from joints and the
    # heading of the IMU.
    "turtlebot3": Interface(
        "TurtleBot 3 burger on Jazzy",
        velocities=Velocities(age_checked=False, quantum=0.01),
        base=Base(0.22, 2.84, 0.7, 6.0),
        odometry=OdometrySource(
            rate_hz=25.0, child="base_footprint", gyro=True, jitter_s=0.006, unwrapped=True
        ),
        imu=ImuSource("imu", rate_hz=25.0, best_effort=False),
        joints=JointSource(
            ("wheel_left_joint",), ("wheel_right_joint",), 0.033, 0.16, rate_hz=25.0
        ),
        battery=BatterySource("battery_state", 12.1, 0.9, rate_hz=10.0, best_effort=False),
        camera=CameraSource("image_raw", encoding="bgr8"),
        scan_hz=5.0,
    ),
    # husarion_ugv_ros (WH01_controller.yaml, ROS_API.md): time-out 0.2 s, stopped at power-on.
    "panther": Interface(
        "Husarion Panther on Jazzy",
        namespace="panther",
        velocities=Velocities(timeout_s=0.2),
        base=Base(2.0, 4.0, 2.7, 5.74, turn_slip=0.08),
        odometry=OdometrySource("odometry/filtered", gyro=True, noise_m=0.00005),
        imu=ImuSource("imu/data"),
        joints=JointSource(
            ("fl_wheel_joint", "rl_wheel_joint"),
            ("fr_wheel_joint", "rr_wheel_joint"),
            wheel_radius_m=0.1825,
            track_m=1.05,
            rate_hz=100.0,
        ),
        battery=BatterySource("battery/battery_status", 38.0, best_effort=False),
        camera=CameraSource("camera/color/image_raw"),
        emergency_stop=EmergencyStopSource(
            "hardware/e_stop",
            latched=True,
            at_start=True,
            trigger="hardware/e_stop_trigger",
            reset="hardware/e_stop_reset",
        ),
    ),
    # leo_fw (firmware_message_converter.cpp), leo_bringup: no orientation, the battery a Float32.
    "leo": Interface(
        "Leo Rover",
        velocities=Velocities(stamped=False, age_checked=False),
        base=Base(0.4, 1.0, 1.5, turn_slip=0.1),
        odometry=OdometrySource("wheel_odom_with_covariance", rate_hz=20.0),
        imu=ImuSource("imu/data_raw", best_effort=False, oriented=False),
        joints=JointSource(
            ("wheel_FL_joint", "wheel_RL_joint"),
            ("wheel_FR_joint", "wheel_RR_joint"),
            wheel_radius_m=0.0625,
            track_m=0.63,
            rate_hz=20.0,
        ),
        battery=BatterySource("firmware/battery", 11.8, voltage_only=True),
        camera=CameraSource("camera/image_raw", 640, 480),
    ),
    # rosbot_ros (mecanum_drive_controller.yaml): 20 Hz.
    "rosbot_xl": Interface(
        "Husarion ROSbot XL",
        base=Base(0.9, 3.0, 1.0, 4.0, slip=0.04),
        odometry=OdometrySource("rosbot_base_controller/odom", rate_hz=20.0),
        imu=ImuSource("imu_broadcaster/imu", rate_hz=20.0),
    ),
    # ackermann_steering_controller of ros2_controllers: it does not turn on the spot.
    "ackermann": Interface(
        "a car, least turning radius 0.6 m",
        velocities=Velocities("ackermann_steering_controller/reference", timeout_s=1.0),
        base=Base(1.5, 2.5, wheelbase_m=0.4, steer_max_rad=0.588),
        odometry=OdometrySource("ackermann_steering_controller/odometry", mean_of=10),
    ),
    # diff_drive_controller on tracks that slip.
    "tracked": Interface(
        "a tracked carrier with much slip, odometry by its tracks",
        velocities=Velocities("diff_cont/cmd_vel"),
        base=Base(0.8, 1.2, 1.0, 2.0, lag_s=0.25, slip=0.06, turn_slip=0.35),
        odometry=OdometrySource("diff_cont/odom", mean_of=10),
        imu=ImuSource("imu/data"),
    ),
}
