"""Writes the interface page of the MRS, with an example of every operation, from its specification.

Usage: python -m tests.docs.interface_page > docs/mrs.md
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from math import pi
from textwrap import indent
from typing import Any, Final

from adapters.mal import (
    Area,
    AttributeType,
    Codec,
    CompositeType,
    EnumerationType,
    Field,
    Header,
    InteractionStage,
    NullableAttribute,
    Operation,
    Pattern,
    Service,
    Subscription,
    TypedAttribute,
    UpdateHeader,
    encode_message,
)
from adapters.mops import load_dictionary
from adapters.mrs.aboard.asset_services import ALL_EVENTS_HZ, EVENTS_HZ, PAGE
from adapters.mrs.aboard.file_services import LARGEST_CHUNK_OCTETS, MOST_LISTED, MOST_TRANSFERS
from adapters.mrs.aboard.gateway import MOST_PENDING
from adapters.mrs.aboard.served_operations import MESSAGE_CAP
from adapters.mrs.fleet.directory_service import (
    LONGEST_URI,
    MOST_OF_A_PEER,
    MOST_OPERATIONS,
    MOST_SERVICES,
)
from adapters.mrs.fleet.known_assets import MOST_ASSETS
from adapters.mrs.spec import LONGEST_SOURCE, LONGEST_TEXT, MOST_FIGURES
from adapters.mrs.spec.errors import MOST_AT_ONCE, AreaError, refused
from adapters.mrs.spec.mapping import MOST_ARGUMENTS
from adapters.mrs.spec.specification import mrs_specification
from adapters.mrs.spec.types import Notification, NotificationKind, Severity
from adapters.mrs.terms import NAME, PORT
from executive.commands import (
    ACCEPTED,
    Argument,
    AssetChoice,
    CommandDeclaration,
    Family,
    FilePath,
    Limit,
    Mode,
    SymmetricRange,
    ValueRange,
    arguments_of,
    declared,
)
from executive.plans.plan_xml import LARGEST_PLAN
from executive.settings import load_settings
from executive.state import LONGEST_PATH
from executive.values.parameters import Parameter
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity

_HEAD: Final = """# The METERON Robotic Services

