"""`FileFolder`: the onboard folder of files that mission control lists, fetches and deletes.

Paths are relative to the folder and separated by slashes. Names that begin with a dot are excluded:
they hold files being written and the metadata of files (`.about`). Names that are not printable
UTF-8 and links to targets outside are excluded, too.
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

MAX_PATH_OCTETS: Final = 255
MAX_NAME_OCTETS: Final = 240
"""Maximum octets of one path component; the part file's name then fits a file system's 255."""
ABOUT: Final = ".about"
PART: Final = ".part"


@dataclass(frozen=True, slots=True)
class FileStamp:
    """Identifies a version of a file's content, without reading it.

    Attributes:
        modified_ns: time of the last change, ns since 1970 UTC.
        inode: of the file system.
    """

    size_octets: int
    modified_ns: int
    inode: int

    @classmethod
    def of(cls, stat: os.stat_result) -> "FileStamp":
        """Return the stamp from a file's status."""
        return cls(stat.st_size, stat.st_mtime_ns, stat.st_ino)


def check_path(path: str, argument: int = 1) -> Refusal | None:
    """Return a refusal if a path cannot name a file of the folder; checks the text alone."""
    parts = path.split("/")
    if not path or len(path) > MAX_PATH_OCTETS or not path.isprintable():
        why = f"a path has 1 to {MAX_PATH_OCTETS} printable characters"
    elif any(part in {"", "."} for part in parts):
        why = "it must be relative to the folder, its parts separated by single slashes"
    elif ".." in parts:
        why = "it leaves the folder"
    elif any(part.startswith(".") for part in parts):
        why = "names that begin with a dot are not part of the folder"
    elif any(len(part.encode()) > MAX_NAME_OCTETS for part in parts):
        why = f"a name has {MAX_NAME_OCTETS} octets at most"
    else:
        return None
    return Refusal(Reason.BAD_PATH, f"{path[:MAX_PATH_OCTETS]!r}: {why}", argument=argument)


