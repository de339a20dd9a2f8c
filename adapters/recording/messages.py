"""`encode`, `decode`: each item of a recording as a message, a topic and a JSON text.

Numbers are preserved to the last bit; values that are not finite are texts ("inf", "-inf", "nan").
Enums are stored by name. For camera pictures only the length is stored, and the end, which the core
checks for completeness.
"""

import base64
import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import EnumMeta
from functools import cache
from math import isfinite
from typing import Any, Final, get_args

from cattrs import Converter
from cattrs.preconf.json import make_converter
from cattrs.strategies import configure_tagged_union

from adapters.recording.rows import text_of
from executive.commands import Request
from executive.core.recording import (
    CargoChanged,
    CoreCall,
    CoreCalled,
    Decision,
    Entry,
    EventReported,
    ExecutiveKilled,
    FactObserved,
    Input,
    Item,
    LinkDarkChanged,
    ProcessStart,
    SafeModeEntered,
    SimulatedFaultChanged,
    SimulationItem,
    SimulationStarted,
    SimulationState,
    TimelinePlayed,
    TimelineStarted,
    TreeChanged,
    Truth,
)
from executive.settings import Settings, structure, unstructure
from executive.values.facts import END_WITHIN, Fact, Frame
from executive.values.reasons import Reason, UnknownReason
from trees import NodeStatus

START: Final = "/start"
DECISIONS: Final = "/out/"
_SIMULATION: Final = {
    Truth: "/truth/pose",
    SimulationStarted: "/sim/world",
    TimelineStarted: "/sim/timeline",
    TimelinePlayed: "/sim/played",
    SimulatedFaultChanged: "/sim/fault",
    CargoChanged: "/sim/cargo",
    ExecutiveKilled: "/sim/crash",
    LinkDarkChanged: "/sim/dark",
    SimulationState: "/sim/state",
}
KIND: Final = "kind"
"""Key that names the type of an object of a union."""
MAX_TIME_S: Final = 2.0**33
"""Upper bound of clock times; in UTC the year 2242."""
MAX_FRAME_OCTETS: Final = 1 << 25
"""Maximum size of a picture: several times the size of rover camera pictures."""


@dataclass(frozen=True, slots=True)
class RecordingTopic:
    """A topic, and the type of its messages.

    Attributes:
        kind: type of the items; for a `FactObserved` the type of its fact.
    """

    name: str
    kind: type


def _snake(kind: type) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind.__name__).lower()


_ENTRIES: Final = tuple(kind for kind in get_args(Entry) if kind not in {CoreCalled, FactObserved})
TOPICS: Final[Mapping[str, RecordingTopic]] = {
    topic.name: topic
    for topic in (
        RecordingTopic(START, ProcessStart),
        *(RecordingTopic(f"/in/{call.value}", CoreCalled) for call in CoreCall),
        *(RecordingTopic(f"/in/{_snake(fact)}", fact) for fact in get_args(Fact)),
        *(RecordingTopic(f"/in/{_snake(kind)}", kind) for kind in (*_ENTRIES, *get_args(Input))),
        *(RecordingTopic(f"{DECISIONS}{_snake(kind)}", kind) for kind in get_args(Decision)),
        *(RecordingTopic(_SIMULATION[kind], kind) for kind in get_args(SimulationItem)),
    )
}
"""All topics by name."""
_OF_KIND: Final = {topic.kind: topic for topic in TOPICS.values()}


def topic_of(item: Item) -> RecordingTopic:
    """Return the topic of an item."""
    if isinstance(item, CoreCalled):
        return TOPICS[f"/in/{item.call.value}"]
    return _OF_KIND[type(item.fact) if isinstance(item, FactObserved) else type(item)]


_FOR_FORK: Final = {
    SimulationStarted: "the world, its seed, and the accuracy of the sensors",
    SimulationState: "the state of the simulation at each second",
    TimelineStarted: "the reports that commands, faults and outages waited for",
}


