"""What can go wrong with a simulated rover: every fault, declared once, and how it is written.

Entries of scenarios, `rover inject`, the service of `rover-sim` and the table in the documentation
follow from these declarations; `sim.rover.body`, `jackal` and `mocup` give them their effect.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from enum import Enum, unique
from math import pi, radians
from typing import Final, NewType, TypeVar, assert_never, dataclass_transform

from executive.commands import Argument, Within, argument, arguments_of, record, within
from executive.settings import (
    FormatError,
    LocomotionKind,
    Sensor,
    Sensors,
    Settings,
    StrictReader,
    angle_of,
    hint,
)

F = TypeVar("F", bound="Fault")


class Fault:
    """What goes wrong, with its parameters; its class is the kind by which it is cleared."""

    __slots__ = ()


@unique
class Part(Enum):
    """What a fault acts on, and a rover need not have."""

    ODOMETRY = "odometry"
    ODOMETRY_LINK = "odometry that comes over a network"
    ENCODERS = "wheel encoders"
    GYRO = "a gyro"
    IMU = "an inertial measurement unit with messages of its own"
    JOINTS = "messages of the wheels"
    SECOND_ODOMETRY = "a second odometry"
    LASER = "a laser"
    CMD_VEL = "velocity commands"
    BATTERY = "a battery voltage"
    CAMERA = "a camera"
    BRICK = "a brick that moves it"
    LINK = "a link to the ground"


@unique
class Onset(Enum):
    """How a fault misleads a motion, by which campaigns group faults."""

    ABRUPT = "abrupt"
    """Data or drive are wrong at once."""
    LATENT = "latent"
    """Data or drive go wrong with the way, the turn or the torque that is needed."""
    GROUND = "ground"
    """The rover moves in another way than its wheels do."""
    NONE = "none"
    """No motion is misled."""


@unique
class Side(Enum):
    """Wheels of one side, or all of them."""

    LEFT = "left"
    RIGHT = "right"
    BOTH = "both"

    @property
    def left(self) -> bool:
        """Whether the left wheels are meant."""
        return self is not Side.RIGHT

    @property
    def right(self) -> bool:
        """Whether the right wheels are meant."""
        return self is not Side.LEFT


Value = float | bool | Side
"""Of a parameter."""
_Angle = NewType("_Angle", float)
_READER: Final = StrictReader({_Angle: angle_of}, units=True)


@dataclass(frozen=True, slots=True, eq=False)
class FaultDeclaration:
    """What is known of a kind of fault.

    Attributes:
        kind: its class.
        name: in files and at the command line.
        needs: what a rover must have for it; None where each rover can have it.
        onset: how it misleads a motion.
        summary: the first line of its docstring.
        parameters: each has bounds, or is a `Side`, or true or false.
    """

    kind: type[Fault]
    name: str
    needs: Part | None
    onset: Onset
    summary: str
    parameters: tuple[Argument, ...]

    def default(self, parameter: Argument) -> Value:
        """Return what a parameter is unless it is given."""
        value: Value = getattr(self.kind(), parameter.field)
        return value

    def make(self, given: Mapping[str, object]) -> Fault:
        """Return the fault with parameters by their names, as files and people write them.

        Raises:
            ValueError: there is no such parameter, or a value is not allowed; the text names it.
        """
        known = {each.name: each for each in self.parameters}
        values: dict[str, Value] = {}
        for name, raw in given.items():
            if name not in known:
                has = f"; known are {', '.join(known)}" if known else ", it has no parameters"
                raise ValueError(f"{self.name}: unknown key {name!r}{hint(name, known)}{has}")
            values[known[name].field] = _value(raw, known[name], f"{self.name}.{name}")
        return self.kind(**values)


_DECLARED: Final[dict[str, FaultDeclaration]] = {}


@dataclass_transform(frozen_default=True, field_specifiers=(argument,))
def fault(needs: Part | None, onset: Onset = Onset.NONE) -> Callable[[type[F]], type[F]]:
    """Make a fault of a class whose fields are `argument(...)`, each with a default."""

    def declare(cls: type[F]) -> type[F]:
        made = record(cls)
        name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", made.__name__).lower()
        assert all(each.default is not MISSING for each in fields(made))  # type: ignore[arg-type]
        summary = (made.__doc__ or "").partition("\n")[0]
        _DECLARED[name] = FaultDeclaration(made, name, needs, onset, summary, arguments_of(made))
        return made

    return declare


@fault(Part.ODOMETRY, Onset.ABRUPT)
class OdometryLost(Fault):
    """No odometry arrives."""


@fault(Part.ODOMETRY, Onset.ABRUPT)
class OdometryFrozen(Fault):
    """Odometry arrives with new stamps, its pose and velocity as they were."""


@fault(Part.ODOMETRY, Onset.ABRUPT)
class OdometryRepeated(Fault):
    """The last odometry message arrives again and again, with its old stamp."""


@fault(Part.ODOMETRY, Onset.ABRUPT)
class OdometryJump(Fault):
    """The pose of the odometry jumps once; clearing it does not jump back."""

    by_m: float = argument(within(10.0), "to the left", default=0.36)


@fault(Part.ODOMETRY, Onset.LATENT)
class OdometryDrift(Fault):
    """The pose of the odometry drifts, its velocity stays right; clearing it ends the drift."""

    rate_mps: float = argument(within(5.0), "to the left", default=0.1)


@fault(Part.ENCODERS, Onset.LATENT)
class EncoderScale(Fault):
    """The wheel encoders count too much or too little."""

    factor: float = argument(within(3.0), "1 is right", default=1.1)
    shared: bool = argument(help="messages of the wheels are wrong, too", default=False)


@fault(Part.GYRO, Onset.LATENT)
class GyroGain(Fault):
    """The gyro measures too much or too little."""

    factor: float = argument(within(3.0), "1 is right", default=1.2)
    shared: bool = argument(help="messages of the IMU are wrong, too", default=False)


@fault(Part.ODOMETRY, Onset.ABRUPT)
class OdometryLate(Fault):
    """Odometry arrives late, with the stamps of when it was measured."""

    by_s: float = argument(within(0.02, 10.0), default=0.2)


@fault(Part.ODOMETRY_LINK)
class OdometryJitter(Fault):
    """Odometry arrives late by chance, in order, as over a busy computer or network."""

    mean_s: float = argument(within(0.0, 1.0), "exponentially distributed", default=0.015)
    stall_s: float = argument(within(0.0, 10.0), "longest pause, every 4 s or so", default=0.18)


@fault(Part.ODOMETRY, Onset.ABRUPT)
class OdometryZeroTwist(Fault):
    """Odometry says that the rover stands; its pose is right."""


@fault(Part.GYRO, Onset.LATENT)
class GyroBias(Fault):
    """The gyro measures a turn that is not there."""

    rate_radps: float = argument(within(3.0), "counter-clockwise positive", default=0.02)
    shared: bool = argument(help="messages of the IMU are wrong, too", default=False)


@fault(Part.GYRO, Onset.LATENT)
class GyroDead(Fault):
    """The gyro measures no turn."""

    shared: bool = argument(help="messages of the IMU are wrong, too", default=False)


@fault(Part.ENCODERS, Onset.ABRUPT)
class EncoderDead(Fault):
    """The encoders of a side count nothing."""

    side: Side = argument(default=Side.BOTH)
    shared: bool = argument(help="messages of the wheels are wrong, too", default=False)


@fault(None, Onset.ABRUPT)
class LeftStuck(Fault):
    """The left wheels are locked."""


@fault(None, Onset.ABRUPT)
class RightStuck(Fault):
    """The right wheels are locked."""


@fault(None, Onset.ABRUPT)
class WheelsStuck(Fault):
    """All wheels are locked."""


@fault(None, Onset.LATENT)
class MotorDead(Fault):
    """The motors of a side have no torque: its wheels roll freely."""

    side: Side = argument(default=Side.BOTH)


@fault(None, Onset.GROUND)
class Slip(Fault):
    """All ground is slippery."""

    factor: float = argument(within(0.01, 1.0), "of the friction that is left", default=0.1)


@fault(Part.CMD_VEL, Onset.ABRUPT)
class CmdVelCut(Fault):
    """Velocity commands do not reach the base."""


@fault(Part.CMD_VEL, Onset.ABRUPT)
class CmdVelTaken(Fault):
    """Somebody else commands a velocity, too; without a mux the newest command counts."""

    travel_mps: float = argument(within(2.0), default=0.5)
    rotate_radps: float = argument(within(4.0), default=0.0)
    rate_hz: float = argument(within(0.1, 50.0), "how often", default=50.0)
    priority: float = argument(
        within(0.0, 255.0), "of its input where the base has a mux", default=10.0
    )


@fault(None, Onset.LATENT)
class Brownout(Fault):
    """The motors have only a part of their torque."""

    factor: float = argument(within(0.0, 1.0), "of the torque that is left", default=0.12)


@fault(None, Onset.ABRUPT)
class Tip(Fault):
    """The rover is tipped over sideways at once; clearing it sets it upright where it lies."""

    by_rad: float = argument(within(pi), "to the right", default=radians(120))


@fault(Part.BATTERY)
class BatteryLow(Fault):
    """The battery shows less than its lowest voltage."""


@fault(Part.BATTERY)
class BatteryDrained(Fault):
    """The battery has lost charge at once; clearing it does not charge it."""

    charge: float = argument(within(0.0, 1.0), "of the whole, at most left", default=0.1)


@fault(Part.BATTERY)
class BatterySilent(Fault):
    """No battery voltage arrives."""


@fault(Part.BATTERY)
class BatteryNan(Fault):
    """The battery voltage is not a number."""


@fault(Part.CAMERA)
class CameraDead(Fault):
    """No picture comes, however often one is asked for."""


@fault(Part.CAMERA)
class CameraStale(Fault):
    """Every picture is that of the moment when the fault began, with its old stamp."""


@fault(Part.CAMERA)
class CameraCut(Fault):
    """Of every JPEG only the first 200 octets arrive."""


@fault(None)
class HeadStuck(Fault):
    """The camera's head does not turn."""


