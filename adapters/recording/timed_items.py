"""A recording as items with times, as tables of pandas, or as its `RunHistory`."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_args

from adapters.recording.container import RecordingError
from adapters.recording.messages import KIND, START, TOPICS, plain_of, topic_of
from adapters.recording.run_file import RunReader
from executive.core.recording import Entry, Item, ProcessStart, Truth
from executive.history import RunHistory
from executive.history.history_builder import KINDS, HistoryBuilder
from trees import leaf_paths

if TYPE_CHECKING:
    from pandas import DataFrame


_ALWAYS: Final = frozenset({ProcessStart, *get_args(Entry)})


@dataclass(frozen=True, slots=True)
class TimedItem:
    """An item with its time.

    Attributes:
        time_s: time since the first entry, by the onboard wall clock.
        utc_s: the same in seconds since 1970-01-01 UTC.
    """

    time_s: float
    utc_s: float
    item: Item


def read_timed(reader: RunReader, kinds: Collection[type]) -> Iterator[TimedItem]:
    """Yield the items of the given types in order, and all starts and calls.

    Facts are selected by their own types; other items are skipped without decoding.

    Raises:
        RecordingError: the file cannot be used as a recording, or contains no run.
    """
    wanted = _ALWAYS | frozenset(kinds)
    began_s: float | None = None
    utc_s = apart_s = 0.0
    start: ProcessStart | None = None
    for message in reader.messages(wanted):
        item: Item = reader.decoded(message)
        if isinstance(item, ProcessStart):
            start = item
            continue  # it gets the time of the following entry
        at_s = utc_s
        if isinstance(item, Entry):
            at_s = utc_s = item.utc_s
            apart_s = item.utc_s - item.now_s
        elif isinstance(item, Truth):
            at_s = item.time_s + apart_s if began_s is not None else 0.0
        if began_s is None:
            if not isinstance(item, Entry):
                continue
            began_s = utc_s
        if start is not None:
            yield TimedItem(utc_s - began_s, utc_s, start)
            start = None
        yield TimedItem(at_s - began_s, at_s, item)
    if began_s is None:
        raise RecordingError(f"{reader.path}: contains no run")


def read_history(path: Path, until_s: float | None = None) -> tuple[RunHistory, float]:
    """Return the history of a recorded run, and its begin in seconds since 1970-01-01 UTC.

    Items later than `until_s` after its beginning are omitted.

    Raises:
        RecordingError: the file cannot be used as a recording, or contains no run.
    """
    builder = HistoryBuilder(leaf_paths)
    began_utc_s: float | None = None
    for each in read_timed(RunReader(path), KINDS):
        if until_s is not None and each.time_s > until_s + 1e-6:
            break
        if began_utc_s is None:
            began_utc_s = each.utc_s - each.time_s
        builder.put(each.item)
    assert began_utc_s is not None
    return builder.history(), began_utc_s


_NOT_FINITE: Final = {text: float(text) for text in ("inf", "-inf", "nan")}
_TIMES: Final = ("now_s", "utc_s", "time_s")


def frames(path: Path | str, topics: Collection[str] = TOPICS) -> "dict[str, DataFrame]":
    """Return a table for each topic that has messages, except `/start`.

    The index is the time in seconds since the first call of the core. The columns are the fields of
    the messages, such as `pose.x_m`; lists of numbers have a column each, such as `left_radps.0`.
    Other lists stay as they are. `attrs["began_utc_s"]` is the begin of the recording.

    Raises:
        RecordingError: the file cannot be used as a recording, or contains no run.
    """
    from pandas import DataFrame, Index

    rows: dict[str, list[dict[str, Any]]] = {}
    times_s: dict[str, list[float]] = {}
    began_utc_s: float | None = None
    kinds = {topic.kind for name, topic in TOPICS.items() if name in topics}
    for timed in read_timed(RunReader(Path(path)), kinds):
        began_utc_s = timed.utc_s if began_utc_s is None else began_utc_s
        name = topic_of(timed.item).name
        if name in topics and name != START:
            times_s.setdefault(name, []).append(timed.time_s)
            rows.setdefault(name, []).append(dict(_columns(plain_of(timed.item))))
    made = {}
    for name, each in rows.items():
        table = DataFrame(each, index=Index(times_s[name], name="time_s"))
        table.attrs["began_utc_s"] = began_utc_s
        made[name] = table
    return made


def _columns(raw: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in raw.items():
        name = f"{above}{key}"
        if isinstance(value, dict):
            yield from _columns(value, "" if name == "fact" else f"{name}.")
        elif isinstance(value, list) and all(map(_is_number, value)):
            yield from _columns({str(index): each for index, each in enumerate(value)}, f"{name}.")
        elif name not in {*_TIMES, KIND}:
            yield name, _NOT_FINITE.get(value, value) if isinstance(value, str) else value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) or (isinstance(value, str) and value in _NOT_FINITE)
