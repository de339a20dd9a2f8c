"""`Database`: an SQLite file in write-ahead mode, through which every record is read and written.

Committed data survive `kill -9` and, with FULL synchronisation, loss of power. Only
one thread uses it.
"""

import sqlite3
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from typing import Any


class Synchronous(Enum):
    """Durability of a commit: FULL waits for the disk, NORMAL for the operating system."""

    FULL = "FULL"
    NORMAL = "NORMAL"


Statement = tuple[str, tuple[object, ...]]
"""A statement of SQL with its values."""

Connect = Callable[[Path | str], sqlite3.Connection]
"""Opens an SQLite file without implicit transactions; raises OSError or sqlite3.Error."""


def connect_to_file(path: Path | str) -> sqlite3.Connection:
    """Open a file of this computer."""
    return sqlite3.connect(path, isolation_level=None)


class LedgerError(Exception):
    """A record cannot be read or written; the text names the file and the cause."""


class Database:
    """Tables in one file. Writes gather in one transaction until `commit`.

    Args:
        path: the file, created with its folders if missing; None for an in-memory database.
        schema: creates the tables if missing.
        synchronous: durability of a commit.
        connect: opens the file.
        version: version of the tables; a file with another one is refused.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(
        self,
        path: Path | None,
        schema: str,
        synchronous: Synchronous = Synchronous.FULL,
        connect: Connect = connect_to_file,
        version: int = 0,
    ) -> None:
        self.path = path or ":memory:"
        self._pending: list[Statement] = []
        try:
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._db = connect(self.path)
        except (OSError, sqlite3.Error) as error:
            raise self._error(error) from error
        try:
            self.rows("PRAGMA journal_mode = WAL")
            self.rows(f"PRAGMA synchronous = {synchronous.value}")
            self._check_version(version)
            self.make_tables(schema)
        except LedgerError:
            self._db.close()
            raise

    def _check_version(self, version: int) -> None:
        """Record the version of the tables in a new file.

        Raises:
            LedgerError: the file has the tables of another version, or cannot be read or written.
        """
        ((found,),) = self.rows("PRAGMA user_version")
        if found == version:
            return
        if self.rows("SELECT 1 FROM sqlite_master LIMIT 1"):
            raise LedgerError(
                f"{self.path} has the tables of another version ({found}, not {version}):"
                " start that version, or move the file away"
            )
        self.rows(f"PRAGMA user_version = {version}")

    def make_tables(self, schema: str) -> None:
        """Create tables if missing."""
        try:
            self._db.executescript(schema)
        except sqlite3.Error as error:
            raise self._error(error) from error

    def rows(self, statement: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        """Return committed rows."""
        try:
            return self._db.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise self._error(error) from error

    def write(self, statement: str, values: tuple[object, ...] = ()) -> None:
        """Add a change of the tables to the next commit."""
        self._pending.append((statement, values))

    def commit(self) -> None:
        """Commit pending writes atomically; on an error they remain pending."""
        self.transact(self._pending)
        self._pending.clear()

    def transact(self, statements: Sequence[Statement]) -> None:
        """Execute statements in one transaction: all of them or none."""
        if not statements:
            return
        try:
            self._db.execute("BEGIN")
            for statement, values in statements:
                self._db.execute(statement, values)
            self._db.execute("COMMIT")
        except sqlite3.Error as error:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise self._error(error) from error

    def discard(self) -> None:
        """Discard pending writes."""
        self._pending.clear()

    def image(self) -> bytes:
        """Return the committed content of the file."""
        try:
            return self._db.serialize()
        except sqlite3.Error as error:
            raise self._error(error) from error

    def abandon(self) -> None:
        """Close the file as a crash would: pending writes are lost."""
        self.discard()
        self._db.close()

    def close(self) -> None:
        """Commit pending writes and close the file."""
        self.commit()
        self._db.close()

    def _error(self, error: Exception) -> LedgerError:
        return LedgerError(f"ledger {self.path}: {error}")
