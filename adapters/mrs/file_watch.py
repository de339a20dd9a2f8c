"""What happens to the files aboard, told once, whoever did it."""

import asyncio
import logging
import time
from typing import Final, Protocol

from adapters.mal import NamedValue
from executive.state import FileEventKind, FileFolder, FileStamp

_LOG: Final = logging.getLogger(__name__)

PERIOD_S: Final = 1.0
"""Between two looks at the folder, and how long a file must rest until it is told of."""
SHARE: Final = 20
"""A look takes at most one part in so many of the time, however full the folder is."""
MOST_TOLD: Final = 500
"""Changes told after one look, so that nobody who listens is swamped; the next tells the rest."""
GONE: Final = FileStamp(0, 0, 0)
"""The stamp of a file of which nothing was ever known."""

MetaData = tuple[NamedValue, ...] | None


class Tell(Protocol):
    """Hears on the loop what happened to a file."""

    def __call__(
        self, kind: FileEventKind, path: str, stamp: FileStamp, about: MetaData = None
    ) -> None:
        """Hear it, with the stamp of the file, the last one if it is gone."""
        ...


class FileWatch:
    """Tells of files that others put into the folder, change or remove, and passes on the rest.

    Who changes the folder itself says so by `hear`; what others do is found by looking. Each
    change is told once. A file that somebody is still writing is told of when it rests.

    Args:
        folder: what to watch.
        tell: called with each change.
        period_s: between two looks.
    """

    def __init__(self, folder: FileFolder, tell: Tell, period_s: float = PERIOD_S) -> None:
        """Take what lies there as known; look again from now on, until the loop ends."""
        self._folder = folder
        self._tell = tell
        self._period_s = period_s
        self._known = dict(folder.entries())
        self._restless: dict[str, FileStamp] = {}
        self._heard: set[str] = set()
        self._task = asyncio.create_task(self._watch())

    def hear(
        self, kind: FileEventKind, path: str, stamp: FileStamp | None, about: MetaData = None
    ) -> None:
        """Take what somebody says that happened to a file, and tell it unless it is known.

        Args:
            kind: what happened.
            path: to which file.
            stamp: of the file, if it is there.
            about: what else is known about it.
        """
        self._heard.add(path)
        match kind:
            case FileEventKind.DELETED:
                self._lose(path)
            case FileEventKind.TRANSFERRED:
                self._tell(kind, path, stamp or self._known.get(path, GONE), about)
            case FileEventKind.STORED | FileEventKind.CHANGED:
                if stamp is not None:
                    self._find(path, stamp, about)

    async def _watch(self) -> None:
        pause_s = self._period_s
        while True:
            await asyncio.sleep(pause_s)
            begin_s = time.monotonic()
            self._heard.clear()
            try:
                new, gone = await asyncio.to_thread(self._look)
                await self._compare(new, gone)
            except Exception:
                _LOG.exception("the folder of files cannot be looked at")
            pause_s = max(self._period_s, SHARE * (time.monotonic() - begin_s))

    def _look(self) -> tuple[dict[str, FileStamp], list[str]]:
        """Return what is not as known, and what is not there; called in a thread."""
        found = dict(self._folder.entries())
        new = {path: stamp for path, stamp in found.items() if self._known.get(path) != stamp}
        return new, [path for path in list(self._known) if path not in found]

    async def _compare(self, new: dict[str, FileStamp], gone: list[str]) -> None:
        """Tell of differences that rest, but for files that somebody spoke of during the look."""
        rested = [path for path, stamp in new.items() if self._restless.get(path) == stamp]
        self._restless = new
        for path in (gone + rested)[:MOST_TOLD]:
            if path in self._heard:
                continue
            if path in new:
                self._find(path, new[path])
            else:
                self._lose(path)
            await asyncio.sleep(0)

    def _find(self, path: str, stamp: FileStamp, about: MetaData = None) -> None:
        known = self._known.get(path)
        if known != stamp:
            self._known[path] = stamp
            kind = FileEventKind.STORED if known is None else FileEventKind.CHANGED
            self._tell(kind, path, stamp, about)

    def _lose(self, path: str) -> None:
        stamp = self._known.pop(path, None)
        if stamp is not None:
            self._tell(FileEventKind.DELETED, path, stamp)
