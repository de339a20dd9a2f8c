"""The folder on board where pictures are kept."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

from executive.commands import Identity
from executive.facts import Frame

LONGEST_NAME: Final = 64


@dataclass(frozen=True, slots=True)
class Picture:
    """A stored picture."""

    path: Path
    octets: int


class PictureFolder:
    """Stores camera frames as files named after the command that asked for them.

    Args:
        folder: made on the first store.
    """

    def __init__(self, folder: Path) -> None:
        """Remember the folder."""
        self.folder = folder

    def store(self, frame: Frame, identity: Identity) -> Picture:
        """Write a frame whole or not at all.

        Raises:
            OSError: the file cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        source = _file_name(identity.source)
        path = self.folder / f"{source}-{identity.command_id}.{frame.format.lower()}"
        part = path.with_suffix(".part")
        part.write_bytes(frame.data)
        part.replace(path)
        return Picture(path, len(frame.data))


def _file_name(source: str) -> str:
    """Return a short name for a file, no two sources' alike."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in source)
    name = name[:LONGEST_NAME]
    return name if name == source else f"{name}-{sha256(source.encode()).hexdigest()[:12]}"
