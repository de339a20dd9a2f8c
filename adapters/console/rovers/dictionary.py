"""What there is to see and to command of an asset, derived from what declares it.

Figures are in SI units and radians. Where people write another unit, `typed` says which, and how
many of it one SI unit has.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from math import degrees
from operator import attrgetter
from typing import Any, Final, assert_never

from adapters.mrs.spec import ParameterDefinition, housekeeping_limits
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
    arguments_of,
    declared,
)
from executive.obstacles.zones import Footprint, KeepIn, KeepOut, KnownRock
from executive.settings import Settings
from executive.values.parameters import Parameter

_IN_DEGREES: Final = {"rad": "deg", "rad/s": "deg/s"}


@dataclass(frozen=True, slots=True)
class DisplayUnit:
    """The unit that people write, and how many of it one of the SI unit is."""

    unit: str
    per_unit: float


@dataclass(frozen=True, slots=True)
class ParameterEntry:
    """A telemetry parameter.

    Attributes:
        type: as MAL spells it.
        low, high: beyond which it is out of what the asset's settings allow; None for no bound.
        writable: whether a command sets it.
    """

    key: str
    description: str
    type: str
    unit: str
    typed: DisplayUnit | None
    low: float | None
    high: float | None
    writable: bool


@dataclass(frozen=True, slots=True)
class ArgumentEntry:
    """An argument of a command.

    Attributes:
        name: as it is posted.
        type: `number`, `integer`, `text`, `choice`, `list` (of objects of `items`).
        low, high: bounds, included; None where they are not known here: the asset knows.
        or_zero: whether 0 is allowed besides.
        choices: what may be chosen; None for anything.
        items: of a list, the fields of each of its items.
        least, most: how many items.
    """

    name: str
    type: str
    unit: str
    typed: DisplayUnit | None
    optional: bool
    help: str
    low: float | None = None
    high: float | None = None
    or_zero: bool = False
    choices: tuple[str, ...] | None = None
    items: "tuple[ArgumentEntry, ...]" = ()
    least: int | None = None
    most: int | None = None


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """A command as a form.

    Attributes:
        name: as it is posted.
        family: of commands that are accepted in the same modes.
        modes: in which it is accepted.
        motion: whether it is a motion: it can be previewed, and may replace those under way.
        at_least_one: whether one of its arguments has to be given.
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
    """What an asset keeps away from, or within, in the frame of its odometry.

    Attributes:
        kind: `keep_in`, `keep_out` or `rock`.
        title: what it is, with its name, for people.
        corners: of a zone, [x, y] each.
        x, y, radius: of a rock.
    """

    kind: str
    title: str
    corners: tuple[tuple[float, ...], ...] = ()
    x: float | None = None
    y: float | None = None
    radius: float | None = None


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """That an asset is a recording of one, which can be looked at and not commanded.

    Attributes:
        file: its name.
        rover: the asset that was recorded.
        began, ended: of the recording.
        whole: whether it was closed in good order, and does not break off.
        damaged: whether damage ended the reading.
    """

    file: str
    rover: str
    began: float
    ended: float
    whole: bool
    damaged: bool


@dataclass(frozen=True, slots=True)
class AssetEntry:
    """What there is of an asset.

    Attributes:
        ranges_known: whether its settings are known here, by which ranges are given; zones and
            footprint are, too.
        footprint: length and width about base_link; None where they are not known.
        recording: None for a rover.
    """

    asset: str
    description: str
    version: str
    ranges_known: bool
    parameters: tuple[ParameterEntry, ...]
    commands: tuple[CommandEntry, ...]
    zones: tuple[ZoneEntry, ...]
    footprint: Footprint | None
    recording: RecordingEntry | None = None

    def limits_of(self, key: str) -> tuple[float | None, float | None]:
        """Return between which values a parameter may be; None for no bound."""
        found = ((each.low, each.high) for each in self.parameters if each.key == key)
        return next(found, (None, None))


