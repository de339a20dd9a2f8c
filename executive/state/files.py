"""The folder aboard that mission control sees.

Paths are relative to the folder and separated by slashes. Names that begin with a dot are not part
of it: files being written, and what is known about files (`.about`), lie under such names. Nor are
names that are not printable UTF-8, nor links that lead out.
"""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from stat import S_ISREG
from typing import Final

from executive.values.facts import Frame
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import FileEvent, FileEventKind, Identity

LONGEST_PATH: Final = 255
LONGEST_NAME: Final = 240
"""Octets of one part of a path, so that a file system's 255 hold the part file's name too."""
ABOUT: Final = ".about"
PART: Final = ".part"


@dataclass(frozen=True, slots=True)
class FileStamp:
    """What tells a file's content from what it was before, without reading it.

    Attributes:
        modified_ns: when it was last changed, ns since 1970 UTC.
        inode: which file of the file system it is.
    """

    size_octets: int
    modified_ns: int
    inode: int

    @classmethod
    def of(cls, stat: os.stat_result) -> "FileStamp":
        """Return the stamp that a file's status holds."""
        return cls(stat.st_size, stat.st_mtime_ns, stat.st_ino)


def check_path(path: str, argument: int = 1) -> Refusal | None:
    """Return why a path cannot name a file of the folder, or None; looks at the text alone."""
    parts = path.split("/")
    if not path or len(path) > LONGEST_PATH or not path.isprintable():
        why = f"a path has 1 to {LONGEST_PATH} printable characters"
    elif any(part in {"", "."} for part in parts):
        why = "it must be relative to the folder, its parts separated by single slashes"
    elif ".." in parts:
        why = "it leaves the folder"
    elif any(part.startswith(".") for part in parts):
        why = "names that begin with a dot are not part of the folder"
    elif any(len(part.encode()) > LONGEST_NAME for part in parts):
        why = f"a name has {LONGEST_NAME} octets at most"
    else:
        return None
    return Refusal(Reason.BAD_PATH, f"{path[:LONGEST_PATH]!r}: {why}", argument=argument)


