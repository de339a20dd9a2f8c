"""The file that holds what must survive: SQLite in write-ahead mode, written in groups.

Writes gather in one transaction until `commit`; what a commit returned from survives `kill -9`
and loss of power.
"""

import logging
import sqlite3
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from adapters.bundle.codec.errors import StoreError, StoreFull
from adapters.system import OPERATING_SYSTEM, System

_LOG: Final = logging.getLogger(__name__)
_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS counts (name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS outbox (
    id INTEGER PRIMARY KEY AUTOINCREMENT, key BLOB NOT NULL, destination BLOB NOT NULL,
    neighbour TEXT NOT NULL, state INTEGER NOT NULL, confirm INTEGER NOT NULL,
    put_utc_ms INTEGER NOT NULL, expires_utc_ms INTEGER NOT NULL, again_utc_ms INTEGER,
    tries INTEGER NOT NULL DEFAULT 0, own INTEGER NOT NULL, octets BLOB NOT NULL,
    expedited INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX IF NOT EXISTS outbox_to_send ON outbox (neighbour, state, id);
CREATE INDEX IF NOT EXISTS outbox_by_key ON outbox (key);
CREATE INDEX IF NOT EXISTS outbox_by_end ON outbox (expires_utc_ms);
CREATE INDEX IF NOT EXISTS outbox_expedited ON outbox (neighbour, id) WHERE expedited;
CREATE INDEX IF NOT EXISTS outbox_again ON outbox (again_utc_ms) WHERE again_utc_ms IS NOT NULL;
CREATE TABLE IF NOT EXISTS inbox (
    id INTEGER PRIMARY KEY AUTOINCREMENT, key BLOB NOT NULL, endpoint BLOB NOT NULL,
    report_to BLOB NOT NULL, flags INTEGER NOT NULL, expires_utc_ms INTEGER NOT NULL,
    payload BLOB NOT NULL, expedited INTEGER NOT NULL DEFAULT 0
);
CREATE INDEX IF NOT EXISTS inbox_expedited ON inbox (id) WHERE expedited;
CREATE INDEX IF NOT EXISTS inbox_by_key ON inbox (key);
CREATE INDEX IF NOT EXISTS inbox_by_end ON inbox (expires_utc_ms);
CREATE TABLE IF NOT EXISTS seen (
    key BLOB PRIMARY KEY, until_utc_ms INTEGER NOT NULL
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS seen_by_end ON seen (until_utc_ms);
CREATE TABLE IF NOT EXISTS fragments (
    key BLOB NOT NULL, total INTEGER NOT NULL, offset INTEGER NOT NULL, length INTEGER NOT NULL,
    expires_utc_ms INTEGER NOT NULL, payload BLOB NOT NULL,
    PRIMARY KEY (key, total, offset, length)
);
CREATE INDEX IF NOT EXISTS fragments_by_end ON fragments (expires_utc_ms);
"""
_MB: Final = 1_000_000
_FULL_ERRORS: Final = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR)


@dataclass(frozen=True, slots=True)
class StoreLimits:
    """When the store counts as full, before the disk is.

    Attributes:
        most_octets: what its content may take.
        least_free_octets: what must stay free on the disk.
        reserved_octets: how far expedited bundles may go beyond `most_octets`; of the disk they may
            take all.
    """

    most_octets: int = 1 << 30
    least_free_octets: int = 64 << 20
    reserved_octets: int = 4 << 20


class BundleDatabase:
    """One file and the transaction that is being gathered; used by one thread.

    The file is made with its folders if missing.

    Attributes:
        full: whether nothing new should be taken in, as of the last look.
        room_octets: how much may be taken in, as of the last look.
        capacity_octets: that, and what it holds.

    Raises:
        StoreError: from every method, if the file cannot be read or written; what has gathered is
            then undone, and nothing is written before `undo`.
        StoreFull: the same, for want of room.
    """

    def __init__(
        self,
        path: Path,
        limits: StoreLimits | None = None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self.path, self._system = path, system
        self._limits = limits or StoreLimits()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = _opened(system.connect(path))
        except (OSError, sqlite3.Error) as error:
            raise StoreError(f"bundle store {path}: {error}") from error
        self.full = False
        self.room_octets = self.capacity_octets = self._spare_octets = 0
        self._failure: StoreError | None = None
        self.look_for_room()

    @property
    def gathering(self) -> bool:
        """Whether something is written and not committed."""
        return self._db.in_transaction or self._failure is not None

    def write(self, statement: str, values: tuple[object, ...] = ()) -> sqlite3.Cursor:
        """Run a statement within the transaction."""
        try:
            self._begin()
            return self._db.execute(statement, values)
        except sqlite3.Error as error:
            raise self._undone(error) from error

    def write_all(self, statement: str, rows: Iterable[tuple[object, ...]]) -> None:
        """Run a statement for each row within the transaction."""
        try:
            self._begin()
            self._db.executemany(statement, rows)
        except sqlite3.Error as error:
            raise self._undone(error) from error

    def read(self, statement: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        """Return the rows of a query, which sees what has gathered."""
        try:
            return self._db.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise self._undone(error) from error

    def read_some(
        self, statement: str, values: tuple[object, ...], most_octets: int = 1 << 20
    ) -> list[tuple[Any, ...]]:
        """Return rows of a query, at least one, until their last columns hold so many octets."""
        rows = []
        try:
            cursor = self._db.execute(statement, values)
            for row in cursor:
                rows.append(row)
                most_octets -= len(row[-1])
                if most_octets <= 0:
                    break
            cursor.close()
        except sqlite3.Error as error:
            raise self._undone(error) from error
        return rows

    def commit(self) -> None:
        """Write what has gathered, whole or not at all."""
        if self._failure is not None:
            raise self._failure
        if self._db.in_transaction:
            try:
                self._db.execute("COMMIT")
            except sqlite3.Error as error:
                raise self._undone(error) from error
        self.look_for_room()

    def undo(self) -> None:
        """Undo what has gathered, and begin afresh after an error."""
        if self._db.in_transaction:
            self._db.execute("ROLLBACK")
        self._failure = None

    def count(self, name: str) -> int:
        """Return a durable counter."""
        rows = self.read("SELECT value FROM counts WHERE name = ?", (name,))
        return int(rows[0][0]) if rows else 0

    def set_count(self, name: str, value: int) -> None:
        """Set a durable counter within the transaction."""
        self.write("INSERT OR REPLACE INTO counts VALUES (?, ?)", (name, value))

    def reserve(self, name: str, count: int) -> int:
        """Reserve numbers for good, and commit; return the first of them."""
        first = self.count(name) + 1
        self.set_count(name, first + count - 1)
        self.commit()
        return first

    def look_for_room(self) -> None:
        """Measure how much room there is; other processes use the disk as well."""
        limits = self._limits
        octets = self.octets
        left = limits.most_octets - octets, self._free_octets - limits.least_free_octets
        self.room_octets = max(0, min(left))
        self.capacity_octets = octets + self.room_octets
        self.full = min(left) < 0
        self._spare_octets = min(left[0] + limits.reserved_octets, self._free_octets)

    def require_room(self, octets: int = 0, *, expedited: bool = False) -> None:
        """Check that there was room at the last look; some is reserved for expedited bundles.

        What this one takes of the reserve is counted until the next look.

        Raises:
            StoreFull: there was none.
        """
        if self.full and not (expedited and self._spare_octets >= octets):
            raise self.no_room()
        self._spare_octets -= octets

    def no_room(self) -> StoreFull:
        """Return the error for a full store, which says why it is full."""
        limits, free = self._limits, self._free_octets
        if free < limits.least_free_octets:
            why = (
                f"{free // _MB} MB are free on its disk, where {limits.least_free_octets // _MB} MB"
                " stay free: make room there"
            )
        else:
            why = f"it holds {limits.most_octets // _MB} MB, its most, until some of that is sent"
        return StoreFull(f"bundle store {self.path}: there is no room: {why}")

    @property
    def _free_octets(self) -> int:
        try:
            return self._system.free_octets(self.path.parent)
        except OSError:  # its folder is gone: nothing can be kept there
            return 0

    @property
    def octets(self) -> int:
        """How much the content takes."""
        ((pages,),) = self.read("PRAGMA page_count")
        ((free,),) = self.read("PRAGMA freelist_count")
        ((size,),) = self.read("PRAGMA page_size")
        return int((pages - free) * size)

    def close(self) -> None:
        """Close the file; what has gathered and is not committed is lost, as in a crash."""
        self._db.close()

    def _begin(self) -> None:
        if self._failure is not None:
            raise self._failure
        if not self._db.in_transaction:
            self._db.execute("BEGIN IMMEDIATE")

    def _undone(self, error: sqlite3.Error) -> StoreError:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if self._db.in_transaction:
            self._db.execute("ROLLBACK")
        text = f"bundle store {self.path}: {error}"
        self.full |= code in _FULL_ERRORS
        self._failure = StoreFull(text) if code in _FULL_ERRORS else StoreError(text)
        return self._failure


def _opened(db: sqlite3.Connection) -> sqlite3.Connection:
    try:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
        db.execute("PRAGMA journal_size_limit = 4194304")
        db.execute("PRAGMA cache_size = -1000")
        db.executescript(_SCHEMA)
    except sqlite3.Error:
        db.close()
        raise
    return db


class GroupCommit:
    """Groups changes into commits, and defers notifications until they are on the disk.

    Changes that can be undone are written to the database at once. Those that cannot, because what
    they stand for has happened, are marks: they are written with the next commit that succeeds.

    Attributes:
        failing: whether the last commit failed.
    """

    def __init__(self, database: BundleDatabase) -> None:
        self._database = database
        self._marks: list[Callable[[], None]] = []
        self._waiting: list[Callable[[StoreError | None], None]] = []
        self.failing = False

    @property
    def pending(self) -> bool:
        """Whether there is something to commit."""
        return bool(self._marks or self._waiting) or self._database.gathering

    def mark(self, write: Callable[[], None]) -> None:
        """Write with the next commit; if that fails, again with the one after."""
        self._marks.append(write)

    def then(self, tell: Callable[[StoreError | None], None]) -> None:
        """Call back after the next commit: with None if it succeeded, or the error."""
        self._waiting.append(tell)

    def commit(self) -> None:
        """Commit what has gathered, and run all callbacks; one may raise."""
        failure: StoreError | None = None
        try:
            for write in self._marks:
                write()
            self._database.commit()
            self._marks.clear()
        except StoreError as error:
            failure = error
            self._database.undo()
        if failure is not None and not self.failing:
            _LOG.error("nothing can be stored: %s", failure)
        self.failing = failure is not None
        waiting, self._waiting = self._waiting, []
        with ExitStack() as told:
            for tell in reversed(waiting):
                told.callback(tell, failure)
