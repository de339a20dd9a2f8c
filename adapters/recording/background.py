"""`BackgroundRecorder` writes the recordings of a real-time process by a thread, with bounds.

The core's thread only passes references. Each recording is a file in a folder, continued in a
second file, a third and so on; older files are deleted. Items older than `FLUSH_S` were handed
to the operating system, and survive any end of the process.
"""

import logging
import os
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import chain, count
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import IO, Any, Final

from adapters.recording.container import (
    CHANNEL,
    CHUNK,
    HEADER,
    MAGIC,
    SCHEMA,
    DamageError,
    Record,
    Unpacker,
    read_records,
)
from adapters.recording.run_file import LIBRARY, PROFILE, SUFFIX, TRUNCATED, RunFile, part_of
from executive.core.recording import Entry, Item, is_within
from executive.settings import RecordingSettings

_LOG: Final = logging.getLogger(__name__)

POLL_S: Final = 0.1
"""Poll period of the queue: short bursts of work do not delay a tick."""
FLUSH_S: Final = 0.9
MAX_QUEUED: Final = 200_000
"""Maximum number of queued items; more mean that the disk has stalled, and end the recording."""
PARTS: Final = 10
"""Number of files into which the size limit of all recordings is divided."""
MEGA: Final = 1_000_000
DAY_S: Final = 86_400.0


class BackgroundRecorder:
    """Accepts a recording's items on any thread, and writes them on its own.

    Args:
        folder: folder of all recordings of the asset; this one is named after the time.
        bounds: limits of size and age.

    Attributes:
        on_fault: called with one line, on the writing thread, if the recording ends early.

    Raises:
        OSError: the folder cannot be written.
    """

    def __init__(self, folder: Path, bounds: RecordingSettings) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.on_fault: Callable[[str], None] = lambda _: None
        self._folder = folder
        self._first = _new_file(folder)
        self._bounds = bounds
        self._part = 1
        self._file = RunFile(self._first)
        self._ended = False
        self._items: SimpleQueue[Item] = SimpleQueue()
        self._closing = Event()
        self._thread = Thread(target=self._write, name="recording", daemon=True)
        self._thread.start()

    def put(self, item: Item) -> None:
        """Record the next item."""
        if not self._ended:
            self._items.put(item)

    def close(self) -> None:
        """Write the remaining items, and end the thread."""
        self._closing.set()
        self._thread.join()

    def _write(self) -> None:
        try:
            self._complete()
            self._prune()
            flushed_s = -inf
            while not self._closing.wait(POLL_S):
                self._drain()
                if time.monotonic() - flushed_s >= FLUSH_S:
                    flushed_s = time.monotonic()
                    self._file.flush()
                self._poll()
                if self._ended:
                    return
            self._drain()
        except Exception as error:
            _LOG.exception("recording failed")
            self._end(f"it raised {error!r}")
        finally:
            self._file.close()

    def _drain(self) -> None:
        with suppress(Empty):
            while True:
                item = self._items.get_nowait()
                if isinstance(item, Entry) and not is_within(item):
                    self._rotate()
                self._file.put(item)

    def _rotate(self) -> None:
        """Continue in another file if this one is full."""
        if self._file.size_octets < self._bounds.max_mb * MEGA / PARTS:
            return
        self._part += 1
        self._file = self._file.continued(part_of(self._first, self._part))
        self._prune()

    def _poll(self) -> None:
        if self._file.ended:
            self._end("it cannot be written")
        elif self._items.qsize() > MAX_QUEUED:
            self._end("the disk is too slow")

    def _end(self, why: str) -> None:
        self._ended = True
        self._items = SimpleQueue()
        text = f"the recording {self._first.name} ends: {why}; the rover continues"
        _LOG.warning(text)
        self.on_fault(text)

    def _complete(self) -> None:
        """Complete the recordings of earlier processes that were killed."""
        for path in self._folder.glob(f"*{SUFFIX}"):
            try:
                if path != self._first and complete(path):
                    _LOG.info("recording %s was truncated; its index was added", path)
            except OSError as error:
                _LOG.warning("recording %s cannot be completed: %s", path, error.strerror)

    def _prune(self) -> None:
        """Delete the oldest files, except the first and the present one of this recording."""
        found = []
        for path in self._folder.glob(f"*{SUFFIX}"):
            with suppress(FileNotFoundError):
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
        found.sort()
        left = sum(size for _, size, _ in found)
        limit = self._bounds.max_mb * MEGA * (PARTS - 1) / PARTS  # reserves the growing file
        max_age_s = time.time() - self._bounds.max_days * DAY_S
        own = {self._first, part_of(self._first, self._part)}
        for changed_s, size, path in found:
            if path not in own and (left > limit or changed_s < max_age_s):
                path.unlink(missing_ok=True)
                left -= size