@fault(Part.BRICK, Onset.ABRUPT)
class BrickSilent(Fault):
    """The brick tells nothing, neither telemetry nor replies; it still does what it is told."""


@fault(Part.IMU)
class ImuDead(Fault):
    """No message of the inertial measurement unit arrives."""


@fault(Part.JOINTS)
class JointsDead(Fault):
    """No message of the wheels arrives."""


@fault(Part.SECOND_ODOMETRY)
class SecondOdometryLost(Fault):
    """No message of the second odometry arrives."""


@fault(Part.SECOND_ODOMETRY, Onset.ABRUPT)
class SecondOdometryFrozen(Fault):
    """The second odometry arrives with new stamps, its pose as it was."""


@fault(Part.SECOND_ODOMETRY, Onset.ABRUPT)
class SecondOdometryJump(Fault):
    """The pose of the second odometry jumps once; clearing it does not jump back."""

    by_m: float = argument(within(10.0), "to the left", default=0.36)


@fault(Part.SECOND_ODOMETRY, Onset.LATENT)
class SecondOdometryDrift(Fault):
    """The pose of the second odometry drifts; clearing it ends the drift."""

    rate_mps: float = argument(within(5.0), "to the left", default=0.1)


@fault(Part.LASER)
class LaserDead(Fault):
    """No scan of the laser arrives."""


