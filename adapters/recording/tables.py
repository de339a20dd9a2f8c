"""`frames`: a recording as pandas tables, one for each topic."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from adapters.recording.messages import KIND, START, TOPICS, plain_of, topic_of
from adapters.recording.run_file import RunReader
from adapters.recording.timed_items import read_timed

if TYPE_CHECKING:
    from pandas import DataFrame

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
