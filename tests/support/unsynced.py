"""A computer on whose disk no commit waits: what a test needs of a store but its durability."""

import sqlite3
from pathlib import Path
from typing import Any, Final

from adapters.system import OperatingSystem


class _Connection(sqlite3.Connection):
    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        if sql.startswith("PRAGMA synchronous"):
            sql = "PRAGMA synchronous = OFF"
        return super().execute(sql, parameters)


class _Unsynced(OperatingSystem):
    def connect(self, database: Path | str, *, any_thread: bool = False) -> sqlite3.Connection:
        return sqlite3.connect(
            database,
            isolation_level=None,
            check_same_thread=not any_thread,
            factory=_Connection,
        )


UNSYNCED: Final = _Unsynced()