@fault(Part.LASER)
class LaserBlind(Fault):
    """Rays of the laser measure nothing usable: they are not a number."""

    share: float = argument(within(0.0, 1.0), "of the rays of the sector", default=1.0)
    sector_rad: float = argument(within(0.0, 2 * pi), "its width, about ahead", default=2 * pi)


@fault(None, Onset.GROUND)
class Pushed(Fault):
    """The rover is pushed sideways at once; clearing it does not push it back."""

    by_m: float = argument(within(5.0), "to the left", default=0.5)


@fault(Part.LINK)
class LinkLost(Fault):
    """Nothing passes between ground and rover."""


JACKAL_PARTS: Final = frozenset(
    {
        Part.ODOMETRY,
        Part.ODOMETRY_LINK,
        Part.ENCODERS,
        Part.GYRO,
        Part.CMD_VEL,
        Part.BATTERY,
        Part.CAMERA,
    }
)
MOCUP_PARTS: Final = frozenset(
    {Part.ODOMETRY, Part.ENCODERS, Part.BATTERY, Part.CAMERA, Part.BRICK}
)


SENSOR_PARTS: Final = {
    Sensor.IMU: Part.IMU,
    Sensor.JOINTS: Part.JOINTS,
    Sensor.SECOND_ODOMETRY: Part.SECOND_ODOMETRY,
    Sensor.LASER: Part.LASER,
}
"""What an asset's settings may give a simulated Jackal."""


