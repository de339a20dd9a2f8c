"""A recording read for people: its items with the time since its beginning, and its history."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, get_args

from adapters.recording.container import RecordingError
from adapters.recording.run_file import RunReader
from executive.core.recording import Entry, Item, Life, Truth
from executive.history import KINDS, HistoryBuilder, RunHistory
from trees import leaf_paths

_ALWAYS: Final = frozenset({Life, *get_args(Entry)})


@dataclass(frozen=True, slots=True)
class TimedItem:
    """An item, and when it came.

    Attributes:
        time_s: since the first entry, by the wall clock aboard.
        utc_s: the same, seconds since 1970-01-01 UTC.
    """

    time_s: float
    utc_s: float
    item: Item


def read_timed(reader: RunReader, kinds: Collection[type]) -> Iterator[TimedItem]:
    """Yield the items of some kinds in their order, and all starts and calls.

    Facts are named by their own kinds; the others are skipped unread.

    Raises:
        RecordingError: the file cannot be used as a recording, or holds no run.
    """
    wanted = _ALWAYS | frozenset(kinds)
    began_s: float | None = None
    utc_s = apart_s = 0.0
    life: Life | None = None
    for message in reader.messages(wanted):
        item: Item = reader.decoded(message)
        if isinstance(item, Life):
            life = item
            continue  # its time is that of the entry after it
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
        if life is not None:
            yield TimedItem(utc_s - began_s, utc_s, life)
            life = None
        yield TimedItem(at_s - began_s, at_s, item)
    if began_s is None:
        raise RecordingError(f"{reader.path}: holds no run")


def read_history(path: Path, until_s: float | None = None) -> tuple[RunHistory, float]:
    """Return what a recording knows, and when it began, seconds since 1970-01-01 UTC.

    What came later than `until_s` after its beginning is left out.

    Raises:
        RecordingError: the file cannot be used as a recording, or holds no run.
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
