"""How telemetry is written for other programs: a table as CSV, or MCAP with a topic each parameter.

MCAP messages are JSON, `{"value", "quality"}`, on `/ASSET/LINK/KEY`; they are published at the time
aboard, and logged when they arrived here.
"""

import csv
import io
import json
from collections.abc import Sequence
from enum import Enum, unique
from typing import Final, Protocol, assert_never

from mcap.writer import Writer

from adapters.console.archive import ExportRow

LIBRARY: Final = "rover-console"
NS_PER_S: Final = 1e9
SCHEMA: Final = {
    "type": "object",
    "properties": {
        "value": {"type": ["number", "string", "null"]},
        "quality": {"enum": ["good", "late", "invalid"]},
    },
}


@unique
class Form(Enum):
    """What there is."""

    CSV = "csv"
    MCAP = "mcap"


class Writing(Protocol):
    """A file that is written in pieces."""

    @property
    def content_type(self) -> str:
        """Of the file, for a browser."""

    def begin(self) -> bytes:
        """Return how it begins."""

    def page(self, rows: Sequence[ExportRow]) -> bytes:
        """Return what rows add to it."""

    def end(self) -> bytes:
        """Return how it ends."""


def writing(form: Form) -> Writing:
    """Return what writes a file of a form."""
    match form:
        case Form.CSV:
            return CsvFile()
        case Form.MCAP:
            return McapFile()
        case _:
            assert_never(form)


class CsvFile:
    """A line for each value, and one with the names of the columns before them."""

    content_type = "text/csv"

    def begin(self) -> bytes:
        """Return the names of the columns."""
        return self._lines([ExportRow._fields])

    def page(self, rows: Sequence[ExportRow]) -> bytes:
        """Return the lines of values."""
        return self._lines(rows)

    def end(self) -> bytes:
        """Return nothing more."""
        return b""

    def _lines(self, rows: Sequence[tuple[object, ...]]) -> bytes:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        return text.getvalue().encode()


class _Pieces(io.BytesIO):
    """What a writer wrote since it was last taken; positions are those in the whole."""

    def __init__(self) -> None:
        super().__init__()
        self._taken = 0

    def tell(self) -> int:
        return self._taken + super().tell()

    def take(self) -> bytes:
        piece = self.getvalue()
        self._taken += len(piece)
        self.seek(0)
        self.truncate()
        return piece


class McapFile:
    """A topic for each parameter and link."""

    content_type = "application/octet-stream"

    def __init__(self) -> None:
        self._pieces = _Pieces()
        self._writer = Writer(self._pieces)
        self._channels: dict[str, int] = {}
        self._schema = 0

    def begin(self) -> bytes:
        """Return the header."""
        self._writer.start(library=LIBRARY)
        schema = json.dumps(SCHEMA).encode()
        self._schema = self._writer.register_schema("telemetry", "jsonschema", schema)
        return self._pieces.take()

    def page(self, rows: Sequence[ExportRow]) -> bytes:
        """Return what is written of values; the writer may keep some until it has a chunk."""
        for row in rows:
            topic = f"/{row.asset}/{row.link}/{row.key}"
            if topic not in self._channels:
                channel = self._writer.register_channel(topic, "json", self._schema)
                self._channels[topic] = channel
            self._writer.add_message(
                self._channels[topic],
                log_time=round(row.rx * NS_PER_S),
                data=json.dumps({"value": row.value, "quality": row.quality}).encode(),
                publish_time=round(row.utc * NS_PER_S),
            )
        return self._pieces.take()

    def end(self) -> bytes:
        """Return the rest, with the index."""
        self._writer.finish()
        return self._pieces.take()