def declared_faults() -> tuple[FaultDeclaration, ...]:
    """Return all declarations, in their order."""
    return tuple(_DECLARED.values())


def fault_declaration(kind: type[Fault]) -> FaultDeclaration:
    """Return the declaration of a kind of fault."""
    (found,) = (each for each in _DECLARED.values() if each.kind is kind)
    return found


def jackal_parts(sensors: Sensors) -> frozenset[Part]:
    """Return what a simulated Jackal with these sensors has."""
    return JACKAL_PARTS.union(SENSOR_PARTS[each] for each in sensors.present)


def parts_of(settings: Settings) -> frozenset[Part]:
    """Return what the simulated rover of an asset has."""
    match settings.locomotion:
        case LocomotionKind.VELOCITY:
            return jackal_parts(settings.sensors)
        case LocomotionKind.WHOLE_MOTION:
            return MOCUP_PARTS
        case _:
            assert_never(settings.locomotion)


def lacking(kind: type[Fault], parts: frozenset[Part]) -> str | None:
    """Return why a rover with these parts cannot have a fault; None where it can."""
    declaration = fault_declaration(kind)
    if declaration.needs is None or declaration.needs in parts:
        return None
    lacks = f"{declaration.name} needs {declaration.needs.value}, which is not simulated here"
    keys = [sensor.value for sensor, part in SENSOR_PARTS.items() if part is declaration.needs]
    return f"{lacks}: a Jackal has it with settings.sensors.{keys[0]}" if keys else lacks


def read_kind(raw: object) -> FaultDeclaration:
    """Return the declaration of a fault by its name.

    Raises:
        ValueError: there is none of that name; the text says which there are.
    """
    found = _DECLARED.get(raw) if isinstance(raw, str) else None
    if found is None:
        near = hint(raw, _DECLARED)
        raise ValueError(f"{raw!r} is no fault{near}; known are {', '.join(_DECLARED)}")
    return found


def read_fault(raw: object) -> Fault:
    """Return a fault as files write it: `odometry_lost`, or `{odometry_jump: {by: 0.5}}`.

    Raises:
        ValueError: there is no such fault, or it cannot have such parameters.
    """
    name, given = next(iter(raw.items())) if isinstance(raw, dict) and len(raw) == 1 else (raw, {})
    declaration = read_kind(name)
    if not isinstance(given, dict):
        raise ValueError(f"{name}: expected parameters and values, got {given!r}")
    return declaration.make(given)


def written(fault: Fault) -> dict[str, dict[str, float | bool | str]]:
    """Return what `read_fault` reads."""
    declaration, plain = fault_declaration(type(fault)), _READER.plain(fault)
    return {declaration.name: {each.name: plain[each.field] for each in declaration.parameters}}


def _value(raw: object, parameter: Argument, path: str) -> Value:
    is_angle = parameter.unit.startswith("rad")
    value: Value = _READER.read(raw, _Angle if is_angle else parameter.kind, path)
    if isinstance(value, Side) or parameter.bound is None:
        return value
    least, most = bounds(parameter)
    if not least <= value <= most:
        figures = f"{value:g} is not in {least:g} .. {most:g}"
        raise FormatError(path, f"{figures} {parameter.unit}".rstrip())
    return value


def bounds(parameter: Argument) -> tuple[float, float]:
    """Return the least and the greatest value of a parameter that is a figure."""
    bound = parameter.bound
    assert isinstance(bound, Within)
    assert isinstance(bound.high, float)
    low = -bound.high if bound.low is None else bound.low
    assert isinstance(low, float)
    return low, bound.high
