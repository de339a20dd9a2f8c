"""Items of a recording as rows: the names of their parts once in a file, then values alone.

A batch is a JSON object. `shapes` are those that its rows are the first to use: a topic, and the
names in its messages, nested as they are. Each of `rows` is the number of its shape, in the order
in which the file brings them, and the values. So a message comes back as it was, to the last
character.
"""

import json
from collections.abc import Iterator
from typing import Any, Final

Shape = tuple["str | tuple[str, Shape]", ...]
"""Names of parts; with its own shape where a part is an object."""

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

    def rows(self, batch: bytes) -> "Iterator[Row]":
        """Yield the messages of the next batch.

        Raises:
            ValueError: it is no batch, or not the next.
        """
        try:
            raw = json.loads(batch)
            self._shapes += [(topic, _shape(names)) for topic, names in raw[_SHAPES]]
            for number, *values in raw[_ROWS]:
                topic, shape = self._shapes[number]
                yield Row(topic, shape, values)
        except (LookupError, TypeError) as error:
            raise ValueError(f"no batch of rows: {error!r}") from error


class Row:
    """A message whose text is made only where it is wanted."""

    __slots__ = ("_shape", "_values", "topic")

    def __init__(self, topic: str, shape: Shape, values: list[Any]) -> None:
        self.topic = topic
        self._shape = shape
        self._values = values

    @property
    def data(self) -> bytes:
        """The JSON text of the message.

        Raises:
            ValueError: values are missing.
        """
        try:
            return text_of(_put_together(self._shape, iter(self._values))).encode()
        except StopIteration as error:
            raise ValueError("a row is shorter than its shape") from error


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