class FileFolder:
    """The monitored folder. Reading is safe from any thread, changing is the core's.

    Args:
        root: the folder; made on the first store.
        tell: called with each change that is made here.
    """

    def __init__(self, root: Path, tell: Callable[[FileEvent], None]) -> None:
        self.root = root
        self._tell = tell

    def find(self, path: str) -> Path | Refusal:
        """Return the file of this name, or why there is none.

        A link that leads out of the folder leads nowhere.
        """
        refusal = check_path(path)
        if refusal is not None:
            return refusal
        place = self.root / path
        if self._inside(place) and os.path.isfile(place):
            return place
        return Refusal(Reason.NO_SUCH_FILE, f"there is no file {path}", subject=path)

    def target(self, path: str) -> Path | Refusal:
        """Return where a new file of this name would lie, or why there can be none."""
        refusal = check_path(path, argument=2)
        if refusal is not None:
            return refusal
        place = self.root / path
        if not self._inside(place):
            return Refusal(Reason.BAD_PATH, f"{path}: it leaves the folder", argument=2)
        if os.path.lexists(place):
            return Refusal(Reason.TARGET_EXISTS, f"{path} exists already: choose another")
        return place

    def stamp(self, path: str) -> FileStamp | None:
        """Return the stamp of a file, or None if there is none."""
        place = self.find(path)
        if isinstance(place, Refusal):
            return None
        try:
            return FileStamp.of(place.stat())
        except OSError:
            return None

    def entries(self, folder: str = "") -> Iterator[tuple[str, FileStamp]]:
        """Yield the files below a folder with their stamps, in no order.

        What cannot be read, or goes while this runs, is left out.

        Raises:
            NotADirectoryError: there is no such folder.
        """
        top = self.root / folder
        refused = folder and (check_path(folder) is not None or not self._inside(top))
        if refused or (folder and not os.path.isdir(top)):
            raise NotADirectoryError(folder)
        yield from self._walk(folder)

    def paths(self, folder: str = "") -> Iterator[str]:
        """Yield the paths of all files below a folder, sorted; raises as `entries` does."""
        yield from sorted(path for path, _ in self.entries(folder))

    def about(self, path: str) -> tuple[Figure, ...]:
        """Return the figures stored with a file; none if the file was replaced since."""
        try:
            known, figures = json.loads(self._about(path).read_text(encoding="utf-8"))
            if known != _mark((self.root / path).stat()):
                return ()
            return tuple(Figure(*figure) for figure in figures)
        except (OSError, ValueError, TypeError):
            return ()

    def store(self, path: str, data: bytes, about: tuple[Figure, ...] = ()) -> None:
        """Write a file whole or not at all, with what is known about it.

        Raises:
            OSError: it cannot be written.
            ValueError: no file of the folder can have this path.
        """
        if (refusal := check_path(path)) is not None:
            raise ValueError(refusal.text)
        place, note = self.root / path, self._about(path)
        place.parent.mkdir(parents=True, exist_ok=True)
        note.parent.mkdir(parents=True, exist_ok=True)
        part = place.with_name(f".{place.name}{PART}")
        kind = FileEventKind.CHANGED if place.exists() else FileEventKind.STORED
        try:
            part.write_bytes(data)
            figures = [[f.name, f.value, f.unit] for f in about]
            note.write_text(json.dumps([_mark(part.stat()), figures]), encoding="utf-8")
            part.replace(place)
        except OSError:
            part.unlink(missing_ok=True)
            raise
        self._tell(FileEvent(kind, path))

    def delete(self, path: str) -> Refusal | None:
        """Delete a file; return why it cannot be.

        Raises:
            OSError: it cannot be deleted.
        """
        place = self.find(path)
        if isinstance(place, Refusal):
            return place
        place.unlink()
        with suppress(OSError):
            self._about(path).unlink()
        self._tell(FileEvent(FileEventKind.DELETED, path))
        return None

    def move(self, path: str, target: str) -> Refusal | None:
        """Give a file another path, where nothing lies yet; return why it cannot be.

        Raises:
            OSError: it cannot be moved.
        """
        place, there = self.find(path), self.target(target)
        if isinstance(place, Refusal):
            return place
        if isinstance(there, Refusal):
            return there
        there.parent.mkdir(parents=True, exist_ok=True)
        place.rename(there)
        with suppress(OSError):
            note_there = self._about(target)
            note_there.parent.mkdir(parents=True, exist_ok=True)
            self._about(path).rename(note_there)
        self._tell(FileEvent(FileEventKind.DELETED, path))
        self._tell(FileEvent(FileEventKind.STORED, target))
        return None

    def tidy(self) -> None:
        """Remove the part files of a process that was killed."""
        for part in self.root.rglob(f".*{PART}"):
            with suppress(OSError):
                part.unlink()

    def _walk(self, folder: str) -> Iterator[tuple[str, FileStamp]]:
        prefix = f"{folder}/" if folder else ""
        try:
            found = list(os.scandir(self.root / folder))
        except OSError:
            return
        for entry in found:
            path = prefix + entry.name
            if check_path(path) is not None:
                continue
            try:
                if entry.is_symlink() and not self._inside(self.root / path):
                    continue
                stat = entry.stat()
                if S_ISREG(stat.st_mode):
                    yield path, FileStamp.of(stat)
                elif entry.is_dir(follow_symlinks=False):
                    yield from self._walk(path)
            except OSError:
                continue

    def _about(self, path: str) -> Path:
        place = self.root / ABOUT / path
        return place.with_name(f".{place.name}")

    def _inside(self, place: Path) -> bool:
        return Path(os.path.realpath(place)).is_relative_to(os.path.realpath(self.root))


def _mark(stat: os.stat_result) -> list[int]:
    """Return a mark that a move keeps and a replacement changes."""
    return [stat.st_size, stat.st_mtime_ns]


PICTURE_FOLDER: Final = "pictures"
LONGEST_SOURCE: Final = 64
PICTURE_PARAMETERS: Final = {
    Parameter.POS_X,
    Parameter.POS_Y,
    Parameter.POS_Z,
    Parameter.HEAD,
    Parameter.CAM_PAN,
    Parameter.CAM_TILT,
}
"""The parameters that are kept with a picture."""


def store_picture(
    files: FileFolder, frame: Frame, identity: Identity, values: tuple[ParameterValue, ...]
) -> str:
    """Store a camera frame and where it was taken; return its path, named by its command.

    Raises:
        OSError: the file cannot be written.
    """
    name = f"{_file_name(identity.source)}-{identity.command_id}.{frame.format.lower()}"
    about = [Figure("commandId", identity.command_id)]
    about += [
        Figure(value.parameter.value, value.value, value.parameter.unit)
        for value in values
        if value.parameter in PICTURE_PARAMETERS and value.value is not None
    ]
    path = f"{PICTURE_FOLDER}/{name}"
    files.store(path, frame.data, tuple(about))
    return path


def _file_name(source: str) -> str:
    """Return a short name for a file, no two sources' alike."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in source)
    name = name[:LONGEST_SOURCE]
    return name if name == source else f"{name}-{sha256(source.encode()).hexdigest()[:12]}"