Written by `python -m tests.docs.interface_page` from `adapters/mrs/spec/mrs.xml`, an MO
specification (ServiceSchema v003) that any MO tool can generate stubs from. SI units and radians;
`?` may be NULL; `[T]` is a list. How the services are served is told in `docs/mrs-rules.md`.
"""
_MESSAGE: Final = """\
A SUBMIT of MotionControl.stop. The header is the same whatever the body is encoded in; numbers are
big-endian. The answer is a message of SDU type 2 with the same transaction id and no body, or an
error: is-error set, then the number of the error and what is said with it.
"""
_LIMITS: Final = """\
Of every executive; [mrs-rules.md](mrs-rules.md) has them with what they are for. Too Many is the
standard error 65553."""
_EXAMPLES: Final = """\
Below each service stand examples: a call on `adapters.mal.Consumer`, and the body of each
message of it in fixed encoding. All of them use this header:"""
_STAGES: Final = {
    Pattern.SUBMIT: (InteractionStage.SUBMIT, InteractionStage.SUBMIT_ACK),
    Pattern.REQUEST: (InteractionStage.REQUEST, InteractionStage.REQUEST_RESPONSE),
}


_CODEC: Final = Codec(mrs_specification())
_TYPE_NAMES: Final = {cls: name for name, cls in mrs_specification().classes.items()}


def interface_page() -> str:
    """Return the page, in Markdown."""
    (area,) = (area for area in mrs_specification().areas if area.name == "MRS")
    return "\n".join((_HEAD, *_area(area)))


def _area(area: Area) -> Iterator[str]:
    yield f"Area {area.name}, number {area.number}, version {area.version}. {area.comment}"
    yield from ("", "## Limits", "", _LIMITS, "")
    yield from _table(("of", "at most", "beyond it"), _limits())
    yield from ("", "## A message, octet by octet", "", _MESSAGE)
    yield from _table(("offset", "octets", "meaning"), octet_dump())
    yield from ("", _EXAMPLES, "", "```python", f"command = {source(COMMAND_HEADER)}", "```")
    for service in area.services:
        yield from _service(service)
    yield from ("", "## Types", "")
    rows = ((t.name, t.short_form, _content(t)) for t in area.types)
    yield from _table(("type", "short form", "content"), rows)
    yield from ("", "## Errors", "")
    errors = ((e.number, e.name, e.comment) for e in area.errors)
    yield from _table(("number", "error", "meaning"), errors)
    yield from ("", "## Reasons", "", "The number travels as `Notification.code`.", "")
    yield from _table(("number", "reason", "as a refusal, the error"), map(_reason, Reason))
    yield from ("", "## Parameters", "")
    parameters = ((each.value, each.unit, each.description) for each in Parameter)
    yield from _table(("name", "unit", "meaning"), parameters)
    yield from ("", "## Commands", "", _COMMANDS, "")
    yield from _table(_COMMAND_HEADER, _command_rows())


def _limits() -> Iterator[tuple[str, str, str]]:
    """Yield what is bounded, by how much, and what comes of more."""
    in_list = f"{MOST_AT_ONCE} in one message"
    drive = load_settings("jackal").drive
    yield "a message to the rover", f"{MESSAGE_CAP:,} octets", "Too Many"
    yield "requests that wait for the core", f"{MOST_PENDING}, and any stop", "Too Many"
    yield "a source", f"{LONGEST_SOURCE} characters", "Invalid; a stop acts all the same"
    yield "motions that wait", f"{drive.queue_length} (`drive.queue_length`)", "Busy"
    yield "waypoints of a path", f"{drive.path_waypoints} (`drive.path_waypoints`)", "Invalid"
    yield "a plan", f"{LARGEST_PLAN:,} octets, {MOST_ARGUMENTS} arguments", "Invalid"
    yield "names, plan ids or values", in_list, "Too Many"
    yield "notifications asked for", f"{PAGE} at once", "the first ones come"
    yield "files listed", f"{MOST_LISTED} at once", "those changed last come"
    yield "a path", f"{LONGEST_PATH} characters", "Invalid"
    yield "chunkSize", f"{LARGEST_CHUNK_OCTETS:,} octets", "chunks are no larger"
    yield "transfers under way", f"{MOST_TRANSFERS}", "Busy"
    event = f"{LONGEST_TEXT} characters, {MOST_FIGURES} figures"
    yield "an event of others", event, "Invalid"
    yield "events of others", f"{EVENTS_HZ} a second of each, {ALL_EVENTS_HZ} of all", "Too Many"
    yield (
        "registered services",
        f"{MOST_SERVICES}, {MOST_OF_A_PEER} of one peer; {MOST_ASSETS} assets",
        "Too Many",
    )
    described = f"{MOST_OPERATIONS} operations, {LONGEST_URI} characters a URI"
    yield "a registered service", described, "Invalid"


def _service(service: Service) -> Iterator[str]:
    yield from ("", f"## {service.number} {service.name}", "", service.comment, "")
    header = ("number", "operation", "pattern", "in", "out", "errors", "purpose")
    yield from _table(header, map(_operation, service.operations))
    yield from ("", "```python", *_examples(service), "```")


def _examples(service: Service) -> Iterator[str]:
    for operation in service.operations:
        yield call(operation)
        for message in messages(operation):
            yield from _octets(message.stage.name, message.octets(_CODEC))


def _octets(name: str, body: bytes) -> Iterator[str]:
    """Yield a body in groups of four octets, eight groups a line."""
    rows = [body[at : at + 32].hex(" ", -4) for at in range(0, len(body), 32)] or ["no octets"]
    yield from (f"# {name:17} {rows[0]}", *(f"# {'':17} {row}" for row in rows[1:]))


def _operation(operation: Operation) -> tuple[object, ...]:
    match operation.pattern:
        case Pattern.SUBMIT | Pattern.REQUEST:
            taken, given = (_fields(operation.parts[s]) for s in _STAGES[operation.pattern])
        case Pattern.PUBSUB:
            taken = f"keys {_fields(operation.keys)}"
            given = _fields(operation.parts[InteractionStage.PUBLISH][1:])
        case _:
            first, *more = operation.parts.values()
            taken, given = _fields(first), "; then ".join(map(_fields, more))
    return (
        operation.number,
        operation.name,
        operation.pattern.name,
        taken,
        given,
        ", ".join(operation.errors),
        operation.comment,
    )


def _fields(fields: Iterable[Field]) -> str:
    return ", ".join(f"{field.name}: {_type(field)}" for field in fields)


def _type(field: Field) -> str:
    name = f"[{field.type.name}]" if field.type.is_list else field.type.name
    return name + ("?" if field.nullable else "")


def _content(definition: CompositeType | EnumerationType) -> str:
    match definition:
        case CompositeType():
            lines = (f"{f.name}: {_type(f)} – {f.comment}" for f in definition.fields)
        case EnumerationType():
            lines = (f"{i.value} {i.name} {i.comment}".rstrip() for i in definition.items)
    return "<br>".join((definition.comment, *lines))


def _reason(reason: Reason) -> tuple[object, ...]:
    if reason.value // 100 in {7, 8}:
        return reason.value, reason.name, "none: it ends a command that was taken"
    error = AreaError(refused(Refusal(reason, ""), Identity("", 0)).number)
    return reason.value, reason.name, error.name.title().replace("_", "")


def _table(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield "|---" * len(header) + "|"
    for row in rows:
        yield f"| {' | '.join(map(str, row))} |"


CLIENT: Final = "maltcp://127.0.0.1:50000/MOE"
PROVIDER: Final = f"maltcp://127.0.0.1:{PORT}/{NAME}"

_FIELDS: Final = (
    (4, "length of the message, these four octets included"),
    (1, "version 1 (3 bits), SDU type 1: SUBMIT (5 bits)"),
    (2, "area 3001, MRS"),
    (2, "service 8, MotionControl"),
    (2, "operation 7, stop"),
    (1, "version of the area"),
    (1, "is-error (1 bit), 1 (3 bits), 1 (4 bits); 0x91 in an error"),
    (8, "transaction id: the client's choice, returned in the answer"),
    (1, "fields that follow: 0x80 From, 0x40 To, 0x10 timestamp"),
    (1, "encoding id, always 0"),
    (4, "number of supplements"),
    (4 + len(CLIENT), f"From: length, {CLIENT}"),
    (4 + len(PROVIDER), f"To: length, {PROVIDER}"),
    (6, "timestamp: days since 1958-01-01 (2), milliseconds of the day (4)"),
    (8, "body begins: command.commandId, Long"),
    (7, "source: length, MOE"),
    (1, "counter is NULL"),
    (9, "lifetime is there: 60 s, a double"),
    (7, "creationTime is there: days and milliseconds as above"),
    (1, "reportStarted"),
    (1, "reportProgress"),
)


def stop_message() -> bytes:
    """Return a SUBMIT of MotionControl.stop, in fixed encoding."""
    operation = mrs_specification().operation("MotionControl", "stop")
    header = Header.of(operation, InteractionStage.SUBMIT, 1, CLIENT, PROVIDER, TIME_NS)
    codec = Codec(mrs_specification())
    return encode_message(
        header, codec.encode(operation.parts[InteractionStage.SUBMIT], (COMMAND_HEADER,))
    )


def octet_dump() -> Iterator[tuple[int, str, str]]:
    """Yield offset, octets and meaning of each field of the message, in order."""
    octets, at = stop_message(), 0
    for length, meaning in _FIELDS:
        yield at, octets[at : at + length].hex(), meaning
        at += length


COMMAND: Final = "command"
_WIDTH: Final = 88
_MESSAGES: Final = {
    Pattern.SUBMIT: (InteractionStage.SUBMIT,),
    Pattern.REQUEST: (InteractionStage.REQUEST, InteractionStage.REQUEST_RESPONSE),
    Pattern.PROGRESS: (
        InteractionStage.PROGRESS,
        InteractionStage.PROGRESS_ACK,
        InteractionStage.PROGRESS_UPDATE,
        InteractionStage.PROGRESS_RESPONSE,
    ),
    Pattern.PUBSUB: (InteractionStage.REGISTER, InteractionStage.NOTIFY),
}
TIME_NS: Final = 1_700_000_000_000_000_000
_BY_NAME: Final[dict[str, Any]] = {
    "action": "VIDEO ON",
    "angle": 0.5,
    "asset": "jackal",
    "commandId": 7,
    "content": b'<root BTCPP_format="4"/>',
    "creationTime": TIME_NS,
    "currentRotateSpeed": 0.0,
    "currentTravelSpeed": 0.25,
    "data": b"\xff\xd8\xff\xe0",
    "distance": 1.5,
    "domain": ("meteron", "jackal"),
    "format": "BTCPP4",
    "heading": 0.5,
    "keyArea": 3001,
    "keyService": 7,
    "lifetime": 60.0,
    "mimeType": "image/jpeg",
    "name": "Camera",
    "names": ("POS_X", "POS_Y"),
    "pan": 0.5,
    "path": "pictures/MOE-7.jpg",
    "operation": "moveTo",
    "planId": "survey",
    "planIds": ("survey",),
    "providerURI": PROVIDER,
    "rotate": 0.25,
    "rotateSpeed": 1.0,
    "since": 42,
    "source": "MOE",
    "speed": 0.5,
    "target": "kept/rock.jpg",
    "tilt": -0.25,
    "travel": 0.5,
    "travelSpeed": 1.0,
    "unit": "m",
    "x": 3.0,
    "y": 2.0,
    "z": 0.0,
}
_BY_TYPE: Final[dict[str, Any]] = {
    "Attribute": TypedAttribute(AttributeType.DOUBLE, 1.5),
    "Blob": b"\x01\x02",
    "Boolean": True,
    "Double": 1.5,
    "Duration": 2.0,
    "Identifier": "POS_X",
    "Integer": 1,
    "Long": 7,
    "String": "text",
    "Time": TIME_NS,
    "UInteger": 2,
    "ULong": 42,
    "UOctet": 1,
    "URI": PROVIDER,
    "UShort": 1,
}


_EVENT: Final = Notification(
    kind=NotificationKind.EVENT,
    severity=Severity.WARNING,
    timestamp=TIME_NS,
    sequence=0,
    text="dust on the lens",
)


@dataclass(frozen=True, slots=True)
class Message:
    """One message of an interaction: its stage, its parts, and the values of the example."""

    stage: InteractionStage
    parts: tuple[Field, ...]
    values: tuple[Any, ...]

    def octets(self, codec: Codec) -> bytes:
        """Return the body."""
        return codec.encode(self.parts, self.values)


def messages(operation: Operation) -> Iterator[Message]:
    """Yield an example of each message of an operation, in the order in which they travel."""
    for stage in _MESSAGES[operation.pattern]:
        parts = operation.parts[stage]
        match stage:
            case InteractionStage.REGISTER:
                values: tuple[Any, ...] = (Subscription(subscriptionId="all"),)
            case InteractionStage.NOTIFY:
                values = ("all", _update_header(operation), *map(_value, parts[2:]))
            case InteractionStage.SUBMIT if operation.name == "sendNotification":
                values = (_EVENT,)
            case _:
                values = tuple(map(_value, parts))
        yield Message(stage, parts, values)


def call(operation: Operation) -> str:
    """Return the Python that makes an operation's example happen, on a `Consumer`."""
    first = next(messages(operation))
    named = [f'"{operation.service_name}"', f'"{operation.name}"']
    named += [
        COMMAND if part.name == COMMAND else source(value)
        for part, value in zip(first.parts, first.values, strict=True)
    ]
    match operation.pattern:
        case Pattern.SUBMIT:
            return _call("await consumer.submit", named)
        case Pattern.REQUEST:
            (answer,) = operation.parts[InteractionStage.REQUEST_RESPONSE]
            return _call(f"({answer.name},) = await consumer.request", named)
        case Pattern.PROGRESS:
            opened = _call("async with consumer.progress", named)
            return f"{opened} as progress:\n    (file,) = progress.acknowledgement"
        case _:
            return _call("await consumer.subscribe", [*named, "on_update"])


