"""Dictionary entry of an asset for pages: its parameters, its commands as forms, its zones.

Figures are in SI units and radians. `display_unit` is set if the display unit differs; it has the
number of display units per SI unit.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from math import degrees
from operator import attrgetter
from typing import Any, Final, assert_never

from adapters.mrs.spec import ParameterDefinition, display_name, housekeeping_limits
from executive.commands import (
    ACCEPTED,
    Argument,
    AssetChoice,
    CommandDeclaration,
    Family,
    FilePath,
    Limit,
    SubmitPlan,
    SymmetricRange,
    ValueRange,
    all_declarations,
    arguments_of,
)
from executive.obstacles.zones import Footprint, KeepIn, KeepOut, KnownRock
from executive.plans import (
    DEADLINE,
    DIALECT,
    POSTCONDITIONS,
    PRECONDITIONS,
    NodeKind,
    Port,
    PortType,
)
from executive.settings import Settings, TargetFrame
from executive.values.parameters import Parameter
from executive.values.quantities import UNITS

_IN_DEGREES: Final = {"rad": "deg", "rad/s": "deg/s"}


@dataclass(frozen=True, slots=True)
class DisplayUnit:
    """Display unit of a value, and the number of display units per SI unit."""

    unit: str
    per_unit: float


@dataclass(frozen=True, slots=True)
class ParameterEntry:
    """A telemetry parameter.

    Attributes:
        name: for operators, such as Battery voltage; `key` is that of the wire.
        type: name of the MAL type.
        low, high: limits by the asset's settings; None for no limit.
        writable: whether a command sets it.
    """

    key: str
    name: str
    description: str
    type: str
    unit: str
    display_unit: DisplayUnit | None
    low: float | None
    high: float | None
    writable: bool


@dataclass(frozen=True, slots=True)
class ArgumentEntry:
    """An argument of a command.

    Attributes:
        name: key in the posted `args`.
        type: `number`, `integer`, `text`, `choice`, `list` (of objects of `items`).
        units: accepted units of a typed value, with their number per SI unit.
        low, high: bounds, included; None if only the asset knows them.
        or_zero: whether 0 is accepted outside the bounds.
        choices: permitted values; None for any.
        items: fields of each item of a list.
        min_items, max_items: minimum and maximum number of items.
    """

    name: str
    type: str
    unit: str
    display_unit: DisplayUnit | None
    optional: bool
    help: str
    units: dict[str, float]
    low: float | None = None
    high: float | None = None
    or_zero: bool = False
    choices: tuple[str, ...] | None = None
    items: "tuple[ArgumentEntry, ...]" = ()
    min_items: int | None = None
    max_items: int | None = None


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """A command as a form.

    Attributes:
        name: posted `name`.
        family: family of commands that are accepted in the same modes.
        modes: modes that accept it.
        motion: whether it is a motion: it has a preview, and may replace active motions.
        at_least_one: whether at least one of its arguments is required.
    """

    name: str
    summary: str
    service: str
    operation: str
    family: str
    modes: tuple[str, ...]
    motion: bool
    at_least_one: bool
    arguments: tuple[ArgumentEntry, ...]
    examples: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ZoneEntry:
    """A zone or rock of an asset, in the frame of its odometry, m.

    Attributes:
        kind: `keep_in`, `keep_out` or `rock`.
        title: human-readable kind and name.
        corners: corners [x, y] of a zone.
        x, y, radius: centre and radius of a rock.
    """

    kind: str
    title: str
    corners: tuple[tuple[float, ...], ...] = ()
    x: float | None = None
    y: float | None = None
    radius: float | None = None


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """Entry of a recording, an asset that cannot be commanded.

    Attributes:
        file: name of the file.
        rover: recorded asset.
        start, end: first and last time of the recording.
        complete: whether the file was closed in good order.
        damaged: whether damage ended the reading.
    """

    file: str
    rover: str
    start: float
    end: float
    complete: bool
    damaged: bool


@dataclass(frozen=True, slots=True)
class AssetEntry:
    """Dictionary entry of an asset.

    Attributes:
        ranges_known: whether its settings are installed here, which give ranges, zones and
            footprint.
        footprint: length and width about base_link, m; None if unknown.
        frame: default frame of waypoints; None if unknown.
        takers: operators that may take the authority; None for all or if unknown.
        recording: None for a rover.
        nodes: the nodes of plans that can be steps beside commands, as forms.
        conditions: conditions of a step.
    """

    asset: str
    description: str
    version: str
    ranges_known: bool
    parameters: tuple[ParameterEntry, ...]
    commands: tuple[CommandEntry, ...]
    zones: tuple[ZoneEntry, ...]
    footprint: Footprint | None
    frame: TargetFrame | None = None
    takers: tuple[str, ...] | None = None
    recording: RecordingEntry | None = None
    nodes: tuple[CommandEntry, ...] = ()
    conditions: tuple[ArgumentEntry, ...] = ()

    def parameter(self, key: str) -> ParameterEntry | None:
        """Return a parameter; None if it is unknown."""
        return next((each for each in self.parameters if each.key == key), None)


def zone_entries(settings: Settings | None) -> tuple[ZoneEntry, ...]:
    """Return the zones and rocks of an asset's settings."""
    return () if settings is None else tuple(map(_zone, settings.zones))


