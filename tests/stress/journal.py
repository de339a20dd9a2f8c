"""Journals that survive kill -9: what `write` returned from is there; a row cut short is not."""

import json
import os
from pathlib import Path
from typing import Any


class Journal:
    """Rows of JSON in a file; what is there already stays, and more is added.

    Attributes:
        rows: what was there when it was opened.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        whole = _whole(path)
        os.ftruncate(self._file, len(whole))
        self.rows = _rows(whole)

    def write(self, *row: object) -> None:
        """Add a row: out of this process's hands when this returns."""
        os.write(self._file, json.dumps(row).encode() + b"\n")

    def close(self) -> None:
        os.close(self._file)


def read_journal(path: Path) -> list[list[Any]]:
    """Return the rows of a journal that somebody else may be writing."""
    return _rows(_whole(path)) if path.exists() else []


def _whole(path: Path) -> bytes:
    octets = path.read_bytes()
    return octets[: octets.rfind(b"\n") + 1]


def _rows(octets: bytes) -> list[list[Any]]:
    return [json.loads(line) for line in octets.splitlines()]