def source(value: Any) -> str:
    """Return a value as Python that makes it, over several lines where one would be too long."""
    match value:
        case Enum():
            return f"{_TYPE_NAMES.get(type(value), type(value).__name__)}.{value.name}"
        case TypedAttribute(kind, content):
            return f"TypedAttribute({source(kind)}, {source(content)})"
        case tuple():
            return _call("", [*map(source, value)], "," if len(value) == 1 else "")
        case str():
            return '"' + value.replace('"', '\\"') + '"'
        case _ if is_dataclass(value):
            given = ((f.name, getattr(value, f.name)) for f in fields(value))
            inside = [f"{name}={source(one)}" for name, one in given if one is not None]
            return _call(type(value).__name__, inside)
        case _:
            return repr(value)


def _call(head: str, arguments: Sequence[str], last: str = "") -> str:
    one = f"{head}({', '.join(arguments)}{last})"
    if len(one) <= _WIDTH and "\n" not in one:
        return one
    return "\n".join([f"{head}(", *(indent(f"{a},", "    ") for a in arguments), ")"])


def _value(part: Field) -> Any:
    """Return a value; of what may be NULL, only what has an example of its own name."""
    if part.type.name in _BY_TYPE and part.name in _BY_NAME:
        return _BY_NAME[part.name]
    if part.nullable and part.type.name != "Attribute":
        return None
    one = _BY_TYPE[part.type.name] if part.type.name in _BY_TYPE else _made(part.type.name)
    return (one,) if part.type.is_list else one


