"""Faults that an asset cannot monitor, without the sensor or by its settings."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from executive.faults import Reaction
from executive.safety.motion_history import MotionHistory
from executive.settings import LocomotionKind, Settings


@dataclass(frozen=True, slots=True)
class Unmonitored:
    """A quantity that is not monitored.

    Attributes:
        what: its name, for display, without a verb.
        why: the missing sensor or the setting.
        faults: the faults of the table that cannot begin.
    """

    what: str
    why: str
    faults: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.what} is not monitored: {self.why}"


_BY_JOINTS_AND_IMU = ("wheels_off_gyro", "wheels_slip", "blocked")
NO_JOINTS = Unmonitored(
    "wheel motion",
    "no wheel sensors",
    (
        *("wheels_off_command", "wheels_off_command_slowly", "wheels_unpowered"),
        "odometry_off_wheels",
        *_BY_JOINTS_AND_IMU,
    ),
)
NO_IMU = Unmonitored(
    "wheel spin",
    "no IMU",
    ("odometry_off_gyro", *_BY_JOINTS_AND_IMU, "tilted_by_imu"),
)
NO_SECOND_ODOMETRY = Unmonitored(
    "slip",
    "no second odometry",
    ("slips", "turn_slips", "slides"),
)
NO_LASER = Unmonitored(
    "the path ahead", "no laser", ("obstacle_ahead", "obstacle_near", "laser_blind")
)
NO_MASS = Unmonitored("pushing against an obstacle", "mass_kg is not given", ("blocked",))
NO_LEAN = Unmonitored(
    "wheel spin and tilt by the IMU",
    "it measures no orientation",
    ("wheels_slip", "tilted_by_imu"),
)
NO_TORQUES = Unmonitored(
    "the motors", "joint states have no efforts", ("wheels_unpowered", "blocked")
)
NO_VOLTAGE = Unmonitored("the battery", "no voltage received", ("battery_low", "battery_silent"))
NO_CHARGE = Unmonitored("charge for the return", "the battery reports no charge", ())
WHOLE_MOTION = Unmonitored(
    "uncommanded motion",
    "another link may command it without the executive",
    ("drives_uncommanded", "turns_uncommanded"),
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
    return found if history is None else (*found, *_unmeasured(settings, history))


def summary(gaps: Iterable[Unmonitored]) -> str:
    """Return the unmonitored quantities in one line, grouped by cause."""
    by_why: dict[str, list[str]] = {}
    for each in gaps:
        by_why.setdefault(each.why, []).append(each.what)
    parts = (f"{', '.join(what)} ({why})" for why, what in by_why.items())
    return "; ".join(parts) or "nothing"


def _unmeasured(settings: Settings, history: MotionHistory) -> Iterator[Unmonitored]:
    inertia, wheels = history.inertia, history.wheels
    if inertia is not None and not inertia.leans:
        yield NO_LEAN
    if wheels is not None and wheels.count and not wheels.torques:
        yield NO_TORQUES
    if history.battery is None:
        yield NO_VOLTAGE
    if settings.battery is not None and history.charge_ratio is None:
        yield NO_CHARGE


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
        yield replace(NO_LASER, why="footprint is not given")
    if sensors.joints is not None and sensors.imu is not None and settings.mass_kg is None:
        yield NO_MASS
    if settings.locomotion is LocomotionKind.WHOLE_MOTION:
        yield WHOLE_MOTION
    for declared, row in settings.faults:
        if row.then is Reaction.IGNORE:
            yield Unmonitored(declared.name, "its reaction is ignore", (declared.name,))
