"""Where the bridge keeps what ION has forgotten and the agent has not yet."""

import os
from pathlib import Path

from adapters.bundle.errors import DecodeError
from adapters.bundle.ion.frames import Received, decode_frame, encode_frame

_LENGTH_OCTETS = 4


class Spool:
    """One unit, in a file.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        """Use this file, which need not be there."""
        self._path = path

    def load(self) -> Received | None:
        """Return what a bridge before this one has left, if anything.

        Raises:
            OSError: it cannot be read.
        """
        try:
            frame = decode_frame(self._path.read_bytes()[_LENGTH_OCTETS:])
        except (FileNotFoundError, DecodeError):
            return None
        return frame if isinstance(frame, Received) else None

    def save(self, unit: Received) -> None:
        """Have it on the disk when this returns.

        Raises:
            OSError: it cannot be written.
        """
        beside = self._path.with_suffix(".new")
        with beside.open("wb") as file:
            file.write(encode_frame(unit))
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self._path)
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def clear(self) -> None:
        """Forget it."""
        self._path.unlink(missing_ok=True)
