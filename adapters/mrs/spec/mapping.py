"""Converts values of the core to MRS types and back: commands, plans, state, reports.

Requests are encoded by their declarations and the XML. An operation that the XML lacks, or whose
parts differ from the arguments of the request, is an error on import. An unknown figure is NaN, or
a value that is not VALID.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import isfinite, nan
from typing import Any, Final, NamedTuple, Protocol, TypeVar

from adapters.mal import (
    AttributeType,
    Field,
    InteractionStage,
    NamedValue,
    SpecificationError,
    TypedAttribute,
)
from adapters.mrs.spec import types
from adapters.mrs.spec.errors import invalid_error
from adapters.mrs.spec.specification import mrs_specification
from adapters.mrs.spec.types import (
    Notification,
    NotificationKind,
    Validity,
)
from executive.commands import (
    Argument,
    CommandDeclaration,
    PlanArgument,
    PlanDefinition,
    Request,
    all_declarations,
    arguments_of,
)
from executive.settings import TargetFrame
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reasons import Figure
from executive.values.reports import Identity, PlanUpdate, Report, ReportKind

R = TypeVar("R", bound=Request)

FRAME: Final = "odom"

MAX_SOURCE_LENGTH: Final = 256
"""Maximum characters of a source: every notification of its commands repeats it."""
MAX_NAME_LENGTH: Final = 64
MAX_TEXT_LENGTH: Final = 4096
MAX_FIGURES: Final = 32
"""Maximum figures of a client's notification, so that getNotifications can return 1000 at once."""
MAX_FIGURE_LENGTH: Final = 256
"""Maximum characters or octets of a figure that is no number."""

NUMBER_TYPES: Final = {
    AttributeType.FLOAT,
    AttributeType.DOUBLE,
    AttributeType.DURATION,
    AttributeType.OCTET,
    AttributeType.UOCTET,
    AttributeType.SHORT,
    AttributeType.USHORT,
    AttributeType.INTEGER,
    AttributeType.UINTEGER,
    AttributeType.LONG,
    AttributeType.ULONG,
}

NS_PER_S: Final = 1_000_000_000

DEFINED: Final = tuple(
    types.ParameterDefinition(
        name=parameter.value,
        description=parameter.description,
        type=AttributeType.DOUBLE,
        unit=parameter.unit,
        writable=parameter.writable,
    )
    for parameter in Parameter
)


def to_ns(utc_s: float) -> int:
    """Return a MAL time, ns since 1970 UTC; rounded to µs, the resolution of a float."""
    return round(utc_s * 1e6) * 1000


class AssetView(Protocol):
    """State of an asset: the onboard executive, or a receiver of its telemetry."""

    def parameters(self) -> Sequence[ParameterValue]:
        """Return the present values of all parameters, in the order of their definition."""
        ...


def parameter_value(value: ParameterValue) -> types.ParameterValue:
    """Return a parameter value for the wire."""
    return figure_value(value.parameter.value, value.value, value.utc_s)


def figure_value(name: str, figure: float | None, utc_s: float) -> types.ParameterValue:
    """Return a value for the wire, INVALID if there is no figure."""
    return types.ParameterValue(
        name=name,
        timestamp=to_ns(utc_s),
        validity=Validity.INVALID if figure is None else Validity.VALID,
        value=None if figure is None else TypedAttribute(AttributeType.DOUBLE, float(figure)),
    )


def pose(asset: AssetView) -> types.Pose:
    """Return the pose of the rover, in frame `odom`; unknown figures are NaN."""
    figure = figures(asset)
    return types.Pose(
        frame=FRAME,
        x=figure[Parameter.POS_X],
        y=figure[Parameter.POS_Y],
        z=figure[Parameter.POS_Z],
        heading=figure[Parameter.HEAD],
    )


