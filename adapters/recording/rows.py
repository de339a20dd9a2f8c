"""Items of a recording as rows: the names of their parts once in a file, then values alone.

A batch is a JSON object. `shapes` are those that its rows are the first to use: a topic, and the
names in its messages, nested as they are. Each of `rows` is the number of its shape, in the order
in which the file brings them, and the values. So a message comes back as it was, to the last
character.
"""

import json
import re
from collections.abc import Iterator
from typing import Any, Final

from adapters.recording.container import DamageError, damage_in

Shape = tuple["str | tuple[str, Shape]", ...]
"""Names of parts; with its own shape where a part is an object."""

MAX_VALUES: Final = 500_000
"""In a batch, each of up to 72 octets in memory. Measured: 9,000 with a laser of 720 rays."""
_SURROGATE: Final = re.compile(rb"\\u[dD][89a-fA-F]")
"""What begins an escaped surrogate."""
_TIMES: Final = ("now_s", "utc_s")
_SHAPES: Final = "shapes"
_ROWS: Final = "rows"


def text_of(plain: object) -> str:
    """Return the JSON text of plain data; texts that differ are data that differ."""
    return json.dumps(plain, allow_nan=False, separators=(",", ":"))


class RowWriter:
    """Makes batches of the messages that a file holds.

    Attributes:
        size_octets: of the batch that is being filled.
    """

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, Shape], int] = {}
        self._shapes: list[str] = []
        self._rows: list[str] = []
        self.size_octets = 0

    def put(self, topic: str, plain: dict[str, Any]) -> None:
        """Add a message."""
        values: list[object] = []
        key = topic, _taken_apart(plain, values)
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self._numbers)
            self._shapes.append(text_of(key))
        row = text_of([number, *values])
        self._rows.append(row)
        self.size_octets += len(row)

    def take(self) -> bytes | None:
        """Return the batch, and begin another; None where nothing was put."""
        if not self._rows:
            return None
        shapes, rows = ",".join(self._shapes), ",".join(self._rows)
        self._shapes, self._rows, self.size_octets = [], [], 0
        return f'{{"{_SHAPES}":[{shapes}],"{_ROWS}":[{rows}]}}'.encode()


class RowReader:
    """Reads the batches of a file, in its order."""

    def __init__(self) -> None:
        self._shapes: list[tuple[str, Shape]] = []

    def rows(self, batch: bytes) -> "list[RecordedRow]":
        """Return the messages of the next batch.

        Raises:
            DamageError: it is no batch, or not the next.
        """
        with damage_in("a batch of rows"):
            raw = _parsed(batch)
            # A dictionary refuses what is no name.
            self._shapes += dict.fromkeys((topic, _shape(names)) for topic, names in raw[_SHAPES])
            found = []
            for number, *values in raw[_ROWS]:
                topic, shape = self._shapes[number if number >= 0 else len(self._shapes)]
                found.append(RecordedRow(topic, shape, values))
            return found


class RecordedRow:
    """A message whose text is made only where it is wanted."""

    __slots__ = ("_shape", "_values", "topic")

    def __init__(self, topic: str, shape: Shape, values: list[Any]) -> None:
        self.topic = topic
        self._shape = shape
        self._values = values

    @property
    def utc_s(self) -> float | None:
        """The wall clock of an entry of the core; None of another message."""
        if self._shape[:2] != _TIMES or len(self._values) < 2:
            return None
        return self._values[1] if isinstance(self._values[1], float) else None

    @property
    def data(self) -> bytes:
        """The JSON text of the message.

        Raises:
            DamageError: it has not the values of its shape, or such as JSON has not.
        """
        values = iter(self._values)
        try:
            text = text_of(_put_together(self._shape, values))
        except (StopIteration, ValueError, RecursionError) as error:
            raise DamageError(f"a row cannot be read: {error!r}") from error
        if next(values, self) is not self:
            raise DamageError("a row is longer than its shape")
        return text.encode()


def _taken_apart(plain: dict[str, Any], values: list[object]) -> Shape:
    shape: list[str | tuple[str, Shape]] = []
    for name, part in plain.items():
        if isinstance(part, dict):
            shape.append((name, _taken_apart(part, values)))
        else:
            shape.append(name)
            values.append(part)
    return tuple(shape)


def _put_together(shape: Shape, values: Iterator[Any]) -> dict[str, Any]:
    plain: dict[str, Any] = {}
    for part in shape:
        if isinstance(part, str):
            plain[part] = next(values)
        else:
            plain[part[0]] = _put_together(part[1], values)
    return plain


def _shape(names: list[Any]) -> Shape:
    return tuple(each if isinstance(each, str) else (each[0], _shape(each[1])) for each in names)


def _parsed(batch: bytes) -> Any:
    """Return what a batch holds; raise ValueError for too much, and for texts beyond Unicode."""
    if sum(map(batch.count, (b",", b"[", b"{"))) > MAX_VALUES:
        raise ValueError(f"more than {MAX_VALUES} values")
    raw = json.loads(batch.decode())
    if _SURROGATE.search(batch):
        json.dumps(raw, ensure_ascii=False).encode()  # raises for half of a pair of surrogates
    return raw
