"""`RunFile` writes and `RunReader` reads a recording: an MCAP file of batches and their view."""

import logging
import re
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, count, takewhile
from pathlib import Path
from typing import IO, Any, Final

from adapters.recording.container import (
    CHANNEL,
    CHUNK,
    DATA_END,
    HEADER,
    MESSAGE,
    METADATA,
    DamageError,
    RecordingError,
    Unpacker,
    read_records,
)
from adapters.recording.messages import TOPICS, RecordingTopic, decode, plain_of, topic_of
from adapters.recording.rows import RecordedRow, RowReader, RowWriter, text_of
from adapters.recording.view import TOPICS as VIEW_TOPICS
from adapters.recording.view import ViewBuilder
from executive.core.recording import Entry, Item, is_within

_LOG = logging.getLogger(__name__)

_FAMILY: Final = "rover-run-"
PROFILE: Final = f"{_FAMILY}4"
"""MCAP profile of the files written and read here; names the version of their messages."""
LIBRARY: Final = "rover-executive"
TRUNCATED: Final = "truncated"
"""Name of the metadata record in a file that was completed later."""
RUN: Final = "/run"
"""Topic of the batches."""
MIN_ROWS: Final = 20_000
"""Rows allowed in any file; beyond that one for each packed octet. Measured: 0.2 at rest."""
BATCH_S: Final = 1.0
MAX_BATCH_OCTETS: Final = 1 << 18
SUFFIX: Final = ".mcap"
_NO_SCHEMA: Final = 0


def part_of(path: Path, number: int) -> Path:
    """Return the file with this number of a recording; 1 is the first, 2 its continuation."""
    return path if number == 1 else path.with_suffix(f".{number}{SUFFIX}")


def first_parts(folder: Path) -> list[Path]:
    """Return the recordings in a folder and below, each by its first file."""
    found = sorted(folder.rglob(f"*{SUFFIX}"))
    return [path for path in found if not re.search(rf"\.\d+\{SUFFIX}$", path.name)]


def _mismatch(profile: str) -> str:
    if profile.startswith(_FAMILY):
        return f"is a recording of another version ({profile}, not {PROFILE}): record the run again"
    if not profile:
        return "is an export of telemetry, or of another program, not a recording of a run"
    return f"is no recording of this version ({PROFILE}), but MCAP of profile {profile!r}"


class RunFile:
    """Newly created file of a recording; it is complete once it is closed.

    If it cannot be written, for example on a full disk, the recording ends and the run continues.

    Attributes:
        ended: whether it cannot be written any longer.

    Raises:
        OSError: it cannot be created.
    """

    def __init__(self, path: Path) -> None:
        from mcap.writer import Writer

        self._file = path.open("wb")
        self._writer = Writer(self._file)
        self._writer.start(PROFILE, LIBRARY)
        self._run = self._writer.register_channel(RUN, "json", _NO_SCHEMA)
        self._rows = RowWriter()
        self._view = ViewBuilder()
        self._channels: dict[str, int] = {}
        self._entries = 0
        self._time_ns = self._batch_ns = 0
        self.ended = False

    def put(self, item: Item) -> None:
        """Write the next item."""
        self._run_or_end(lambda: self._write(item))

    @property
    def size_octets(self) -> int:
        """Size of the file; items added since the last flush may be missing."""
        return self._file.tell()

    def flush(self) -> None:
        """Pass buffered items to the operating system; they then survive the end of the process."""
        self._run_or_end(self._flush)

    def continued(self, path: Path) -> "RunFile":
        """Close it, and return the file that continues the recording.

        If that cannot be created, the recording ends.
        """
        self.close()
        try:
            following = RunFile(path)
        except OSError as error:
            self.ended = True
            _LOG.warning("recording %s ends: %s", path, error.strerror)
            return self
        following._entries, following._time_ns = self._entries, self._time_ns
        following._view = self._view
        following._view.restart_file()
        return following

    def close(self) -> None:
        """Write the remaining items and the index."""
        self._run_or_end(self._finish)
        with suppress(OSError):  # for octets in its buffer after the recording has ended
            self._file.close()

    def _run_or_end(self, step: Callable[[], object]) -> None:
        """Run a step unless the recording has ended; end it if the file cannot be written."""
        if self.ended:
            return
        try:
            step()
        except OSError as error:
            self.ended = True
            _LOG.warning("recording %s ends: %s", self._file.name, error.strerror)

    def _flush(self) -> None:
        self._write_batch()
        self._writer.flush()

    def _finish(self) -> None:
        self._write_batch()
        self._writer.finish()
        self._file.flush()

    def _write(self, item: Item) -> None:
        if isinstance(item, Entry) and not is_within(item):
            self._entries += 1
            self._time_ns = round(item.utc_s * 1e9)
            if self._time_ns - self._batch_ns > BATCH_S * 1e9:
                self._write_batch()
        self._rows.put(topic_of(item).name, plain_of(item))
        if self._rows.size_octets > MAX_BATCH_OCTETS:
            self._write_batch()
        for shown in self._view.of(item):
            with suppress(ValueError):  # JSON has no NaN
                self._add(self._channel(shown.topic), text_of(shown.message).encode())

    def _write_batch(self) -> None:
        self._batch_ns = self._time_ns
        batch = self._rows.take()
        if batch is not None:
            self._add(self._run, batch)

    def _add(self, channel: int, data: bytes) -> None:
        self._writer.add_message(
            channel_id=channel,
            log_time=self._time_ns,
            publish_time=self._time_ns,
            sequence=self._entries,
            data=data,
        )

    def _channel(self, topic: str) -> int:
        """Return the channel of a topic of the view; create it for its first message."""
        known = self._channels.get(topic)
        if known is None:
            kind = VIEW_TOPICS[topic]
            schema = self._writer.register_schema(
                kind.name, "jsonschema", text_of(kind.json).encode()
            )
            known = self._channels[topic] = self._writer.register_channel(topic, "json", schema)
        return known


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """A message of a recording; its data are JSON."""

    topic: RecordingTopic
    data: bytes


