"""Faults of a simulated rover: each one is declared once, with its written form.

Entries of scenarios, `rover inject`, the service of `rover-sim` and the table in the documentation
are derived from these declarations; `sim.rover.body`, `jackal` and `mocup` implement their effect.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from enum import Enum, unique
from math import pi, radians
from typing import Any, Final, NewType, TypeVar, Union, assert_never, dataclass_transform

from cattrs.strategies import configure_tagged_union

from executive.commands import Argument, ValueRange, argument, arguments_of, bounded, record
from executive.settings import (
    FormatError,
    LocomotionKind,
    Sensor,
    Sensors,
    Settings,
    StrictReader,
    angle_of,
    suggestion,
)
from sim.checkpoint import CONVERTER

F = TypeVar("F", bound="SimulatedFault")


class SimulatedFault:
    """A fault with its parameters; it is cleared by its class."""

    __slots__ = ()


@unique
class FaultTarget(Enum):
    """Part that a fault acts on, and that a rover may lack."""

    ODOMETRY = "odometry"
    ODOMETRY_LINK = "odometry over a network"
    ENCODERS = "wheel encoders"
    GYRO = "a gyro"
    CMD_VEL = "velocity commands"
    BATTERY = "a battery voltage"
    CAMERA = "a camera"
    BRICK = "a brick that moves it"
    LINK = "a link to the ground"


Part = FaultTarget | Sensor
"""A part of a simulated rover; a Jackal has the sensors of its settings."""


@unique
class Onset(Enum):
    """How a fault misleads a motion; campaigns group faults by it."""

    ABRUPT = "abrupt"
    """Data or drive are wrong at once."""
    LATENT = "latent"
    """The error of data or drive grows with distance, rotation or required torque."""
    GROUND = "ground"
    """The motion of the rover differs from that of its wheels."""
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
        """Whether the left wheels are included."""
        return self is not Side.RIGHT

    @property
    def right(self) -> bool:
        """Whether the right wheels are included."""
        return self is not Side.LEFT


Value = float | bool | Side
"""Value of a parameter."""
_Angle = NewType("_Angle", float)
_READER: Final = StrictReader({_Angle: angle_of}, units=True)


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedFaultDeclaration:
    """Declaration of a kind of fault.

    Attributes:
        kind: its class.
        name: its name in files and at the command line.
        needs: the part that a rover needs for it; None if every rover can have it.
        onset: how it misleads a motion.
        summary: first line of its docstring.
        parameters: each has bounds, or is a `Side` or a Boolean.
    """

    kind: type[SimulatedFault]
    name: str
    needs: Part | None
    onset: Onset
    summary: str
    parameters: tuple[Argument, ...]

    def default(self, parameter: Argument) -> Value:
        """Return the default of a parameter."""
        value: Value = getattr(self.kind(), parameter.field)
        return value

    def make(self, given: Mapping[str, object]) -> SimulatedFault:
        """Return the fault with parameters by their names, as written in files and commands.

        Raises:
            ValueError: a parameter is unknown, or a value is invalid; the text names it.
        """
        known = {each.name: each for each in self.parameters}
        values: dict[str, Value] = {}
        for name, raw in given.items():
            if name not in known:
                has = f"; known are {', '.join(known)}" if known else ", it has no parameters"
                raise ValueError(f"{self.name}: unknown key {name!r}{suggestion(name, known)}{has}")
            values[known[name].field] = _value(raw, known[name], f"{self.name}.{name}")
        return self.kind(**values)


_DECLARED: Final[dict[str, SimulatedFaultDeclaration]] = {}


@dataclass_transform(frozen_default=True, field_specifiers=(argument,))
def fault(needs: Part | None, onset: Onset = Onset.NONE) -> Callable[[type[F]], type[F]]:
    """Declare a class as a fault; its fields are `argument(...)`, each with a default."""

    def declare(cls: type[F]) -> type[F]:
        made = record(cls)
        name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", made.__name__).lower()
        assert all(each.default is not MISSING for each in fields(made))  # type: ignore[arg-type]
        summary = (made.__doc__ or "").partition("\n")[0]
        _DECLARED[name] = SimulatedFaultDeclaration(
            made, name, needs, onset, summary, arguments_of(made)
        )
        return made

    return declare


@fault(FaultTarget.ODOMETRY, Onset.ABRUPT)
class OdometryLost(SimulatedFault):
    """No odometry arrives."""


@fault(FaultTarget.ODOMETRY, Onset.ABRUPT)
class OdometryFrozen(SimulatedFault):
    """Odometry arrives with new stamps, its pose and velocity as they were."""


@fault(FaultTarget.ODOMETRY, Onset.ABRUPT)
class OdometryRepeated(SimulatedFault):
    """The last odometry message arrives repeatedly, with its old stamp."""


@fault(FaultTarget.ODOMETRY, Onset.ABRUPT)
class OdometryJump(SimulatedFault):
    """The pose of the odometry jumps once; clearing it does not jump back."""

    by_m: float = argument(bounded(10.0), "to the left", default=0.36)


@fault(FaultTarget.ODOMETRY, Onset.LATENT)
class OdometryDrift(SimulatedFault):
    """The pose of the odometry drifts, its velocity stays right; clearing it ends the drift."""

    rate_mps: float = argument(bounded(5.0), "to the left", default=0.1)


@fault(FaultTarget.ENCODERS, Onset.LATENT)
class EncoderScale(SimulatedFault):
    """The wheel encoders count too much or too little."""

    factor: float = argument(bounded(3.0), "1 is right", default=1.1)
    shared: bool = argument(help="messages of the wheels are wrong, too", default=False)


@fault(FaultTarget.GYRO, Onset.LATENT)
class GyroGain(SimulatedFault):
    """The gyro measures too much or too little."""

    factor: float = argument(bounded(3.0), "1 is right", default=1.2)
    shared: bool = argument(help="messages of the IMU are wrong, too", default=False)


@fault(FaultTarget.ODOMETRY, Onset.ABRUPT)
class OdometryLate(SimulatedFault):
    """Odometry arrives late, with the stamps of when it was measured."""

    by_s: float = argument(bounded(0.02, 10.0), default=0.2)


@fault(FaultTarget.ODOMETRY_LINK)
class OdometryJitter(SimulatedFault):
    """Odometry arrives late by chance, in order, as over a busy computer or network."""

    mean_s: float = argument(bounded(0.0, 1.0), "exponentially distributed", default=0.015)
    stall_s: float = argument(bounded(0.0, 10.0), "maximum pause, every 4 s or so", default=0.18)


@fault(FaultTarget.ODOMETRY, Onset.ABRUPT)
class OdometryZeroTwist(SimulatedFault):
    """Odometry reports zero velocity; its pose is right."""


@fault(FaultTarget.GYRO, Onset.LATENT)
class GyroBias(SimulatedFault):
    """The gyro measures a turn that is not there."""

    rate_radps: float = argument(bounded(3.0), "counter-clockwise positive", default=0.02)
    shared: bool = argument(help="messages of the IMU are wrong, too", default=False)


@fault(FaultTarget.GYRO, Onset.LATENT)
class GyroDead(SimulatedFault):
    """The gyro measures no turn."""

    shared: bool = argument(help="messages of the IMU are wrong, too", default=False)


@fault(FaultTarget.ENCODERS, Onset.ABRUPT)
class EncoderDead(SimulatedFault):
    """The encoders of a side count nothing."""

    side: Side = argument(default=Side.BOTH)
    shared: bool = argument(help="messages of the wheels are wrong, too", default=False)


@fault(None, Onset.ABRUPT)
class LeftWheelsStuck(SimulatedFault):
    """The left wheels are locked."""


@fault(None, Onset.ABRUPT)
class RightWheelsStuck(SimulatedFault):
    """The right wheels are locked."""


@fault(None, Onset.ABRUPT)
class WheelsStuck(SimulatedFault):
    """All wheels are locked."""


@fault(None, Onset.LATENT)
class MotorDead(SimulatedFault):
    """The motors of a side have no torque: its wheels roll freely."""

    side: Side = argument(default=Side.BOTH)


@fault(None, Onset.GROUND)
class LowFriction(SimulatedFault):
    """All ground is slippery."""

    factor: float = argument(bounded(0.01, 1.0), "of the friction that is left", default=0.1)


@fault(FaultTarget.CMD_VEL, Onset.ABRUPT)
class CmdVelLost(SimulatedFault):
    """Velocity commands do not reach the base."""


@fault(FaultTarget.CMD_VEL, Onset.ABRUPT)
class CmdVelOverridden(SimulatedFault):
    """Another publisher commands a velocity, too; without a mux the newest command counts."""

    travel_mps: float = argument(bounded(2.0), default=0.5)
    rotate_radps: float = argument(bounded(4.0), default=0.0)
    rate_hz: float = argument(bounded(0.1, 50.0), "how often", default=50.0)
    priority: float = argument(
        bounded(0.0, 255.0), "of its input if the base has a mux", default=10.0
    )


@fault(None, Onset.LATENT)
class Brownout(SimulatedFault):
    """The motors have only a part of their torque."""

    factor: float = argument(bounded(0.0, 1.0), "of the torque that is left", default=0.12)


@fault(None, Onset.ABRUPT)
class Tip(SimulatedFault):
    """The rover is tipped over sideways at once; clearing it sets it upright where it lies."""

    by_rad: float = argument(bounded(pi), "to the right", default=radians(120))


@fault(FaultTarget.BATTERY)
class BatteryLow(SimulatedFault):
    """The battery shows less than its minimum voltage."""


@fault(FaultTarget.BATTERY)
class BatteryDrained(SimulatedFault):
    """The battery has lost charge at once; clearing it does not charge it."""

    charge: float = argument(bounded(0.0, 1.0), "of the whole, at most left", default=0.1)


@fault(FaultTarget.BATTERY)
class BatterySilent(SimulatedFault):
    """No battery voltage arrives."""


@fault(FaultTarget.BATTERY)
class BatteryNan(SimulatedFault):
    """The battery voltage is not a number."""


@fault(FaultTarget.CAMERA)
class CameraDead(SimulatedFault):
    """No picture arrives, even after repeated requests."""


@fault(FaultTarget.CAMERA)
class CameraStale(SimulatedFault):
    """Every picture is that of the moment when the fault began, with its old stamp."""


@fault(FaultTarget.CAMERA)
class CameraTruncated(SimulatedFault):
    """Of every JPEG only the first 200 octets arrive."""


@fault(None)
class HeadStuck(SimulatedFault):
    """The camera's head does not turn."""