def speeds(asset: AssetView) -> types.Speeds:
    """Return the maximum and present speeds of the rover; unknown figures are NaN."""
    figure = figures(asset)
    return types.Speeds(
        travelSpeed=figure[Parameter.TRAVEL_SPEED],
        rotateSpeed=figure[Parameter.ROTATE_SPEED],
        currentTravelSpeed=figure[Parameter.CURRENT_TRAVEL_SPEED],
        currentRotateSpeed=figure[Parameter.CURRENT_ROTATE_SPEED],
    )


def figures(asset: AssetView) -> Mapping[Parameter, float]:
    """Return the present figures, NaN if unknown."""
    return {
        value.parameter: nan if value.value is None else value.value for value in asset.parameters()
    }


MAX_ARGUMENTS: Final = 256

_TEXTS: Final = {AttributeType.STRING, AttributeType.IDENTIFIER, AttributeType.URI}


def definition_of(wire: types.PlanDefinition) -> PlanDefinition:
    """Return a received plan.

    Raises:
        MalError: Invalid, an argument is neither text nor number, or there are too many.
    """
    arguments = wire.arguments or ()
    if len(arguments) > MAX_ARGUMENTS:
        raise invalid_error(1)
    return PlanDefinition(
        wire.planId, wire.name, wire.format, wire.content, tuple(map(_argument, arguments))
    )


def wire_definition(plan: PlanDefinition) -> types.PlanDefinition:
    """Return a plan for the wire; its arguments are sent as texts."""
    arguments = tuple(
        NamedValue(name=argument.name, value=TypedAttribute(AttributeType.STRING, argument.text))
        for argument in plan.arguments
    )
    return types.PlanDefinition(
        planId=plan.plan_id,
        name=plan.name,
        format=plan.format,
        content=plan.content,
        arguments=arguments or None,
    )


def wire_update(update: PlanUpdate) -> types.PlanUpdate:
    """Return the status of a plan for the wire."""
    return types.PlanUpdate(
        planId=update.plan_id,
        status=update.status,
        timestamp=to_ns(update.utc_s),
        node=update.node or None,
        done=update.done,
        total=update.total,
        text=update.text or None,
    )


def _argument(given: NamedValue) -> PlanArgument:
    value = given.value
    if value is not None and value.type in _TEXTS:
        return PlanArgument(given.name, value.value)
    if value is not None and value.type in NUMBER_TYPES:
        return PlanArgument(given.name, repr(value.value))
    raise invalid_error(1)


_SOURCE: Final = "source"
_NUMBER: Final = "commandId"


def notification_of(report: Report, cursor: int | None = None) -> Notification:
    """Return the notification of a report; figures become parameters.

    Life-cycle reports, and an EVENT of one command, have its source and commandId. A LINK report
    of one command names it in its parameters.

    Args:
        report: the report.
        cursor: its position in the record; None for its sequence, as aboard.
    """
    named = _name_of(report.identity) if report.kind is ReportKind.LINK else ()
    identity = None if named else report.identity
    return Notification(
        kind=report.kind,
        severity=report.severity,
        timestamp=to_ns(report.utc_s),
        sequence=report.sequence,
        commandId=identity.command_id if identity else None,
        source=identity.source if identity else None,
        stage=report.stage,
        step=report.step,
        stepCount=report.step_count,
        code=report.reason.value if report.reason else None,
        text=report.text,
        parameters=(*named, *figure_values(report.figures)) or None,
        cursor=cursor or report.sequence or None,
        fault=report.fault,
        causeSource=report.cause.source if report.cause else None,
        causeCommandId=report.cause.command_id if report.cause else None,
        publishers=report.publishers,
    )


def figure_values(figures: Sequence[Figure]) -> tuple[NamedValue, ...]:
    """Return figures as parameters of a notification or a fault."""
    return tuple(
        NamedValue(
            name=figure.name, value=TypedAttribute(AttributeType.DOUBLE, float(figure.value))
        )
        for figure in figures
    )


def command_of_link(notification: Notification) -> Identity | None:
    """Return the command that a LINK notification names; None for any other notification."""
    if notification.kind is not NotificationKind.LINK:
        return None
    values = {each.name: each.value.value for each in notification.parameters or () if each.value}
    source, number = values.get(_SOURCE), values.get(_NUMBER)
    if not isinstance(source, str) or not isinstance(number, int):
        return None
    return Identity(source, number)