class RunReader:
    """Reads a recording, with its continuation files, up to the first damage.

    Content behind a damaged part is not read, because it depends on the lost part.

    Args:
        is_wanted: returns whether to continue; called before each chunk, on the reading thread.

    Attributes:
        path: path of the first file.
        whole: whether the last file was closed properly; known at its end.
        damaged: whether damage ended the reading; known at its end.
    """

    def __init__(self, path: Path, is_wanted: Callable[[], bool] = lambda: True) -> None:
        self.path = path
        self.whole = False
        self.damaged = False
        self._is_wanted = is_wanted

    def messages(self, kinds: Collection[type] | None = None) -> Iterator[RecordedMessage]:
        """Yield the messages in the order of writing.

        Args:
            kinds: types of items, facts by their own; others are not decoded. None for all.

        Raises:
            RecordingError: the file cannot be read, is no recording, or damaged at its beginning.
        """
        following = (part_of(self.path, number) for number in count(2))
        times_s: list[float] = []
        for path in chain([self.path], takewhile(Path.exists, following)):
            self.whole = False
            try:
                with path.open("rb") as file:
                    for row in self._rows(file):
                        if (utc_s := row.utc_s) is not None:
                            times_s[1:] = [utc_s]
                        topic = TOPICS.get(row.topic)
                        if topic is not None and (kinds is None or topic.kind in kinds):
                            yield RecordedMessage(topic, row.data)
            except OSError as error:
                raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
            except DamageError as error:
                if not times_s:
                    text = f"{path}: is no MCAP file, or damaged ({error})"
                    raise RecordingError(text) from error
                self.damaged = True
                after = f"damaged after {times_s[-1] - times_s[0]:.1f} s: read up to there"
                _LOG.warning("%s: %s (%s)", path, after, error)
                return

    def decoded(self, message: RecordedMessage) -> Any:
        """Return the item in a message.

        Raises:
            RecordingError: the message contains no valid item.
        """
        try:
            return decode(message.topic, message.data)
        except Exception as error:  # cattrs raises groups of many kinds
            text = f"{self.path}: message of {message.topic.name} cannot be decoded: {error}"
            raise RecordingError(text) from error

    def _rows(self, file: IO[bytes]) -> Iterator[RecordedRow]:
        from mcap.records import Channel, Header, Message, Metadata

        unpacker, reader, runs, truncated, rows = Unpacker(), RowReader(), set[int](), False, 0
        for record in read_records(file):
            if not self._is_wanted():
                raise RecordingError(f"{self.path}: reading was cancelled")
            if record.opcode == HEADER and (profile := record.parsed(Header).profile) != PROFILE:
                raise RecordingError(f"{self.path}: {_mismatch(profile)}")
            if record.opcode == METADATA:
                truncated |= record.parsed(Metadata).name == TRUNCATED
            self.whole = record.opcode == DATA_END and not truncated
            for each in unpacker.records(record) if record.opcode == CHUNK else ():
                if each.opcode == CHANNEL and (channel := each.parsed(Channel)).topic == RUN:
                    runs.add(channel.id)
                if each.opcode != MESSAGE or each.channel not in runs:
                    continue
                found = reader.rows(each.parsed(Message, len(each.content)).data)
                rows += len(found)
                if rows > MIN_ROWS + unpacker.packed:
                    raise DamageError(f"{unpacker.packed} octets have {rows} rows")
                yield from found