class FileFolder:
    """The monitored folder. Reading is safe from any thread, only the core changes it.

    Args:
        root: the folder; created by the first store.
        notify: callback for each change made here.
    """

    def __init__(self, root: Path, notify: Callable[[FileEvent], None]) -> None:
        self.root = root
        self._notify = notify

    def find(self, path: str) -> Path | Refusal:
        """Return the file of this name, or a refusal.

        A link to a target outside of the folder is refused as no file.
        """
        refusal = check_path(path)
        if refusal is not None:
            return refusal
        file = self.root / path
        if self._inside(file) and os.path.isfile(file):
            return file
        return Refusal(Reason.NO_SUCH_FILE, f"there is no file {path}", subject=path)

    def target(self, path: str) -> Path | Refusal:
        """Return the path of a new file of this name, or a refusal."""
        refusal = check_path(path, argument=2)
        if refusal is not None:
            return refusal
        file = self.root / path
        if not self._inside(file):
            return Refusal(Reason.BAD_PATH, f"{path}: it leaves the folder", argument=2)
        if os.path.lexists(file):
            return Refusal(Reason.TARGET_EXISTS, f"{path} exists already: choose another")
        return file

    def stamp(self, path: str) -> FileStamp | None:
        """Return the stamp of a file, or None without one."""
        found = self.find(path)
        if isinstance(found, Refusal):
            return None
        try:
            return FileStamp.of(found.stat())
        except OSError:
            return None

    def entries(self, folder: str = "") -> Iterator[tuple[str, FileStamp]]:
        """Yield the files below a folder with their stamps, unordered.

        Unreadable files, and files removed during the call, are left out.

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

    def metadata(self, path: str) -> tuple[Figure, ...]:
        """Return the figures stored with a file; empty if the file was replaced since."""
        try:
            known, figures = json.loads(self._about(path).read_text(encoding="utf-8"))
            if known != _mark((self.root / path).stat()):
                return ()
            return tuple(Figure(*figure) for figure in figures)
        except (OSError, ValueError, TypeError):
            return ()

    def store(self, path: str, data: bytes, about: tuple[Figure, ...] = ()) -> None:
        """Write a file with its metadata, atomically.

        Raises:
            OSError: it cannot be written.
            ValueError: no file of the folder can have this path.
        """
        if (refusal := check_path(path)) is not None:
            raise ValueError(refusal.text)
        file, note = self.root / path, self._about(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        note.parent.mkdir(parents=True, exist_ok=True)
        part = file.with_name(f".{file.name}{PART}")
        kind = FileEventKind.CHANGED if file.exists() else FileEventKind.STORED
        try:
            part.write_bytes(data)
            figures = [[f.name, f.value, f.unit] for f in about]
            note.write_text(json.dumps([_mark(part.stat()), figures]), encoding="utf-8")
            part.replace(file)
        except OSError:
            part.unlink(missing_ok=True)
            raise
        self._notify(FileEvent(kind, path))

    def delete(self, path: str) -> Refusal | None:
        """Delete a file; return a refusal if it cannot be.

        Raises:
            OSError: it cannot be deleted.
        """
        found = self.find(path)
        if isinstance(found, Refusal):
            return found
        found.unlink()
        with suppress(OSError):
            self._about(path).unlink()
        self._notify(FileEvent(FileEventKind.DELETED, path))
        return None

    def move(self, path: str, target: str) -> Refusal | None:
        """Move a file to an unused path; return a refusal if it cannot be.

        Raises:
            OSError: it cannot be moved.
        """
        found, there = self.find(path), self.target(target)
        if isinstance(found, Refusal):
            return found
        if isinstance(there, Refusal):
            return there
        there.parent.mkdir(parents=True, exist_ok=True)
        found.rename(there)
        with suppress(OSError):
            note_there = self._about(target)
            note_there.parent.mkdir(parents=True, exist_ok=True)
            self._about(path).rename(note_there)
        self._notify(FileEvent(FileEventKind.DELETED, path))
        self._notify(FileEvent(FileEventKind.STORED, target))
        return None

    def remove_partial_files(self) -> None:
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
        file = self.root / ABOUT / path
        return file.with_name(f".{file.name}")

    def _inside(self, path: Path) -> bool:
        return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(self.root))


def _mark(stat: os.stat_result) -> list[int]:
    """Return a mark that a move preserves and a replacement changes."""
    return [stat.st_size, stat.st_mtime_ns]


PICTURE_FOLDER: Final = "pictures"
MAX_SOURCE_LENGTH: Final = 64
PICTURE_PARAMETERS: Final = {
    Parameter.POS_X,
    Parameter.POS_Y,
    Parameter.POS_Z,
    Parameter.HEAD,
    Parameter.CAM_PAN,
    Parameter.CAM_TILT,
}
"""The parameters stored with a picture."""


def store_picture(
    files: FileFolder, frame: Frame, identity: Identity, values: tuple[ParameterValue, ...]
) -> str:
    """Store a camera frame with the pose and angles at its time; return its path.

    Raises:
        OSError: the file cannot be written.
    """
    name = f"{_picture_name(identity)}.{frame.format.lower()}"
    about = [Figure("commandId", identity.command_id)]
    about += [
        Figure(value.parameter.value, value.value, value.parameter.unit)
        for value in values
        if value.parameter in PICTURE_PARAMETERS and value.value is not None
    ]
    path = f"{PICTURE_FOLDER}/{name}"
    files.store(path, frame.data, tuple(about))
    return path


def picture_of(files: FileFolder, identity: Identity) -> str:
    """Return the path of the picture that a command stored; empty if there is none."""
    name = f"{PICTURE_FOLDER}/{_picture_name(identity)}."
    try:
        return next((path for path in files.paths(PICTURE_FOLDER) if path.startswith(name)), "")
    except OSError:
        return ""


def _picture_name(identity: Identity) -> str:
    return f"{_file_name(identity.source)}-{identity.command_id}"


def _file_name(source: str) -> str:
    """Return a short file name that is unique for each source."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in source)
    name = name[:MAX_SOURCE_LENGTH]
    return name if name == source else f"{name}-{sha256(source.encode()).hexdigest()[:12]}"
