"""`FileStore`: files that the console has fetched, by the name of the asset and the path aboard."""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from adapters.mrs.ground import checksum_of
from adapters.mrs.spec import FileInfo
from executive.state import FileFolder, FileStamp, check_path
from executive.values.reasons import Refusal

MAX_OCTETS: Final = 1_000_000_000
"""Capacity for files, in octets; beyond it the earliest fetched files are deleted."""
_STAGED: Final = ".transfers"
"""Subfolder for unfinished files; names that begin with a dot are not listed."""


class FileStore:
    """Stores files in a folder, and unfinished ones in a hidden subfolder.

    Args:
        root: the folder; created with the first file.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._folder = FileFolder(root, lambda _: None)
        self._verified: dict[FileStamp, int] = {}

    def entries(self) -> Iterator[tuple[str, FileStamp]]:
        """Yield the stored files, in no order."""
        return self._folder.entries()

    def find(self, path: str) -> Path | None:
        """Return the path of a stored file; None if it is not stored."""
        stored = self._folder.find(path)
        return None if isinstance(stored, Refusal) else stored

    def find_same(self, path: str, file: FileInfo) -> Path | None:
        """Return the path of a stored file with the same content as aboard; may read all of it."""
        stored = self.find(path)
        if stored is None or file.checksum is None:
            return None
        stamp = FileStamp.of(stored.stat())
        if stamp.size_octets != file.size:
            return None
        if stamp not in self._verified:
            self._verified[stamp] = checksum_of(stored)
        return stored if self._verified[stamp] == file.checksum else None

    @property
    def staged(self) -> Path:
        """The folder for unfinished files."""
        return self.root / _STAGED

    def stage(self, path: str) -> Path:
        """Return the path of an unfinished file; its parts have this path as prefix.

        Raises:
            ValueError: the path is not permitted.
        """
        if (refusal := check_path(path)) is not None:
            raise ValueError(refusal.text)
        self.staged.mkdir(parents=True, exist_ok=True)
        return self.staged / hashlib.sha256(path.encode()).hexdigest()

    def add(self, path: str, file: FileInfo) -> None:
        """Move a complete and verified file to its path in the store.

        Raises:
            OSError: it cannot be moved.
        """
        staged, target = self.stage(path), self.root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        os.utime(staged, ns=(file.modified, file.modified))
        staged.replace(target)
        if file.checksum is not None:
            self._verified[FileStamp.of(target.stat())] = file.checksum
        self.discard(path)
        self._prune()

    def discard(self, path: str) -> None:
        """Remove the received parts of a file."""
        staged = self.stage(path)
        for part in staged.parent.glob(f"{staged.name}*"):
            part.unlink(missing_ok=True)

    def _prune(self) -> None:
        files = [self.root / path for path, _ in self.entries()]
        newest_first = sorted(files, key=lambda file: file.stat().st_ctime_ns, reverse=True)
        octets = 0
        for number, file in enumerate(newest_first):
            octets += file.stat().st_size
            if octets > MAX_OCTETS and number > 0:
                file.unlink()
