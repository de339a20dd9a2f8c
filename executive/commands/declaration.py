"""`@command` declares a class as a request: arguments, bounds, units, modes, and texts for users.

`@command(...)` turns a class into a frozen dataclass and stores its declaration; its fields are
`= argument(...)`. Bounds that an asset sets are given as paths in its settings, as text, so
that this module imports no settings; `executive.commands.intake` resolves them.
"""

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from enum import Enum, unique
from math import pi
from types import NoneType, UnionType
from typing import Any, Final, TypeVar, dataclass_transform, get_args, get_origin, overload

T = TypeVar("T")
Limit = float | str
"""A number, or its path in the settings, such as `drive.distance_m`."""


@unique
class Family(Enum):
    """Family of commands that are accepted in the same modes."""

    MOTION = "motion"
    CAMERA = "camera"
    INSTANT = "file, action"
    POSE = "pose compensation"
    CONFIRMATION = "pose confirmation"
    SETTING = "setting"
    PLAN = "plan"
    PLAN_START = "plan: activate, resume"
    STOP = "stop"
    RESUME = "resume"


@unique
class Mode(Enum):
    """The asset's mode (numbers as on the MRS wire)."""

    IDLE = 1
    MOVING = 2
    TELEOP = 3
    PLAN = 4
    PAUSED = 5
    STOPPED = 6
    SAFE = 7


ACCEPTED: Final = {
    Family.MOTION: {Mode.IDLE, Mode.MOVING, Mode.TELEOP, Mode.PAUSED},
    Family.CAMERA: set(Mode),
    Family.INSTANT: set(Mode),
    Family.POSE: {Mode.IDLE, Mode.PAUSED, Mode.STOPPED, Mode.SAFE},
    Family.CONFIRMATION: {Mode.IDLE, Mode.PAUSED, Mode.STOPPED, Mode.SAFE},
    Family.SETTING: set(Mode),
    Family.PLAN: set(Mode),
    Family.PLAN_START: {Mode.IDLE, Mode.PLAN, Mode.PAUSED},
    Family.STOP: set(Mode),
    Family.RESUME: {Mode.PAUSED, Mode.STOPPED, Mode.SAFE},
}


@dataclass(frozen=True, slots=True)
class ValueRange:
    """Finite and within a range, bounds included.

    Attributes:
        low: None for the negative of `high`.
        or_zero: whether 0 is also permitted.
    """

    low: Limit | None
    high: Limit
    or_zero: bool = False


@dataclass(frozen=True, slots=True)
class SymmetricRange:
    """Finite, and at most the width of the range in either direction."""

    low: str
    high: str


@dataclass(frozen=True, slots=True)
class AssetChoice:
    """One of the values that the asset supports; None if there is no choice."""

    path: str | None


@dataclass(frozen=True, slots=True)
class FilePath:
    """The path of a file in the monitored folder."""


Bound = ValueRange | SymmetricRange | AssetChoice | FilePath


def bounded(first: Limit, second: Limit | None = None, *, or_zero: bool = False) -> ValueRange:
    """Return the range between two limits, or symmetric about zero for a single limit."""
    return (
        ValueRange(None, first, or_zero) if second is None else ValueRange(first, second, or_zero)
    )


ANGLE: Final = bounded(2 * pi)
PATH: Final = FilePath()

Choices = range | tuple[str, ...]
RELAYED: Final = "relayed"
"""Metadata key of `Argument.relayed` in a field."""


@overload
def argument(
    bound: Bound | None = None,
    help: str = "",
    *,
    choices: Choices | None = None,
    relayed: bool = True,
) -> Any: ...


@overload
def argument(
    bound: Bound | None = None,
    help: str = "",
    *,
    choices: Choices | None = None,
    relayed: bool = True,
    default: T,
) -> T: ...


def argument(
    bound: Bound | None = None,
    help: str = "",
    *,
    choices: Choices | None = None,
    relayed: bool = True,
    default: Any = MISSING,
) -> Any:
    """Declare an argument of a request, see `Argument`; its default is None if optional."""
    metadata = {"bound": bound, "help": help, "choices": choices, RELAYED: relayed}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True, eq=False)
class Argument:
    """One argument of a request, or of a composite such as a waypoint.

    Attributes:
        field: its field, with the unit suffix.
        name: the same without the suffix, as the user types it.
        unit: for display; empty for none.
        position: of the message part that holds it, from 1; 1 within a composite.
        kind: float, int, str, an Enum of texts, or the class of a composite.
        repeated: whether it can be repeated.
        optional: whether it may be omitted.
        bound: the values that the asset accepts.
        help: short description, without its unit.
        choices: all defined values, independent of the asset; those of an Enum are its texts.
        relayed: whether the messages of the relay carry it; optional if they do not.
    """

    field: str
    name: str
    unit: str
    position: int
    kind: type
    repeated: bool
    optional: bool
    bound: Bound | None = None
    help: str = ""
    choices: Choices | None = None
    relayed: bool = True

    @property
    def meaning(self) -> str:
        """Unit and description, for display."""
        match self.choices:
            case range() as numbers:
                choices = f"{numbers[0]} to {numbers[-1]}"
            case (*some, last):
                choices = f"{', '.join(map(str, some))} or {last}"
            case _:
                choices = ""
        return ", ".join(filter(None, (self.unit, self.help, choices)))