def _name_of(identity: Identity | None) -> tuple[NamedValue, ...]:
    if identity is None:
        return ()
    return (
        NamedValue(name=_SOURCE, value=TypedAttribute(AttributeType.IDENTIFIER, identity.source)),
        NamedValue(name=_NUMBER, value=TypedAttribute(AttributeType.LONG, identity.command_id)),
    )


def notification_keys(asset: str, notification: Notification) -> tuple[Any, ...]:
    """Return the subscription keys of a notification.

    Without a command the commandId is NULL: brokers would interpret 0 as "any".
    """
    return (
        asset,
        notification.kind.value,
        notification.severity.value,
        notification.commandId or None,
        notification.stage.value if notification.stage else None,
    )


def is_valid_name(name: str) -> bool:
    """Whether a name is valid for assets, parameters and services: short, printable, no spaces."""
    return 0 < len(name) <= MAX_NAME_LENGTH and name.isprintable() and " " not in name


def is_valid_value(value: types.ParameterValue) -> bool:
    """Whether it is a finite Double that is VALID, or has no value and is not VALID."""
    if not is_valid_name(value.name):
        return False
    if value.value is None:
        return value.validity is not Validity.VALID
    return value.value.type is AttributeType.DOUBLE and isfinite(value.value.value)


def is_valid_notification(notification: Notification) -> bool:
    """Whether a notification is within the size limits of an executive's own."""
    figures = notification.parameters or ()
    return (
        len(notification.text or "") <= MAX_TEXT_LENGTH
        and len(notification.source or "") <= MAX_SOURCE_LENGTH
        and len(figures) <= MAX_FIGURES
        and all(
            len(figure.name) <= MAX_SOURCE_LENGTH
            and (figure.value is None or _size(figure.value.value) <= MAX_FIGURE_LENGTH)
            for figure in figures
        )
    )


def _size(value: Any) -> int:
    return len(value) if isinstance(value, str | bytes) else 0


class _Converter(NamedTuple):
    """Converts a wire value to a core value (inward) and back (outward)."""

    inward: Callable[[Any], Any]
    outward: Callable[[Any], Any]


_AS_IT_IS: Final = _Converter(lambda value: value, lambda value: value)
_BY_HAND: Final[Mapping[type, _Converter]] = {
    PlanDefinition: _Converter(definition_of, wire_definition)
}
_WIRE_TYPES: Final[Mapping[type, frozenset[str]]] = {
    float: frozenset({"Double", "Duration"}),
    int: frozenset({"UInteger", "UOctet"}),
    str: frozenset({"Identifier", "String"}),
}


@dataclass(frozen=True, slots=True)
class OperationCall:
    """An operation to call, with the parts that follow the command header."""

    service: str
    operation: str
    parts: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class RequestMapping:
    """Mapping of one type of request to an operation.

    Attributes:
        request: converts the parts after the command header to the request.
        parts: converts the request to these parts.
    """

    declaration: CommandDeclaration
    request: Callable[..., Request]
    parts: Callable[[Request], tuple[Any, ...]]


def invocation(request: Request) -> OperationCall:
    """Return the operation of a request, with its parts."""
    carrier = _CARRIERS[type(request)]
    declaration = carrier.declaration
    return OperationCall(declaration.service, declaration.operation, carrier.parts(request))