@fault(FaultTarget.BRICK, Onset.ABRUPT)
class BrickSilent(SimulatedFault):
    """The brick sends no telemetry and no replies; it still executes commands."""


@fault(Sensor.IMU)
class ImuDead(SimulatedFault):
    """No message of the inertial measurement unit arrives."""


@fault(Sensor.JOINTS)
class JointsDead(SimulatedFault):
    """No message of the wheels arrives."""


@fault(Sensor.SECOND_ODOMETRY)
class SecondOdometryLost(SimulatedFault):
    """No message of the second odometry arrives."""


@fault(Sensor.SECOND_ODOMETRY, Onset.ABRUPT)
class SecondOdometryFrozen(SimulatedFault):
    """The second odometry arrives with new stamps, its pose as it was."""


@fault(Sensor.SECOND_ODOMETRY, Onset.ABRUPT)
class SecondOdometryJump(SimulatedFault):
    """The pose of the second odometry jumps once; clearing it does not jump back."""

    by_m: float = argument(bounded(10.0), "to the left", default=0.36)


@fault(Sensor.SECOND_ODOMETRY, Onset.LATENT)
class SecondOdometryDrift(SimulatedFault):
    """The pose of the second odometry drifts; clearing it ends the drift."""

    rate_mps: float = argument(bounded(5.0), "to the left", default=0.1)


