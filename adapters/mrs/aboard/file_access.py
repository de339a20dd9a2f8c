"""Reads onboard files for the file services: attributes, content, checksums, a watch for changes.

Threads read the files, so that a stop does not wait for a disk. Each read opens the file, checks
that it is unchanged, and reads one slice: no file stays open when a transfer ends early.
"""

import asyncio
import logging
import os
from collections.abc import Callable
from typing import Final
from zlib import crc32

from adapters.mal import AttributeType, MalError, NamedValue, TypedAttribute
from adapters.mrs.spec import AreaError, FileInfo, with_text
from adapters.system import OPERATING_SYSTEM, System, utc_ns
from executive.state import MAX_PATH_OCTETS, FileFolder, FileStamp
from executive.values.reasons import Figure
from executive.values.reports import FileEventKind

UNKNOWN_KIND: Final = "application/octet-stream"
KINDS: Final = {
    "avi": "video/x-msvideo",
    "bmp": "image/bmp",
    "csv": "text/csv",
    "gz": "application/gzip",
    "jpeg": "image/jpeg",
    "jpg": "image/jpeg",
    "json": "application/json",
    "log": "text/plain",
    "mp4": "video/mp4",
    "pdf": "application/pdf",
    "pgm": "image/x-portable-graymap",
    "png": "image/png",
    "ppm": "image/x-portable-pixmap",
    "tif": "image/tiff",
    "tiff": "image/tiff",
    "txt": "text/plain",
    "xml": "application/xml",
    "yaml": "application/yaml",
    "zip": "application/zip",
}
"""Media types by suffix. Python's `mimetypes` depends on the host, and needs memory."""


def mime_type(path: str) -> str:
    """Return the media type of a file name's suffix."""
    return KINDS.get(path.rpartition(".")[2].lower(), UNKNOWN_KIND)


def file_info(
    path: str,
    stamp: FileStamp,
    checksum: int | None = None,
    meta_data: tuple[NamedValue, ...] | None = None,
) -> FileInfo:
    """Return the attributes of a file."""
    return FileInfo(
        path=path,
        size=stamp.size_octets,
        modified=stamp.modified_ns,
        mimeType=mime_type(path),
        checksum=checksum,
        metaData=meta_data,
    )


def meta_data(folder: FileFolder, path: str) -> tuple[NamedValue, ...] | None:
    """Return the metadata of a file; reads a file."""
    return tuple(map(_named, folder.metadata(path))) or None


def _named(figure: Figure) -> NamedValue:
    if isinstance(figure.value, int):
        return NamedValue(name=figure.name, value=TypedAttribute(AttributeType.LONG, figure.value))
    return NamedValue(
        name=figure.name, value=TypedAttribute(AttributeType.DOUBLE, float(figure.value))
    )


READ_OCTETS: Final = 1 << 20
"""Octets of one read."""
SLICE_OCTETS: Final = 1 << 22
"""Octets read for a checksum before the thread serves another task."""
KNOWN_CHECKSUMS: Final = 512
AT_REST_NS: Final = 1_000_000_000
"""Minimum age of a cached checksum's file: two changes may have the same modification time."""
AT_ONCE: Final = 4
"""Maximum concurrent checksum computations."""


def changed_error(path: str) -> MalError:
    """Return the error for a file that was changed while it was read."""
    return with_text(AreaError.REJECTED, f"{path} was changed while it was read")


def not_found_error(path: str) -> MalError:
    """Return the error for a file that does not exist, or no longer."""
    return with_text(AreaError.NOT_FOUND, path[:MAX_PATH_OCTETS])


def read(folder: FileFolder, path: str, stamp: FileStamp, offset: int, octets: int) -> bytes:
    """Return octets of a file, from within its size; it must still have this stamp.

    Raises:
        MalError: NotFound, it was deleted; Rejected, it was changed or cannot be read.
    """
    try:
        file = os.open(folder.root / path, os.O_RDONLY | os.O_NONBLOCK)
        try:
            if FileStamp.of(os.fstat(file)) != stamp:
                raise changed_error(path)
            data = os.pread(file, octets, offset)
        finally:
            os.close(file)
    except FileNotFoundError:
        raise not_found_error(path) from None
    except OSError as error:
        raise with_text(AreaError.REJECTED, f"{path} cannot be read: {error.strerror}") from error
    if len(data) < octets:
        raise changed_error(path)
    return data


