"""Commands of the core as MRS operations with their headers, and back.

Requests travel as their declarations and the XML say. An operation that the XML lacks, or whose
parts are not the arguments of the request, is an error on import.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

from adapters.mal import AttributeType, Field, NamedValue, SpecificationError, Stage, Typed
from adapters.mrs.spec.errors import AreaError, invalid, with_text
from adapters.mrs.spec.specification import mrs_specification
from adapters.mrs.spec.types import CommandHeader
from adapters.mrs.spec.values import (
    LONGEST_SOURCE,
    NS_PER_S,
    definition_of,
    to_ns,
    wire_definition,
)
from executive.commands import (
    Argument,
    Arrival,
    Command,
    Declaration,
    PlanDefinition,
    Request,
    Stop,
    arguments_of,
    declared,
)
from executive.reports import Identity


class _Converter(NamedTuple):
    """What makes a value of the core of one of the wire, and the other way round."""

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
class Invocation:
    """An operation to call, with the parts that follow the command header."""

    service: str
    operation: str
    parts: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class Carrier:
    """How one kind of request travels.

    Attributes:
        request: makes the request of the parts that follow the command header.
        parts: makes those parts of the request.
    """

    declaration: Declaration
    request: Callable[..., Request]
    parts: Callable[[Request], tuple[Any, ...]]


def invocation(request: Request) -> Invocation:
    """Return the operation that carries a request."""
    carrier = _CARRIERS[type(request)]
    declaration = carrier.declaration
    return Invocation(declaration.service, declaration.operation, carrier.parts(request))


def carrier_of(declaration: Declaration) -> Carrier:
    """Return how a declared request travels.

    Raises:
        KeyError: there is no such operation.
        SpecificationError: its parts are not the arguments of the request.
    """
    where = f"{declaration.service}.{declaration.operation}"
    operation = mrs_specification().operation(declaration.service, declaration.operation)
    parts = operation.parts[Stage.SUBMIT][1:]
    kind, arguments = declaration.kind, declaration.arguments
    if declaration.part is not None:
        return _in_one_part(where, declaration, parts)
    _require(where, arguments, parts)
    fields = [argument.field for argument in arguments]
    converters = [_converter(where, *pair) for pair in zip(arguments, parts, strict=True)]
    if all(converter is _AS_IT_IS for converter in converters):
        return Carrier(
            declaration, kind, lambda request: tuple(getattr(request, name) for name in fields)
        )

    def request_of(*values: Any) -> Request:
        pairs = zip(converters, values, strict=True)
        request: Request = kind(*(converter.inward(value) for converter, value in pairs))
        return request

    def parts_of(request: Request) -> tuple[Any, ...]:
        pairs = zip(converters, fields, strict=True)
        return tuple(converter.outward(getattr(request, name)) for converter, name in pairs)

    return Carrier(declaration, request_of, parts_of)


def _in_one_part(where: str, declaration: Declaration, parts: Sequence[Field]) -> Carrier:
    """Return the carrier of a request whose arguments are one composite, or NULL for none."""
    if [(part.name, part.nullable) for part in parts] != [(declaration.part, True)]:
        raise SpecificationError(f"{where}: its one part is to be {declaration.part}, or NULL")
    nothing = declaration.kind()
    whole = _composite(where, declaration.kind, declaration.arguments, parts[0])
    return Carrier(
        declaration,
        lambda part: nothing if part is None else whole.inward(part),
        lambda request: (None if request == nothing else whole.outward(request),),
    )


def _converter(where: str, argument: Argument, part: Field) -> _Converter:
    inner = arguments_of(argument.kind)
    if not inner:
        return _BY_HAND.get(argument.kind, _AS_IT_IS)
    one = _composite(where, argument.kind, inner, part)
    if not argument.many:
        return one
    return _Converter(
        lambda values: tuple(map(one.inward, values)),
        lambda values: tuple(map(one.outward, values)),
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
    """Raise SpecificationError unless the parts are the arguments: name, type, whether optional."""
    wanted = [_camel_case(argument.name) for argument in arguments]
    found = [part.name for part in parts]
    if wanted != found:
        raise SpecificationError(f"{where} has {found} where the request has {wanted}")
    for argument, part in zip(arguments, parts, strict=True):
        fits = part.type.name in _WIRE_TYPES.get(argument.kind, {part.type.name})
        alike = (part.nullable, part.type.is_list) == (argument.optional, argument.many)
        if not (fits and alike):
            raise SpecificationError(f"{where}: {part.name} is of another type in the request")


def _camel_case(name: str) -> str:
    first, *others = name.split("_")
    return first + "".join(map(str.title, others))


_CARRIERS: Final = {declaration.kind: carrier_of(declaration) for declaration in declared()}

REQUESTS: Final[Mapping[tuple[str, str], Callable[..., Request]]] = {
    (carrier.declaration.service, carrier.declaration.operation): carrier.request
    for carrier in _CARRIERS.values()
}
"""What makes a request of the parts that follow the command header, by service and operation."""

LINK: Final = "direct"
ARRIVAL: Final = "arrival"
"""The supplement that says what a motion command does to motion under way: append or replace."""
AUTHORITY: Final = "authority"
"""The supplement that claims the authority of an epoch."""


def command_of(
    header: CommandHeader,
    supplements: tuple[NamedValue, ...],
    request: Request,
    peer: str | None = None,
) -> Command:
    """Return the command that came with a header; nothing of it keeps a stop from the core.

    Args:
        header: what came first.
        supplements: what came beside it.
        request: what the rest means.
        peer: the name that the connection has proof of; None if it has none.

    Raises:
        MalError: Invalid, the supplement `arrival` is there and neither append nor replace, or
            `authority` and no Long, or the source's name is too long.
    """
    if isinstance(request, Stop):
        supplements = ()
    elif len(header.source) > LONGEST_SOURCE:
        raise invalid(0)
    created_ns = header.creationTime
    return Command(
        identity=Identity(header.source, header.commandId),
        request=request,
        link=LINK,
        created_utc_s=None if created_ns is None else created_ns / NS_PER_S,
        lifetime_s=header.lifetime,
        counter=header.counter,
        report_started=header.reportStarted,
        report_progress=header.reportProgress,
        arrival=_arrival(supplements) if supplements else Arrival.APPEND,
        authority=_authority(supplements) if supplements else None,
        peer=peer,
    )


def header_of(command: Command) -> CommandHeader:
    """Return the header that a command travels with."""
    created_s = command.created_utc_s
    return CommandHeader(
        commandId=command.identity.command_id,
        source=command.identity.source,
        counter=command.counter,
        lifetime=command.lifetime_s,
        creationTime=None if created_s is None else to_ns(created_s),
        reportStarted=command.report_started,
        reportProgress=command.report_progress,
    )


def supplements_of(command: Command) -> tuple[NamedValue, ...]:
    """Return the supplements that a command travels with; none for the defaults."""
    found = []
    if command.arrival is not Arrival.APPEND:
        found.append((ARRIVAL, Typed(AttributeType.IDENTIFIER, command.arrival.value)))
    if command.authority is not None:
        found.append((AUTHORITY, Typed(AttributeType.LONG, command.authority)))
    return tuple(NamedValue(name=name, value=value) for name, value in found)


def _named(name: str, supplements: tuple[NamedValue, ...]) -> list[Typed | None]:
    return [supplement.value for supplement in supplements if supplement.name == name]


def _authority(supplements: tuple[NamedValue, ...]) -> int | None:
    match _named(AUTHORITY, supplements):
        case []:
            return None
        case [Typed(type=AttributeType.LONG, value=int(epoch))]:
            return epoch
        case _:
            raise with_text(AreaError.INVALID, f"supplement {AUTHORITY}: one Long, the epoch")


def _arrival(supplements: tuple[NamedValue, ...]) -> Arrival:
    match _named(ARRIVAL, supplements):
        case []:
            return Arrival.APPEND
        case [Typed(type=AttributeType.IDENTIFIER, value=text)] if text in _ARRIVALS:
            return Arrival(text)
        case _:
            text = f"supplement {ARRIVAL}: one Identifier, {' or '.join(sorted(_ARRIVALS))}"
            raise with_text(AreaError.INVALID, text)


_ARRIVALS: Final = {arrival.value for arrival in Arrival}