@fault(Sensor.LASER)
class LaserDead(SimulatedFault):
    """No scan of the laser arrives."""


@fault(Sensor.LASER)
class LaserBlind(SimulatedFault):
    """Rays of the laser measure nothing usable: they are not a number."""

    share: float = argument(bounded(0.0, 1.0), "of the rays of the sector", default=1.0)
    sector_rad: float = argument(bounded(0.0, 2 * pi), "its width, about ahead", default=2 * pi)


@fault(None, Onset.GROUND)
class Pushed(SimulatedFault):
    """The rover is pushed sideways at once; clearing it does not push it back."""

    by_m: float = argument(bounded(5.0), "to the left", default=0.5)


@fault(FaultTarget.LINK)
class LinkLost(SimulatedFault):
    """No message passes between ground and rover."""


AnyFault: Final[Any] = Union[tuple(each.kind for each in _DECLARED.values())]  # noqa: UP007
"""Any declared fault, as a type of a checkpoint."""
configure_tagged_union(AnyFault, CONVERTER, tag_name="kind")

JACKAL_PARTS: Final = frozenset(
    {
        FaultTarget.ODOMETRY,
        FaultTarget.ODOMETRY_LINK,
        FaultTarget.ENCODERS,
        FaultTarget.GYRO,
        FaultTarget.CMD_VEL,
        FaultTarget.BATTERY,
        FaultTarget.CAMERA,
    }
)
MOCUP_PARTS: Final = frozenset(
    {
        FaultTarget.ODOMETRY,
        FaultTarget.ENCODERS,
        FaultTarget.BATTERY,
        FaultTarget.CAMERA,
        FaultTarget.BRICK,
    }
)


