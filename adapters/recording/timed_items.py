"""`read_timed`: a recording's items with their times; `read_history`: its `RunHistory`."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, get_args

from adapters.recording.container import RecordingError
from adapters.recording.run_file import RunReader
from executive.core.recording import Entry, Item, ProcessStart, Truth
from executive.history import RunHistory
from executive.history.history_builder import KINDS, HistoryBuilder
from trees import leaf_paths

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