class Checksums:
    """CRC-32 of files, with a cache of the last ones.

    Concurrent requests for the same file share one computation. It continues after a timeout of
    the requester, so that the next request is answered sooner.
    """

    def __init__(self, folder: FileFolder, system: System = OPERATING_SYSTEM) -> None:
        self._folder, self._system = folder, system
        self._known: dict[FileStamp, int] = {}
        self._running: dict[tuple[str, FileStamp], asyncio.Task[int]] = {}
        self._slots = asyncio.Semaphore(AT_ONCE)

    def known(self, stamp: FileStamp) -> int | None:
        """Return the cached checksum of a file, or None; may be called from any thread."""
        return self._known.get(stamp)

    async def of(self, path: str, stamp: FileStamp) -> int:
        """Return the checksum of a file; raises as `read` does."""
        known = self._known.get(stamp)
        if known is not None:
            return known
        key = (path, stamp)
        if key not in self._running:
            task = self._running[key] = asyncio.create_task(self._compute(path, stamp))
            task.add_done_callback(lambda ended: self._forget(key, ended))
        running = self._running[key]
        await asyncio.wait((running,))  # keeps it running if the waiting task is cancelled
        return running.result()

    async def of_first_octets(self, path: str, stamp: FileStamp, octets: int) -> int:
        """Return the checksum of the first octets of a file; raises as `read` does."""
        value = offset = 0
        while offset < octets:
            end = min(offset + SLICE_OCTETS, octets)
            value = await asyncio.to_thread(self._slice, path, stamp, offset, end, value)
            offset = end
        return value

    async def _compute(self, path: str, stamp: FileStamp) -> int:
        async with self._slots:
            value = await self.of_first_octets(path, stamp, stamp.size_octets)
        if await asyncio.to_thread(self._folder.stamp, path) != stamp:
            raise changed_error(path)
        if utc_ns(self._system) - stamp.modified_ns > AT_REST_NS:
            self._known[stamp] = value
            if len(self._known) > KNOWN_CHECKSUMS:
                del self._known[next(iter(self._known))]
        return value

    def _slice(self, path: str, stamp: FileStamp, offset: int, end: int, value: int) -> int:
        for begin in range(offset, end, READ_OCTETS):
            octets = min(READ_OCTETS, end - begin)
            value = crc32(read(self._folder, path, stamp, begin, octets), value)
        return value

    def _forget(self, key: tuple[str, FileStamp], ended: "asyncio.Task[int]") -> None:
        del self._running[key]
        if not ended.cancelled():
            ended.exception()  # marks it as retrieved; waiting tasks still receive it


_LOG: Final = logging.getLogger(__name__)

PERIOD_S: Final = 1.0
"""Period of the folder scan, and time without change before a file is reported."""
SHARE: Final = 20
"""Minimum pause after a scan, in durations of that scan; chosen, not measured."""
MAX_REPORTED: Final = 500
"""Maximum changes reported after one scan, so that subscribers are not flooded; the rest follow."""
UNKNOWN_STAMP: Final = FileStamp(0, 0, 0)
"""Stamp of an unknown file."""

MetaData = tuple[NamedValue, ...] | None


class FolderWatcher:
    """Reports each change of the folder once: files that are stored, changed or deleted.

    The core reports its own changes by `notify`; a periodic scan finds those of other programs. A
    file that is being written is reported when it did not change between two scans.

    `notify` is called on the loop with each change: event, path, stamp (the last known one of a
    deleted file), and metadata.
    """

    def __init__(
        self,
        folder: FileFolder,
        notify: Callable[[FileEventKind, str, FileStamp, MetaData], None],
    ) -> None:
        self._folder = folder
        self._publish = notify
        self._known = dict(folder.entries())
        self._unsettled: dict[str, FileStamp] = {}
        self._notified: set[str] = set()
        self._task = asyncio.create_task(self._watch())

    def notify(
        self, kind: FileEventKind, path: str, stamp: FileStamp | None, about: MetaData = None
    ) -> None:
        """Report a change that another component announces, unless it is known already."""
        self._notified.add(path)
        match kind:
            case FileEventKind.DELETED:
                self._on_deleted(path)
            case FileEventKind.TRANSFERRED:
                self._publish(kind, path, stamp or self._known.get(path, UNKNOWN_STAMP), about)
            case FileEventKind.STORED | FileEventKind.CHANGED:
                if stamp is not None:
                    self._on_found(path, stamp, about)

    async def _watch(self) -> None:
        loop, pause_s = asyncio.get_running_loop(), PERIOD_S
        while True:
            await asyncio.sleep(pause_s)
            begin_s = loop.time()
            self._notified.clear()
            try:
                new, deleted = await asyncio.to_thread(self._scan)
                await self._compare(new, deleted)
            except Exception:
                _LOG.exception("the folder of files cannot be scanned")
            pause_s = max(PERIOD_S, SHARE * (loop.time() - begin_s))

    def _scan(self) -> tuple[dict[str, FileStamp], list[str]]:
        """Return new or changed files, and deleted ones; called in a thread."""
        found = dict(self._folder.entries())
        new = {path: stamp for path, stamp in found.items() if self._known.get(path) != stamp}
        return new, [path for path in list(self._known) if path not in found]

    async def _compare(self, new: dict[str, FileStamp], removed: list[str]) -> None:
        """Report settled differences, unless they were reported during the scan."""
        settled = [path for path, stamp in new.items() if self._unsettled.get(path) == stamp]
        self._unsettled = new
        for path in (removed + settled)[:MAX_REPORTED]:
            if path in self._notified:
                continue
            if path in new:
                self._on_found(path, new[path])
            else:
                self._on_deleted(path)
            await asyncio.sleep(0)

    def _on_found(self, path: str, stamp: FileStamp, about: MetaData = None) -> None:
        known = self._known.get(path)
        if known != stamp:
            self._known[path] = stamp
            kind = FileEventKind.STORED if known is None else FileEventKind.CHANGED
            self._publish(kind, path, stamp, about)

    def _on_deleted(self, path: str) -> None:
        stamp = self._known.pop(path, None)
        if stamp is not None:
            self._publish(FileEventKind.DELETED, path, stamp, None)