@dataclass(frozen=True, slots=True, eq=False)
class CommandDeclaration:
    """Declaration of a kind of request.

    Attributes:
        kind: its class.
        name: for users, scenarios and plans: the class name in lower camel case, unless given.
        service, operation: the operation of the MRS that carries it.
        part: the message part that holds all arguments and may be NULL; None if each
            argument has its own part.
        at_least_one: whether users give its arguments as options, one of them at least.
        summary: the first line of its docstring.
        examples: arguments as typed after the name.
    """

    kind: type[Any]
    name: str
    family: Family
    service: str
    operation: str
    part: str | None
    at_least_one: bool
    arguments: tuple[Argument, ...]
    summary: str
    examples: tuple[str, ...]

    @property
    def composite(self) -> type[Any] | None:
        """Class of its first argument, if it is a `record`: the user types its parts."""
        if not self.arguments or self.arguments[0].repeated:
            return None
        kind = self.arguments[0].kind
        return kind if arguments_of(kind) else None

    @property
    def user_arguments(self) -> tuple[Argument, ...]:
        """The arguments as the user types them."""
        if self.composite is None:
            return self.arguments
        return (*arguments_of(self.composite), *self.arguments[1:])

    def build_request(self, *values: Any) -> Any:
        """Build the request from the values that the user typed; omitted figures are 0."""
        if self.at_least_one:
            given = zip(self.user_arguments, values, strict=True)
            values = tuple(0.0 if v is None and not each.optional else v for each, v in given)
        if self.composite is None:
            return self.kind(*values)
        parts = len(arguments_of(self.composite))
        return self.kind(self.composite(*values[:parts]), *values[parts:])


_DECLARATIONS: Final[dict[type, CommandDeclaration]] = {}
_RECORDS: Final[dict[type, tuple[Argument, ...]]] = {}
_UNITS: Final = {
    "m": "m",
    "rad": "rad",
    "s": "s",
    "mps": "m/s",
    "radps": "rad/s",
    "px": "px",
    "hz": "Hz",
}


@dataclass_transform(frozen_default=True, field_specifiers=(argument,))
def record(cls: type[T]) -> type[T]:
    """Turn a class into a composite argument: a frozen dataclass that requests can hold."""
    made = dataclass(frozen=True, slots=True)(cls)
    _RECORDS[made] = _arguments(made, apart=False)
    return made


@dataclass_transform(frozen_default=True, field_specifiers=(argument,))
def command(
    family: Family,
    operation: str,
    *,
    name: str | None = None,
    part: str | None = None,
    at_least_one: bool = False,
    examples: tuple[str, ...] = (),
) -> Callable[[type[T]], type[T]]:
    """Turn a class into a request: a frozen dataclass, with its `CommandDeclaration`.

    The operation is given with its service, as `MotionControl.moveTo`.
    """
    service, _, operation_name = operation.partition(".")

    def declare(cls: type[T]) -> type[T]:
        made = dataclass(frozen=True, slots=True)(cls)
        _DECLARATIONS[made] = CommandDeclaration(
            made,
            name or f"{made.__name__[0].lower()}{made.__name__[1:]}",
            family,
            service,
            operation_name,
            part,
            at_least_one,
            _arguments(made, apart=part is None),
            (made.__doc__ or "").partition("\n")[0],
            examples,
        )
        return made

    return declare


def all_declarations() -> tuple[CommandDeclaration, ...]:
    """Return all declarations in order."""
    return tuple(_DECLARATIONS.values())


def declaration_of(kind: type) -> CommandDeclaration:
    """Return the declaration of a request class; raise KeyError for another class."""
    return _DECLARATIONS[kind]


def arguments_of(kind: type) -> tuple[Argument, ...]:
    """Return the arguments of a composite; none if it is not a `record`."""
    return _RECORDS.get(kind, ())


def _arguments(made: Any, apart: bool) -> tuple[Argument, ...]:
    found = []
    for position, each in enumerate(fields(made), start=1):
        stem, _, suffix = each.name.rpartition("_")
        unit = _UNITS.get(suffix, "") if stem else ""
        kind, many, optional = _kind(each.type)
        known = dict(each.metadata)
        if issubclass(kind, Enum):
            known["choices"] = tuple(choice.value for choice in kind)
        found.append(
            Argument(
                each.name,
                stem if unit else each.name,
                unit,
                position if apart else 1,
                kind,
                many,
                optional,
                **known,
            )
        )
    return tuple(found)


def _kind(hint: Any) -> tuple[type, bool, bool]:
    """Return the type within a hint, whether it is repeated, and whether it may be None."""
    if isinstance(hint, UnionType):
        (kind,) = (each for each in get_args(hint) if each is not NoneType)
        return kind, False, True
    if get_origin(hint) is tuple:
        return get_args(hint)[0], True, False
    return hint, False, False
