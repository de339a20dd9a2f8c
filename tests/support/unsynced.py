"""A computer on whose disk no commit waits: what a test needs of a store but its durability."""

import shutil
import sqlite3
import threading
from pathlib import Path
from typing import Any, Final

from adapters.system import OperatingSystem, wal_of


class _Connection(sqlite3.Connection):
    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        if sql.startswith("PRAGMA synchronous"):
            sql = "PRAGMA synchronous = OFF"
        return super().execute(sql, parameters)


class Unsynced(OperatingSystem):
    def connect(self, database: Path | str, *, any_thread: bool = False) -> sqlite3.Connection:
        return sqlite3.connect(
            database,
            isolation_level=None,
            check_same_thread=not any_thread,
            factory=_Connection,
        )

    def sync(self, database: Path) -> None:
        """Wait for nothing."""


class HeldDisk(Unsynced):
    """A computer with syncs that wait while its disk is held.

    Attributes:
        free: cleared to hold the disk.
    """

    def __init__(self) -> None:
        self.free = threading.Event()
        self.free.set()

    def sync(self, database: Path) -> None:
        assert self.free.wait(60)


class PowerLoss(Unsynced):
    """A computer that can lose its power, and with it all changes since the last sync.

    Args:
        synced: the folder with the files as of the last sync.

    Attributes:
        holds: whether a sync has no effect.
    """

    def __init__(self, synced: Path) -> None:
        self.holds, self._synced = False, synced
        synced.mkdir()

    def sync(self, database: Path) -> None:
        for path in () if self.holds else files_of(database):
            if path.exists():
                shutil.copy(path, self._synced / path.name)

    def cut_power(self, database: Path) -> None:
        """Lose the changes that are not synced; the file is closed."""
        for path in files_of(database):
            path.unlink(missing_ok=True)
            if (saved := self._synced / path.name).exists():
                shutil.copy(saved, path)


def files_of(database: Path) -> tuple[Path, Path]:
    return database, wal_of(database)


UNSYNCED: Final = Unsynced()