def _zone(obstacle: KeepIn | KeepOut | KnownRock) -> ZoneEntry:
    match obstacle:
        case KeepIn():
            return ZoneEntry("keep_in", obstacle.label, obstacle.corners_m)
        case KeepOut():
            return ZoneEntry("keep_out", obstacle.label, obstacle.corners_m)
        case KnownRock():
            circle = (obstacle.x_m, obstacle.y_m, obstacle.radius_m)
            return ZoneEntry("rock", obstacle.label, (), *circle)
        case _:
            assert_never(obstacle)


def parameter_entries(
    definitions: Iterable[ParameterDefinition], settings: Settings | None
) -> tuple[ParameterEntry, ...]:
    """Return the parameters that an asset defines, with limits if its settings are known."""
    limits = housekeeping_limits(settings)
    if settings is not None:
        limits |= _limits(settings)
    entries = []
    for each in definitions:
        low, high = limits.get(each.name, (None, None))
        unit = each.unit or ""
        entries.append(
            ParameterEntry(
                each.name,
                display_name(each),
                each.description,
                each.type.name,
                unit,
                _display_unit(unit),
                low,
                high,
                each.writable,
            )
        )
    return tuple(entries)


def command_entries(settings: Settings | None) -> tuple[CommandEntry, ...]:
    """Return the command catalogue as forms, with ranges if the asset's settings are known."""
    return tuple(_command(each, settings) for each in FORMS.values())


FORMS: Final = {each.name: each for each in all_declarations() if each.kind is not SubmitPlan}
"""Declarations of the postable commands, by name; plans are submitted as files."""


def _command(declaration: CommandDeclaration, settings: Settings | None) -> CommandEntry:
    return CommandEntry(
        name=declaration.name,
        summary=declaration.summary,
        service=declaration.service,
        operation=declaration.operation,
        family=declaration.family.value,
        modes=tuple(sorted((mode.name for mode in ACCEPTED[declaration.family]), key=_MODES.index)),
        motion=declaration.family is Family.MOTION,
        at_least_one=declaration.at_least_one,
        arguments=tuple(
            _argument(each, settings, declaration.at_least_one)
            for each in declaration.user_arguments
        ),
        examples=declaration.examples,
    )


def _node(kind: NodeKind) -> CommandEntry:
    """Return a node of plans as a form; its arguments are the texts of its ports."""
    return CommandEntry(
        name=kind.name,
        summary=kind.meaning,
        service="",
        operation="",
        family=kind.role.value,
        modes=(),
        motion=False,
        at_least_one=False,
        arguments=tuple(_port(each, kind.needs_limit) for each in kind.ports),
        examples=(),
    )


def _port(port: Port, needs_limit: bool) -> ArgumentEntry:
    is_deadline = port.name == DEADLINE
    example = "; as {name}" if port.type is PortType.WRITTEN_TEXT else ""
    return ArgumentEntry(
        name=port.name,
        type="choice" if port.type in _PORT_CHOICES else _PORT_TYPES.get(port.type, "text"),
        unit="s" if is_deadline else "",
        display_unit=None,
        optional=not (port.required or (is_deadline and needs_limit)),
        help="time in s, then it ends" if is_deadline else f"{port.meaning}{example}",
        units={},
        choices=_PORT_CHOICES.get(port.type),
    )


