"""`unmonitored`: the faults that an asset cannot detect, by a missing sensor or by its settings."""

from collections.abc import Iterator
from dataclasses import replace

from executive.faults import Reaction, Unmonitored
from executive.safety.motion_history import MotionHistory
from executive.settings import LocomotionKind, NavigationGate, Settings, TurnSource

_BY_JOINTS_AND_IMU = ("wheels_off_gyro", "wheel_slip", "motion_blocked")
NO_JOINTS = Unmonitored(
    "wheel motion",
    "no wheel sensors",
    (
        *("wheels_off_command", "wheel_travel_off_command", "wheels_unpowered"),
        "odometry_off_wheels",
        *_BY_JOINTS_AND_IMU,
    ),
)
NO_IMU = Unmonitored(
    "wheel spin",
    "no IMU",
    ("odometry_off_gyro", *_BY_JOINTS_AND_IMU, "tilt_limit_imu"),
)
NO_SECOND_ODOMETRY = Unmonitored(
    "slip",
    "no second odometry",
    ("travel_slip", "turn_slip", "slide_at_rest"),
)
NO_LASER = Unmonitored(
    "the path ahead", "no laser", ("obstacle_ahead", "obstacle_near", "laser_blind")
)
NO_MASS = Unmonitored("pushing against an obstacle", "mass_kg is not given", ("motion_blocked",))
NO_LEAN = Unmonitored(
    "wheel spin and tilt by the IMU",
    "it measures no orientation",
    ("wheel_slip", "tilt_limit_imu"),
)
NO_ACCELERATION = Unmonitored(
    "wheel spin by the IMU", "it measures no acceleration", ("wheel_slip", "motion_blocked")
)
LATE_TWIST = Unmonitored(
    "sliding with stationary wheels", "the odometry's velocity is late (twist_mean_s)", ()
)
NO_TORQUES = Unmonitored(
    "the motors", "joint states have no efforts", ("wheels_unpowered", "motion_blocked")
)
NO_VOLTAGE = Unmonitored("the battery", "no voltage received", ("battery_low", "battery_silent"))
NO_CHARGE = Unmonitored("charge for the return", "the battery reports no charge", ())
NO_EMERGENCY_STOP = Unmonitored(
    "the robot's emergency stop", "no state received", ("emergency_stop",)
)
GYRO_HEADING = Unmonitored(
    "a drift of the gyro while driving", "the heading is the gyro's (odometry.turn)", ()
)
NAVIGATED = Unmonitored(
    "commanded against measured motion while the navigation drives",
    "its velocity does not pass the executive (navigation.gate is lock)",
    (
        *("off_command", "turn_off_command", "turn_angle_off_command", "no_progress"),
        *("odometry_frozen", "wheels_off_command", "wheel_travel_off_command", "wheels_unpowered"),
    ),
)
WHOLE_MOTION = Unmonitored(
    "uncommanded motion",
    "another link may command it without the executive",
    ("uncommanded_travel", "uncommanded_turn"),
)


def unmonitored(
    settings: Settings, history: MotionHistory | None = None
) -> tuple[Unmonitored, ...]:
    """Return the quantities that an asset does not monitor, missing sensors first.

    Args:
        settings: of the asset.
        history: if given, adds the quantities that its sensors do not measure.
    """
    found = tuple(_unmonitored(settings))
    return found if history is None else (*found, *_missing_sensors(settings, history))


def _missing_sensors(settings: Settings, history: MotionHistory) -> Iterator[Unmonitored]:
    inertia, wheels = history.inertia, history.wheels
    if inertia is not None and not inertia.leans:
        yield NO_LEAN
    if inertia is not None and not inertia.feels:
        yield NO_ACCELERATION
    if inertia is not None and history.over_ground is None:
        yield LATE_TWIST
    if wheels is not None and wheels.count and not wheels.torques:
        yield NO_TORQUES
    if history.battery is None:
        yield NO_VOLTAGE
    if settings.battery is not None and history.charge_ratio is None:
        yield NO_CHARGE
    if history.emergency_stop is None:
        yield NO_EMERGENCY_STOP


def _unmonitored(settings: Settings) -> Iterator[Unmonitored]:
    sensors = settings.sensors
    if sensors.joints is None:
        yield NO_JOINTS
    if sensors.imu is None:
        yield NO_IMU
    if sensors.second_odometry is None:
        yield NO_SECOND_ODOMETRY
    if sensors.laser is None:
        yield NO_LASER
    elif settings.footprint is None:
        yield replace(NO_LASER, cause="footprint is not given")
    if sensors.joints is not None and sensors.imu is not None and settings.mass_kg is None:
        yield NO_MASS
    if settings.odometry.turn is TurnSource.GYRO:
        yield GYRO_HEADING
    if settings.locomotion is LocomotionKind.DELEGATED:
        yield WHOLE_MOTION
    if settings.navigation is not None and settings.navigation.gate is NavigationGate.LOCK:
        yield NAVIGATED
    for declared, row in settings.faults:
        if row.reaction is Reaction.IGNORE:
            yield Unmonitored(declared.name, "its reaction is ignore", (declared.name,))