def declared_faults() -> tuple[SimulatedFaultDeclaration, ...]:
    """Return all declarations, in their order."""
    return tuple(_DECLARED.values())


def fault_declaration(kind: type[SimulatedFault]) -> SimulatedFaultDeclaration:
    """Return the declaration of a kind of fault."""
    (found,) = (each for each in _DECLARED.values() if each.kind is kind)
    return found


def jackal_fault_targets(sensors: Sensors) -> frozenset[Part]:
    """Return the parts of a simulated Jackal with these sensors."""
    return JACKAL_PARTS | sensors.present


def fault_targets_of(settings: Settings) -> frozenset[Part]:
    """Return the parts of the simulated rover of an asset."""
    match settings.locomotion:
        case LocomotionKind.VELOCITY:
            return jackal_fault_targets(settings.sensors)
        case LocomotionKind.DELEGATED:
            return MOCUP_PARTS
        case _:
            assert_never(settings.locomotion)


def unsupported_reason(kind: type[SimulatedFault], parts: frozenset[Part]) -> str | None:
    """Return why a rover with these parts cannot have a fault; None if it can."""
    declaration = fault_declaration(kind)
    needs = declaration.needs
    if needs is None or needs in parts:
        return None
    if isinstance(needs, Sensor):
        return f"{declaration.name} needs a Jackal with settings.sensors.{needs.value}"
    return f"{declaration.name} needs {needs.value}, which is not simulated here"


def read_kind(raw: object) -> SimulatedFaultDeclaration:
    """Return the declaration of a fault by its name.

    Raises:
        ValueError: no fault has this name; the text lists all.
    """
    found = _DECLARED.get(raw) if isinstance(raw, str) else None
    if found is None:
        near = suggestion(raw, _DECLARED)
        raise ValueError(f"{raw!r} is no fault{near}; known are {', '.join(_DECLARED)}")
    return found


def read_fault(raw: object) -> SimulatedFault:
    """Return a fault from its written form: `odometry_lost`, or `{odometry_jump: {by: 0.5}}`.

    Raises:
        ValueError: the fault is unknown, or cannot have such parameters.
    """
    name, given = next(iter(raw.items())) if isinstance(raw, dict) and len(raw) == 1 else (raw, {})
    declaration = read_kind(name)
    if not isinstance(given, dict):
        raise ValueError(f"{name}: expected parameters and values, got {given!r}")
    return declaration.make(given)


def format_fault(fault: SimulatedFault) -> dict[str, dict[str, float | bool | str]]:
    """Return the written form that `read_fault` reads."""
    declaration, plain = fault_declaration(type(fault)), _READER.plain(fault)
    return {declaration.name: {each.name: plain[each.field] for each in declaration.parameters}}


def _value(raw: object, parameter: Argument, path: str) -> Value:
    is_angle = parameter.unit.startswith("rad")
    value: Value = _READER.read(raw, _Angle if is_angle else parameter.kind, path)
    if isinstance(value, Side) or parameter.bound is None:
        return value
    low, high = bounds(parameter)
    if not low <= value <= high:
        figures = f"{value:g} is not in {low:g} .. {high:g}"
        raise FormatError(path, f"{figures} {parameter.unit}".rstrip())
    return value


def bounds(parameter: Argument) -> tuple[float, float]:
    """Return the minimum and maximum of a numeric parameter."""
    bound = parameter.bound
    assert isinstance(bound, ValueRange)
    assert isinstance(bound.high, float)
    low = -bound.high if bound.low is None else bound.low
    assert isinstance(low, float)
    return low, bound.high