_PORT_TYPES: Final = {
    PortType.COUNT: "integer",
    PortType.MILLISECONDS: "integer",
    PortType.SECONDS: "number",
}
_PORT_CHOICES: Final = {
    PortType.STATUS: ("FAILURE", "SUCCESS", "SKIPPED", "RUNNING"),
    PortType.FLAG: ("true", "false"),
}
NODE_ENTRIES: Final = tuple(
    _node(each) for each in DIALECT.values() if each.command is None and each.max_children == 0
)
_SCRIPTS: Final = (
    *(Port(each, PortType.CONDITION, "before it begins", optional=True) for each in PRECONDITIONS),
    *(Port(each, PortType.STATEMENTS, "after its end", optional=True) for each in POSTCONDITIONS),
)
CONDITION_ENTRIES: Final = tuple(
    replace(_port(each, False), optional=True)
    for each in (*DIALECT["Precondition"].ports, *_SCRIPTS)
)

_MODES: Final = [mode.name for mode in sorted(ACCEPTED[Family.STOP], key=attrgetter("value"))]


def _argument(
    argument: Argument, settings: Settings | None, at_least_one: bool = False
) -> ArgumentEntry:
    low, high = _range(argument, settings)
    is_list = argument.repeated
    return ArgumentEntry(
        name=argument.name,
        type=_type(argument),
        unit=argument.unit,
        display_unit=_display_unit(argument.unit),
        optional=argument.optional or at_least_one,
        help=argument.help,
        units=UNITS.get(argument.unit, {}),
        low=None if is_list else low,
        high=None if is_list else high,
        or_zero=isinstance(argument.bound, ValueRange) and argument.bound.or_zero,
        choices=_choices(argument, settings),
        items=tuple(_argument(each, settings) for each in arguments_of(argument.kind)),
        min_items=int(low) if is_list and low is not None else None,
        max_items=int(high) if is_list and high is not None else None,
    )


def _type(argument: Argument) -> str:
    if argument.repeated:
        return "list"
    if isinstance(argument.choices, tuple) or issubclass(argument.kind, Enum):
        return "choice"
    return {float: "number", int: "integer"}.get(argument.kind, "text")


def _range(argument: Argument, settings: Settings | None) -> tuple[float | None, float | None]:
    match argument.bound:
        case ValueRange(low, high):
            upper = _figure(high, settings)
            lower = _figure(low, settings) if low is not None else _negative(upper)
        case SymmetricRange(low, high):
            ends = (_figure(low, settings), _figure(high, settings))
            upper = None if ends[0] is None or ends[1] is None else ends[1] - ends[0]
            lower = _negative(upper)
        case AssetChoice(str() as path) if isinstance(given := _setting(path, settings), int):
            return given, given
        case AssetChoice() | FilePath() | None:
            lower = upper = None
        case _:
            assert_never(argument.bound)
    match argument.choices:
        case range() as numbers:
            return numbers[0], numbers[-1]
        case _:
            return lower, upper


def _choices(argument: Argument, settings: Settings | None) -> tuple[str, ...] | None:
    match argument.bound:
        case AssetChoice(str() as path) if isinstance(given := _setting(path, settings), tuple):
            return given
    return argument.choices if isinstance(argument.choices, tuple) else None


def _figure(limit: Limit | None, settings: Settings | None) -> float | None:
    return _setting(limit, settings) if isinstance(limit, str) else limit


def _setting(path: str, settings: Settings | None) -> Any:
    return None if settings is None else attrgetter(path)(settings)


def _negative(figure: float | None) -> float | None:
    return None if figure is None else -figure


def _display_unit(unit: str) -> DisplayUnit | None:
    displayed = _IN_DEGREES.get(unit)
    return None if displayed is None else DisplayUnit(displayed, degrees(1.0))


def _limits(settings: Settings) -> dict[str, tuple[float | None, float | None]]:
    """Return the limits of parameters by the settings, by parameter name."""
    drive, camera = settings.drive, settings.camera
    limits: dict[Parameter, tuple[float | None, float | None]] = {
        Parameter.TRAVEL_SPEED: (0.0, drive.travel_speed_mps),
        Parameter.ROTATE_SPEED: (0.0, drive.rotate_speed_radps),
        Parameter.CURRENT_TRAVEL_SPEED: (-drive.travel_speed_mps, drive.travel_speed_mps),
        Parameter.CURRENT_ROTATE_SPEED: (-drive.rotate_speed_radps, drive.rotate_speed_radps),
        Parameter.BATERY_VOLTAGE: (settings.faults.battery_low.bound, None),
        Parameter.CAM_PAN: (camera.pan_min_rad, camera.pan_max_rad),
        Parameter.CAM_TILT: (camera.tilt_min_rad, camera.tilt_max_rad),
        Parameter.CAM_ROTATE_SPEED: (0.0, camera.rotate_speed_radps),
    }
    return {parameter.value: bounds for parameter, bounds in limits.items()}