def _made(name: str) -> Any:
    cls = mrs_specification().classes[name]
    return next(iter(cls)) if issubclass(cls, Enum) else _composite(name)


def _composite(name: str) -> Any:
    (bound,) = (b for ref, b in mrs_specification().types.items() if ref.name == name)
    return bound.cls(**{field.name: _value(field) for field in bound.fields})


def _update_header(operation: Operation) -> UpdateHeader:
    keys = tuple(
        NullableAttribute(
            value=TypedAttribute(
                AttributeType[key.type.name.upper()], _value(replace(key, nullable=False))
            )
        )
        for key in operation.keys
    )
    return UpdateHeader(source="jackal", domain=("meteron", "jackal"), keyValues=keys)


COMMAND_HEADER: Final = _composite("CommandHeader")
"""The `command` of the examples."""


_COMMANDS: Final = """\
The operations that command a rover, by their names in `rover command`, scenarios and as leaves of
plans (where there is no stop, no resume and no command of plans). `?` may be left out. A bound such
as drive.distance_m is one of the asset's settings, `config/<asset>.yaml`. MOPS is code and name of
the message by the relay, whose inputs are the arguments in this order."""
_COMMAND_HEADER: Final = (
    "command",
    "what it does",
    "arguments",
    "accepted in",
    "operation",
    "MOPS",
    "as typed",
)