def zone_entries(settings: Settings | None) -> tuple[ZoneEntry, ...]:
    """Return the zones and rocks that an asset's settings tell of."""
    return () if settings is None else tuple(map(_zone, settings.zones))


def _zone(obstacle: KeepIn | KeepOut | KnownRock) -> ZoneEntry:
    match obstacle:
        case KeepIn():
            return ZoneEntry("keep_in", obstacle.title, obstacle.corners_m)
        case KeepOut():
            return ZoneEntry("keep_out", obstacle.title, obstacle.corners_m)
        case KnownRock():
            place = (obstacle.x_m, obstacle.y_m, obstacle.radius_m)
            return ZoneEntry("rock", obstacle.title, (), *place)
        case _:
            assert_never(obstacle)


def parameter_entries(
    definitions: Iterable[ParameterDefinition], settings: Settings | None
) -> tuple[ParameterEntry, ...]:
    """Return what an asset defines, with limits where its settings are known."""
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
                each.description,
                each.type.name,
                unit,
                _typed(unit),
                low,
                high,
                each.writable,
            )
        )
    return tuple(entries)


def command_entries(settings: Settings | None) -> tuple[CommandEntry, ...]:
    """Return the catalogue as forms, with the ranges of an asset whose settings are known."""
    return tuple(_command(each, settings) for each in FORMS.values())


FORMS: Final = {each.name: each for each in declared() if each.kind is not SubmitPlan}
"""The declarations that can be posted, by the names under which they are; a plan is a file."""


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
            _argument(each, settings, declaration.at_least_one) for each in declaration.written
        ),
        examples=declaration.examples,
    )


_MODES: Final = [mode.name for mode in sorted(ACCEPTED[Family.STOP], key=attrgetter("value"))]


def _argument(
    argument: Argument, settings: Settings | None, at_least_one: bool = False
) -> ArgumentEntry:
    low, high = _range(argument, settings)
    is_list = argument.many
    return ArgumentEntry(
        name=argument.name,
        type=_type(argument),
        unit=argument.unit,
        typed=_typed(argument.unit),
        optional=argument.optional or at_least_one,
        help=argument.help,
        low=None if is_list else low,
        high=None if is_list else high,
        or_zero=isinstance(argument.bound, ValueRange) and argument.bound.or_zero,
        choices=_choices(argument, settings),
        items=tuple(_argument(each, settings) for each in arguments_of(argument.kind)),
        least=int(low) if is_list and low is not None else None,
        most=int(high) if is_list and high is not None else None,
    )


def _type(argument: Argument) -> str:
    if argument.many:
        return "list"
    if isinstance(argument.choices, tuple) or issubclass(argument.kind, Enum):
        return "choice"
    return {float: "number", int: "integer"}.get(argument.kind, "text")


def _range(argument: Argument, settings: Settings | None) -> tuple[float | None, float | None]:
    match argument.bound:
        case ValueRange(low, high):
            highest = _figure(high, settings)
            lowest = _figure(low, settings) if low is not None else _negative(highest)
        case SymmetricRange(low, high):
            ends = (_figure(low, settings), _figure(high, settings))
            highest = None if ends[0] is None or ends[1] is None else ends[1] - ends[0]
            lowest = _negative(highest)
        case AssetChoice(str() as path) if isinstance(given := _setting(path, settings), int):
            return given, given
        case AssetChoice() | FilePath() | None:
            lowest = highest = None
        case _:
            assert_never(argument.bound)
    match argument.choices:
        case range() as numbers:
            return numbers[0], numbers[-1]
        case _:
            return lowest, highest


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


def _typed(unit: str) -> DisplayUnit | None:
    typed = _IN_DEGREES.get(unit)
    return None if typed is None else DisplayUnit(typed, degrees(1.0))


def _limits(settings: Settings) -> dict[str, tuple[float | None, float | None]]:
    """Return between which values parameters may be, by their names, as the settings have it."""
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
