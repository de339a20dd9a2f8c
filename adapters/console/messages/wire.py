"""`encode` and other conversions of messages to JSON, and the topics to which pages subscribe."""

import json
from dataclasses import fields
from enum import Enum
from math import isfinite
from typing import Any, Final

from adapters.console.messages.commands import (
    AuthorityMessage,
    CommandState,
    CommandStatus,
    StageEntry,
    StopStatus,
)
from adapters.console.messages.pages import DictionaryChanged, Hello, ObjectChanged, Presence
from adapters.console.messages.reports import (
    AlarmStatus,
    FileChanged,
    NotificationMessage,
    PlanProgress,
    QuestionStatus,
    Transfer,
    TransferState,
)
from adapters.console.messages.telemetry import (
    AssetState,
    LinkKind,
    LinkStatus,
    PosePrediction,
    Sample,
    SamplesDropped,
    TreeState,
)

Broadcast = (
    CommandStatus
    | StopStatus
    | AuthorityMessage
    | NotificationMessage
    | AlarmStatus
    | LinkStatus
    | AssetState
    | PlanProgress
    | QuestionStatus
    | FileChanged
    | Presence
    | DictionaryChanged
    | ObjectChanged
)
"""Messages that are numbered, never dropped, and resent to a page that reconnects."""


Latest = TreeState | PosePrediction | Transfer
"""Messages that carry a complete state, so that the last one of a topic replaces the others."""


Message = Hello | Sample | Latest | SamplesDropped | Broadcast


def topic_of(message: Message) -> str:
    """Return the topic of a message: its type, asset, and key or id."""
    match message:
        case Sample(asset=asset, key=key):
            return f"{message.ty}:{asset}:{key}"
        case Transfer(asset=asset, id=name):
            return f"{message.ty}:{asset}:{name}"
        case Hello() | SamplesDropped() | Presence() | ObjectChanged():
            return message.ty
        case _:
            return f"{message.ty}:{message.asset}"


def is_wanted(topic: str, topics: frozenset[str]) -> bool:
    """Whether a topic matches one of the subscriptions, which may be prefixes that end in `*`.

    `cmd` matches all topics of that type, as `cmd:*` does.
    """
    return topic in topics or any(
        topic.startswith(each[:-1]) if each.endswith("*") else topic.startswith(f"{each}:")
        for each in topics
    )


def plain(value: Any) -> Any:
    """Return a value, or a dataclass with its field names as keys, as plain data for JSON.

    Floats that are not finite become "NaN", "Infinity" or "-Infinity", which `Number()` reads.
    """
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return value if isfinite(value) else _NOT_FINITE.get(value, "NaN")
        case Enum():
            return value.value
        case dict():
            return {key: plain(each) for key, each in value.items()}
        case tuple() | list():
            return [plain(each) for each in value]
        case _:
            return {name: plain(getattr(value, name)) for name in _names(type(value))}


def encode(message: Message, seq: int | None = None) -> str:
    """Return a message as JSON, with its number if it has one."""
    numbered = {} if seq is None else {"seq": seq}
    return json.dumps({"ty": message.ty, **numbered, **plain(message)}, separators=(",", ":"))


def decode_command(body: dict[str, Any]) -> CommandStatus:
    """Return the command of a body from `encode`."""
    given = {name: body[name] for name in _names(CommandStatus)}
    history = tuple(StageEntry(**reached) for reached in body["history"])
    given |= {
        "link": LinkKind(body["link"]),
        "state": CommandState(body["state"]),
        "history": history,
    }
    return CommandStatus(**given)


def decode_transfer(body: dict[str, Any]) -> Transfer:
    """Return the transfer of a body from `plain`."""
    given = {name: body[name] for name in _names(Transfer)}
    return Transfer(**given | {"state": TransferState(body["state"])})


_NOT_FINITE: Final = {float("inf"): "Infinity", float("-inf"): "-Infinity"}


def _names(kind: Any) -> tuple[str, ...]:
    if kind not in _NAMES:
        _NAMES[kind] = tuple(each.name for each in fields(kind))
    return _NAMES[kind]


_NAMES: Final[dict[Any, tuple[str, ...]]] = {}
