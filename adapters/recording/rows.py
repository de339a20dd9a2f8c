"""Messages of a recording as rows: field names are stored once in a file, then only values.

A batch is a JSON object. `shapes` lists the shapes first used by its rows: a topic, and the field
names of its messages, nested as they are. Each of `rows` is a shape index, counted through the
file, and the values. So the text of a message is restored exactly.
"""

import json
import re
from collections.abc import Iterator
from typing import Any, Final

from adapters.recording.container import DamageError, damage_in

Shape = tuple["str | tuple[str, Shape]", ...]
"""Field names; with a shape of its own for a field that is an object."""

MAX_VALUES: Final = 500_000
"""Maximum values of a batch, up to 72 octets each. Measured: 9,000 with a laser of 720 rays."""
_SURROGATE: Final = re.compile(rb"\\u[dD][89a-fA-F]")
"""Begin of an escaped surrogate."""
_TIMES: Final = ("now_s", "utc_s")
_SHAPES: Final = "shapes"
_ROWS: Final = "rows"


def text_of(plain: object) -> str:
    """Return the JSON text of plain data; different data have different texts."""
    return json.dumps(plain, allow_nan=False, separators=(",", ":"))


class RowWriter:
    """Packs messages into batches.

    Attributes:
        size_octets: size of the present batch.
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
        """Return the batch and start another; None if it is empty."""
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
            DamageError: it is not a batch, or not the next one.
        """
        with damage_in("a batch of rows"):
            raw = _parsed(batch)
            # A dictionary rejects unhashable values, which are not names.
            self._shapes += dict.fromkeys((topic, _shape(names)) for topic, names in raw[_SHAPES])
            found = []
            for number, *values in raw[_ROWS]:
                topic, shape = self._shapes[number if number >= 0 else len(self._shapes)]
                found.append(RecordedRow(topic, shape, values))
            return found


class RecordedRow:
    """A message; its text is created on demand."""

    __slots__ = ("_shape", "_values", "topic")

    def __init__(self, topic: str, shape: Shape, values: list[Any]) -> None:
        self.topic = topic
        self._shape = shape
        self._values = values

    @property
    def utc_s(self) -> float | None:
        """Wall clock time of an entry of the core; None for other messages."""
        if self._shape[:2] != _TIMES or len(self._values) < 2:
            return None
        return self._values[1] if isinstance(self._values[1], float) else None

    @property
    def data(self) -> bytes:
        """The JSON text of the message.

        Raises:
            DamageError: the values do not match the shape, or cannot be JSON.
        """
        values = iter(self._values)
        try:
            text = text_of(_put_together(self._shape, values))
        except (StopIteration, ValueError, RecursionError) as error:
            raise DamageError(f"a row cannot be decoded: {error!r}") from error
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
    """Decode a batch; raise ValueError if it is too large, or has texts that are not Unicode."""
    if sum(map(batch.count, (b",", b"[", b"{"))) > MAX_VALUES:
        raise ValueError(f"more than {MAX_VALUES} values")
    raw = json.loads(batch.decode())
    if _SURROGATE.search(batch):
        json.dumps(raw, ensure_ascii=False).encode()  # raises for an unpaired surrogate
    return raw
