"""One example of every operation, in Python and in octets, for the interface page."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from textwrap import indent
from typing import Any, Final

from adapters.mal import (
    AttributeType,
    Codec,
    Field,
    NullableAttribute,
    Operation,
    Pattern,
    Stage,
    Subscription,
    Typed,
    UpdateHeader,
)
from adapters.mrs.specification import mrs_specification
from adapters.mrs.types import Notification, NotificationKind, Severity

COMMAND: Final = "command"
_WIDTH: Final = 88
_MESSAGES: Final = {
    Pattern.SUBMIT: (Stage.SUBMIT,),
    Pattern.REQUEST: (Stage.REQUEST, Stage.REQUEST_RESPONSE),
    Pattern.PROGRESS: (
        Stage.PROGRESS,
        Stage.PROGRESS_ACK,
        Stage.PROGRESS_UPDATE,
        Stage.PROGRESS_RESPONSE,
    ),
    Pattern.PUBSUB: (Stage.REGISTER, Stage.NOTIFY),
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
    "planId": "survey",
    "planIds": ("survey",),
    "providerURI": "maltcp://127.0.0.1:41000/MRS",
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
    "Attribute": Typed(AttributeType.DOUBLE, 1.5),
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
    "URI": "maltcp://127.0.0.1:41000/MRS",
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

    stage: Stage
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
            case Stage.REGISTER:
                values: tuple[Any, ...] = (Subscription(subscriptionId="all"),)
            case Stage.NOTIFY:
                values = ("all", _update_header(operation), *map(_value, parts[2:]))
            case Stage.SUBMIT if operation.name == "sendNotification":
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
            (answer,) = operation.parts[Stage.REQUEST_RESPONSE]
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
            return f"{type(value).__name__}.{value.name}"
        case Typed(kind, content):
            return f"Typed({source(kind)}, {source(content)})"
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
            value=Typed(AttributeType[key.type.name.upper()], _value(replace(key, nullable=False)))
        )
        for key in operation.keys
    )
    return UpdateHeader(source="jackal", domain=("meteron", "jackal"), keyValues=keys)


COMMAND_HEADER: Final = _composite("CommandHeader")
"""The `command` of the examples."""