def _command_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each command."""
    mops = load_dictionary().commands
    for each in declared():
        spelled = mops.get(each.name)
        yield (
            f"`{each.name}`",
            each.summary,
            "<br>".join(map(_argument, each.written)),
            _modes(each.family),
            f"{each.service}.{each.operation}",
            "" if spelled is None else f"{spelled.code:03X} {spelled.command}",
            "<br>".join(_typed(each)),
        )


def _argument(argument: Argument) -> str:
    relayed = "" if argument.relayed else "not by the relay"
    facts = ", ".join(filter(None, (argument.meaning, _values(argument), relayed)))
    optional = "?" if argument.optional else ""
    if argument.many:
        names = ", ".join(part.name for part in arguments_of(argument.kind))
        facts = f"each with {names} as above, {facts}"
    return f"`{argument.name}`{optional} {facts}".rstrip()


def _values(argument: Argument) -> str:
    match argument.bound:
        case ValueRange(low, high, or_zero):
            if low is None:
                return f"±{_limit(high)}"
            return f"{_limit(low)} to {_limit(high)}{' or 0' if or_zero else ''}"
        case SymmetricRange(low, high):
            return f"±({high} − {low})"
        case AssetChoice(path):
            return "refused: it is fixed" if path is None else f"as {path}"
        case FilePath() | None:
            return ""


def _limit(limit: Limit) -> str:
    if isinstance(limit, str):
        return limit
    return "2π" if limit == 2 * pi else f"{limit:g}"


def _modes(family: Family) -> str:
    accepted = ACCEPTED[family]
    return "any mode" if accepted == set(Mode) else ", ".join(m.name for m in Mode if m in accepted)


def _typed(declaration: CommandDeclaration) -> Iterator[str]:
    for typed in declaration.examples:
        yield f"`{f'{declaration.name} {typed}'.rstrip()}`"


if __name__ == "__main__":
    print(interface_page())
