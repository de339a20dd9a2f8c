"""A computer on whose disk no commit waits: what a test needs of a store but its durability."""

import sqlite3
import threading
from pathlib import Path
from typing import Any, Final

from adapters.system import OperatingSystem


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


UNSYNCED: Final = Unsynced()