def _new_file(folder: Path) -> Path:
    """Return the name of a new file, after the time."""
    began = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    names = (f"{began}-{number}" for number in count(2))
    paths = (folder / f"{name}{SUFFIX}" for name in chain([began], names))
    return next(path for path in paths if not path.exists())


def complete(path: Path) -> bool:
    """Add the index that viewers need to a truncated recording; return whether it was truncated.

    An incomplete end is removed; readable content stays unchanged. A metadata record marks the
    recording as truncated, for readers. A recording with sound parts behind a damaged one is left
    unchanged.

    Raises:
        OSError: the file cannot be read or written.
    """
    times, whole = path.stat(), path.with_suffix(".whole")
    with path.open("rb") as torn:
        head = torn.read(len(MAGIC))
        torn.seek(max(len(MAGIC), times.st_size - len(MAGIC)))
        if head != MAGIC or torn.read() == MAGIC:
            return False
        torn.seek(0)
        try:
            with whole.open("wb") as file:
                is_copied = _copy(torn, file)
            if is_copied:
                os.utime(whole, ns=(times.st_atime_ns, times.st_mtime_ns))  # pruned by this time
                whole.replace(path)
            return is_copied
        finally:
            whole.unlink(missing_ok=True)


def _copy(torn: IO[bytes], file: IO[bytes]) -> bool:
    """Copy everything before the truncated end, with an index; return False if more is lost."""
    from mcap.writer import Writer

    writer, unpacker, is_damaged = Writer(file), Unpacker(), False
    writer.start(_profile_of(torn), LIBRARY)
    schemas, channels = {0: 0}, dict[int, int]()
    with suppress(DamageError):  # the end behind the last complete record
        for chunk in read_records(torn):
            if chunk.opcode != CHUNK:
                continue
            try:
                records = list(unpacker.records(chunk))
            except DamageError:
                is_damaged = True
                continue
            if is_damaged:
                return False
            for record in records:
                _write(record, writer, schemas, channels)
    writer.flush()
    writer.add_metadata(TRUNCATED, {})
    writer.finish()
    return True


def _profile_of(torn: IO[bytes]) -> str:
    """Return the profile, which may be of another version; ours if the header is incomplete."""
    from mcap.records import Header

    profile = PROFILE
    with suppress(DamageError):
        first = next(read_records(torn), None)
        if first is not None and first.opcode == HEADER:
            profile = first.parsed(Header).profile
    torn.seek(0)
    return profile


def _write(record: Record, writer: Any, schemas: dict[int, int], channels: dict[int, int]) -> None:
    """Write a record of a chunk; its schema and channel get new ids."""
    from mcap.records import Channel, Message, Schema

    if record.opcode == SCHEMA:
        schema = record.parsed(Schema)
        schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
    elif record.opcode == CHANNEL:
        channel = record.parsed(Channel)
        channels[channel.id] = writer.register_channel(
            channel.topic, channel.message_encoding, schemas.get(channel.schema_id, 0)
        )
    else:
        it = record.parsed(Message, len(record.content))
        if it.channel_id in channels:
            number = channels[it.channel_id]
            writer.add_message(number, it.log_time, it.data, it.publish_time, it.sequence)