def carrier_of(declaration: CommandDeclaration) -> RequestMapping:
    """Return the mapping of a declared request.

    Raises:
        KeyError: the operation does not exist.
        SpecificationError: its parts differ from the arguments of the request.
    """
    where = f"{declaration.service}.{declaration.operation}"
    operation = mrs_specification().operation(declaration.service, declaration.operation)
    parts = operation.parts[InteractionStage.SUBMIT][1:]
    kind = declaration.kind
    arguments = [each for each in declaration.arguments if each.kind is not TargetFrame]
    if declaration.part is not None:
        return _in_one_part(where, declaration, parts)
    _require(where, arguments, parts)
    fields = [argument.field for argument in arguments]
    converters = [_converter(where, *pair) for pair in zip(arguments, parts, strict=True)]

    def request_of(*values: Any) -> Request:
        pairs = zip(converters, values, strict=True)
        request: Request = kind(*(converter.inward(value) for converter, value in pairs))
        return request

    def parts_of(request: Request) -> tuple[Any, ...]:
        pairs = zip(converters, fields, strict=True)
        return tuple(converter.outward(getattr(request, name)) for converter, name in pairs)

    return RequestMapping(declaration, request_of, parts_of)


def _in_one_part(
    where: str, declaration: CommandDeclaration, parts: Sequence[Field]
) -> RequestMapping:
    """Return the mapping of a request with one composite as its arguments, or NULL for none."""
    if [(part.name, part.nullable) for part in parts] != [(declaration.part, True)]:
        raise SpecificationError(f"{where}: its only part must be {declaration.part}, or NULL")
    nothing = declaration.kind()
    whole = _composite(where, declaration.kind, declaration.arguments, parts[0])
    return RequestMapping(
        declaration,
        lambda part: nothing if part is None else whole.inward(part),
        lambda request: (None if request == nothing else whole.outward(request),),
    )


def _converter(where: str, argument: Argument, part: Field) -> _Converter:
    inner = arguments_of(argument.kind)
    if issubclass(argument.kind, Enum):
        return _choice(where, argument.kind, part)
    if not inner:
        return _BY_HAND.get(argument.kind, _AS_IT_IS)
    one = _composite(where, argument.kind, inner, part)
    if not argument.repeated:
        return one
    return _Converter(
        lambda values: tuple(map(one.inward, values)),
        lambda values: tuple(map(one.outward, values)),
    )


def _choice(where: str, kind: type[Enum], part: Field) -> _Converter:
    cls = mrs_specification().classes[part.type.name]
    if list(cls.__members__) != list(kind.__members__):
        raise SpecificationError(f"{where}: {part.type.name} differs from the enum of the request")
    return _Converter(
        lambda value: None if value is None else kind[value.name],
        lambda value: None if value is None else cls[value.name],
    )


def _composite(where: str, kind: type, arguments: Sequence[Argument], part: Field) -> _Converter:
    bound = mrs_specification().types[replace(part.type, is_list=False)]
    _require(f"{where}, {part.type.name}", arguments, bound.fields)
    names = [(argument.field, argument.name) for argument in arguments]
    return _Converter(
        lambda value: kind(*(getattr(value, name) for _, name in names)),
        lambda value: bound.cls(**{name: getattr(value, field) for field, name in names}),
    )


def _require(where: str, arguments: Sequence[Argument], parts: Sequence[Field]) -> None:
    """Raise SpecificationError unless names, types and optionality equal those of the arguments."""
    expected = [_camel_case(argument.name) for argument in arguments]
    found = [part.name for part in parts]
    if expected != found:
        raise SpecificationError(f"{where} has parts {found}, the request {expected}")
    for argument, part in zip(arguments, parts, strict=True):
        chosen = issubclass(argument.kind, Enum)
        others = {argument.kind.__name__ if chosen else part.type.name}
        fits = part.type.name in _WIRE_TYPES.get(argument.kind, others)
        alike = (part.nullable, part.type.is_list) == (argument.optional, argument.repeated)
        if not (fits and alike):
            raise SpecificationError(f"{where}: {part.name} has another type in the request")


def _camel_case(name: str) -> str:
    first, *others = name.split("_")
    return first + "".join(map(str.title, others))


_CARRIERS: Final = {declaration.kind: carrier_of(declaration) for declaration in all_declarations()}

REQUESTS: Final[Mapping[tuple[str, str], Callable[..., Request]]] = {
    (carrier.declaration.service, carrier.declaration.operation): carrier.request
    for carrier in _CARRIERS.values()
}
"""Constructors of requests from the parts after the command header, by service and operation."""
