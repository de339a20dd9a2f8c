"""`BackgroundRecorder` writes the recordings of a real-time process by a thread, with bounds.

The core's thread only passes references. Each recording is a file in a folder, continued in a
second file, a third and so on; older files are deleted. Items older than `FLUSH_S` were handed
to the operating system, and survive any end of the process.
"""

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import chain, count
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import Final

from adapters.recording.completion import complete
from adapters.recording.run_file import SUFFIX, RunFile, part_of
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
