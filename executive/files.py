"""The folder aboard that mission control sees: what lies in it, and what changes it.

Paths are relative to the folder and separated by slashes. Names that begin with a dot are not part
of it: files being written, and what is known about files (`.about`), lie under such names.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from typing import Final

from executive.reasons import Figure, Reason, Refusal

LONGEST_PATH: Final = 255
ABOUT: Final = ".about"


@unique
class FileEventKind(Enum):
    """What happened to a file (numbers as on the MRS wire)."""

    STORED = 1
    CHANGED = 2
    DELETED = 3
    TRANSFERRED = 4


@dataclass(frozen=True, slots=True)
class FileEvent:
    """Something that happened to a file of the folder."""

    kind: FileEventKind
    path: str


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
        """Remember the folder."""
        self.root = root
        self._tell = tell

    def find(self, path: str, argument: int = 1) -> Path | Refusal:
        """Return the file of this name, or why there is none.

        A link that leads out of the folder leads nowhere.
        """
        refusal = check_path(path, argument)
        if refusal is not None:
            return refusal
        place = self.root / path
        if self._inside(place) and place.is_file():
            return place
        return Refusal(Reason.NO_SUCH_FILE, f"there is no file {path}", subject=path)

    def target(self, path: str, argument: int = 2) -> Path | Refusal:
        """Return where a new file of this name would lie, or why there can be none."""
        refusal = check_path(path, argument)
        if refusal is not None:
            return refusal
        place = self.root / path
        if not self._inside(place):
            return Refusal(Reason.BAD_PATH, f"{path}: it leaves the folder", argument=argument)
        if place.exists() or place.is_symlink():
            return Refusal(Reason.TARGET_EXISTS, f"{path} exists already: choose another")
        return place

    def paths(self, folder: str = "") -> Iterator[str]:
        """Yield the paths of all files below a folder, sorted.

        Raises:
            NotADirectoryError: there is no such folder.
        """
        top = self.root / folder if folder else self.root
        if folder and (check_path(folder) is not None or not self._inside(top)):
            raise NotADirectoryError(folder)
        if not top.is_dir():
            if folder:
                raise NotADirectoryError(folder)
            return
        for place in sorted(top.rglob("*")):
            path = place.relative_to(self.root).as_posix()
            if isinstance(self.find(path), Path):
                yield path

    def about(self, path: str) -> tuple[Figure, ...]:
        """Return what is known about a file beside its content."""
        try:
            found = json.loads(self._about(path).read_text(encoding="utf-8"))
            return tuple(Figure(*figure) for figure in found)
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
        place = self.root / path
        place.parent.mkdir(parents=True, exist_ok=True)
        kind = FileEventKind.CHANGED if place.exists() else FileEventKind.STORED
        note = self._about(path)
        note.parent.mkdir(parents=True, exist_ok=True)
        note.write_text(json.dumps([[f.name, f.value, f.unit] for f in about]), encoding="utf-8")
        part = place.with_name(f".{place.name}.part")
        part.write_bytes(data)
        part.replace(place)
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
        self._about(path).unlink(missing_ok=True)
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
        note, note_there = self._about(path), self._about(target)
        if note.exists():
            note_there.parent.mkdir(parents=True, exist_ok=True)
            note.rename(note_there)
        self._tell(FileEvent(FileEventKind.DELETED, path))
        self._tell(FileEvent(FileEventKind.STORED, target))
        return None

    def _about(self, path: str) -> Path:
        place = self.root / ABOUT / path
        return place.with_name(f".{place.name}")

    def _inside(self, place: Path) -> bool:
        return place.resolve().is_relative_to(self.root.resolve())