def missing_for_fork(kinds: Collection[type]) -> tuple[str, ...]:
    """Return the missing parts of a recording for an exact fork, a line each.

    Recordings of rovers and of older versions lack all of it, those of a live simulation the last.

    Args:
        kinds: the types of all of its items.
    """
    missing = {kind: text for kind, text in _FOR_FORK.items() if kind not in kinds}
    return tuple(f"{_OF_KIND[kind].name} is missing: {text}" for kind, text in missing.items())


def plain_of(item: Item) -> dict[str, Any]:
    """Return an item as plain data."""
    plain: dict[str, Any] = _converter().unstructure(item)
    return plain


def encode(item: Item) -> bytes:
    """Return the JSON text of an item, UTF-8 encoded."""
    return text_of(plain_of(item)).encode()


def decode(topic: RecordingTopic, data: bytes) -> Any:
    """Return the item in a message of a topic.

    Raises:
        Exception: the data are no such item, or one that no executive records.
    """
    kind = FactObserved if topic.kind in get_args(Fact) else topic.kind
    item: Item = _converter().structure(json.loads(data), kind)
    match item:
        case CoreCalled() | FactObserved() | EventReported() | SafeModeEntered():
            _require(abs(item.now_s) < MAX_TIME_S and 0.0 <= item.utc_s < MAX_TIME_S, "time")
        case TreeChanged(nodes=nodes):
            _require({each.status for each in nodes} <= set(NodeStatus.__members__), "status")
        case (
            SimulationStarted(text=text)
            | TimelineStarted(text=text)
            | SimulatedFaultChanged(text=text)
            | SimulationState(text=text)
        ):
            json.loads(text)  # raises if it is none
        case _:
            pass
    return item


def _require(is_met: bool, what: str) -> None:
    if not is_met:
        raise ValueError(f"invalid {what}: no executive records it")


@cache
def _converter() -> Converter:
    converter = make_converter()
    converter.register_unstructure_hook(float, _plain)
    converter.register_structure_hook(float, _number)
    converter.register_structure_hook(int, _integer)
    is_enum = EnumMeta.__instancecheck__
    converter.register_unstructure_hook_func(
        lambda kind: is_enum(EnumMeta, kind), lambda each: each.name
    )
    converter.register_structure_hook_func(
        lambda kind: is_enum(EnumMeta, kind), lambda name, kind: kind[name]
    )
    converter.register_unstructure_hook(Frame, _without_picture)
    converter.register_structure_hook(Frame, _with_black_picture)
    converter.register_unstructure_hook(Settings, unstructure)
    converter.register_structure_hook(
        Settings, lambda raw, _: structure(raw, Settings, "settings of the recording")
    )
    converter.register_structure_hook_func(
        lambda kind: kind == (Reason | UnknownReason | None),
        lambda value, _: None if value is None else Reason[value],  # onboard all are known
    )
    for union in (Fact, Request):
        configure_tagged_union(union, converter, tag_name=KIND)
    return converter


def _plain(value: float) -> float | str:
    return value if isfinite(value) else str(value)


def _number(raw: float | str, _: type) -> float:
    """Return a number in its original type, int or float, because texts show the difference."""
    number = float(raw)  # raises for other types, and for numbers that are too large
    return number if isinstance(raw, str) else raw


def _integer(raw: object, _: type) -> int:
    """Return an integer within the 64 bits of ledger and wire."""
    if not isinstance(raw, int) or not -(1 << 63) <= raw < 1 << 63:
        raise ValueError("not an integer of 64 bits")
    return raw


def _without_picture(frame: Frame) -> dict[str, object]:
    end = base64.b64encode(frame.data[-END_WITHIN:]).decode()
    head = {"stamp_s": frame.stamp_s, "format": frame.format}
    return {**head, "length": len(frame.data), "end": end}


def _with_black_picture(raw: Mapping[str, Any], _: type) -> Frame:
    end = base64.b64decode(raw["end"])
    _require(len(end) <= raw["length"] <= MAX_FRAME_OCTETS, "length of a picture")
    return Frame(raw["stamp_s"], raw["format"], bytes(raw["length"] - len(end)) + end)
