"""`BundleDatabase`: durable store of a bundle node, SQLite in write-ahead mode.

Writes accumulate in one transaction until `commit`. Committed data survive `kill -9`, and loss of
power after `sync`, which another thread may call: the node continues during it.
"""

import logging
import sqlite3
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from adapters.bundle.codec.errors import StoreError, StoreFull
from adapters.system import OPERATING_SYSTEM, SYNCED_APART, System, sync_database

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
_DISK_FULL_ERRORS: Final = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR)


@dataclass(frozen=True, slots=True)
class StoreLimits:
    """Limits at which the store counts as full, before the disk is full.

    Attributes:
        max_octets: maximum size of the content.
        min_free_octets: free space that remains on the disk.
        reserved_octets: space for expedited bundles beyond `max_octets`. They may also use all
            free space of the disk.
    """

    max_octets: int = 1 << 30
    min_free_octets: int = 64 << 20
    reserved_octets: int = 4 << 20


class BundleDatabase:
    """A database file with its pending transaction; used by one thread.

    The file and its folders are created if missing.

    Attributes:
        durable: the last row ids of outbox and inbox that survive loss of power.
        full: whether new bundles are refused, by the latest measurement.
        free_octets: space for new bundles, by the latest measurement.
        capacity_octets: `free_octets` and the size of the content.

    Raises:
        StoreError: by every method, if the file cannot be read or written. The pending changes
            are then rolled back, and nothing is written before `rollback`.
        StoreFull: likewise, for lack of space.
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
        self.free_octets = self.capacity_octets = self._spare_octets = 0
        self._failure: StoreError | None = None
        self.measure_free_space()
        self.sync()
        self.durable = self.last_ids()

    @property
    def gathering(self) -> bool:
        """Whether there are uncommitted changes."""
        return self._db.in_transaction or self._failure is not None

    def write(self, statement: str, values: tuple[object, ...] = ()) -> sqlite3.Cursor:
        """Execute a statement within the transaction."""
        try:
            self._begin()
            return self._db.execute(statement, values)
        except sqlite3.Error as error:
            raise self._undone(error) from error

    def write_all(self, statement: str, rows: Iterable[tuple[object, ...]]) -> None:
        """Execute a statement for each row within the transaction."""
        try:
            self._begin()
            self._db.executemany(statement, rows)
        except sqlite3.Error as error:
            raise self._undone(error) from error

    def read(self, statement: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        """Return the rows of a query; it sees uncommitted changes."""
        try:
            return self._db.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise self._undone(error) from error

    def read_some(
        self, statement: str, values: tuple[object, ...], max_octets: int = 1 << 20
    ) -> list[tuple[Any, ...]]:
        """Return rows of a query, at least one, up to `max_octets` of their last column."""
        rows = []
        try:
            cursor = self._db.execute(statement, values)
            for row in cursor:
                rows.append(row)
                max_octets -= len(row[-1])
                if max_octets <= 0:
                    break
            cursor.close()
        except sqlite3.Error as error:
            raise self._undone(error) from error
        return rows

    def commit(self) -> None:
        """Commit the pending changes, all or none."""
        if self._failure is not None:
            raise self._failure
        if self._db.in_transaction:
            try:
                self._db.execute("COMMIT")
            except sqlite3.Error as error:
                raise self._undone(error) from error
        self.measure_free_space()

    def sync(self) -> None:
        """Return when all committed changes are on the disk; for any thread."""
        try:
            sync_database(self._system, self.path)
        except (OSError, sqlite3.Error) as error:
            raise StoreError(f"bundle store {self.path}: {error}") from error

    def last_ids(self) -> dict[str, int]:
        """Return the last row ids of outbox and inbox."""
        rows = self.read("SELECT name, seq FROM sqlite_sequence")
        return {"outbox": 0, "inbox": 0, **dict(rows)}

    def rollback(self) -> None:
        """Roll back the pending changes, and clear the error state."""
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
        """Reserve a range of numbers durably; return the first of them."""
        first = self.count(name) + 1
        self.set_count(name, first + count - 1)
        self.commit()
        return first

    def measure_free_space(self) -> None:
        """Measure the free space, which other processes use as well."""
        limits = self._limits
        octets = self.octets
        left = limits.max_octets - octets, self._free_octets - limits.min_free_octets
        self.free_octets = max(0, min(left))
        self.capacity_octets = octets + self.free_octets
        self.full = min(left) < 0
        self._spare_octets = min(left[0] + limits.reserved_octets, self._free_octets)

    def require_space(self, octets: int = 0, *, expedited: bool = False) -> None:
        """Raise StoreFull if the latest measurement found no space for a bundle.

        Expedited bundles may use the reserve. Their size is subtracted until the next measurement.

        Raises:
            StoreFull: there is no space.
        """
        if self.full and not (expedited and self._spare_octets >= octets):
            raise self.full_error()
        self._spare_octets -= octets

    def full_error(self) -> StoreFull:
        """Return the error for a full store; its text gives the reason."""
        limits, free = self._limits, self._free_octets
        if free < limits.min_free_octets:
            why = (
                f"{free // _MB} MB are free on the disk, {limits.min_free_octets // _MB} MB must"
                " stay free: free disk space"
            )
        else:
            why = f"it holds its maximum of {limits.max_octets // _MB} MB until bundles are sent"
        return StoreFull(f"bundle store {self.path} is full: {why}")

    @property
    def _free_octets(self) -> int:
        try:
            return self._system.free_octets(self.path.parent)
        except OSError:  # the folder was deleted: nothing can be stored
            return 0

    @property
    def octets(self) -> int:
        """Size of the content in octets."""
        ((pages,),) = self.read("PRAGMA page_count")
        ((free,),) = self.read("PRAGMA freelist_count")
        ((size,),) = self.read("PRAGMA page_size")
        return int((pages - free) * size)

    def close(self) -> None:
        """Close the file; uncommitted changes are lost, as in a crash."""
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
        self.full |= code in _DISK_FULL_ERRORS
        self._failure = StoreFull(text) if code in _DISK_FULL_ERRORS else StoreError(text)
        return self._failure


def _opened(db: sqlite3.Connection) -> sqlite3.Connection:
    try:
        db.execute("PRAGMA journal_mode = WAL")
        for setting in SYNCED_APART:
            db.execute(setting)
        db.execute("PRAGMA cache_size = -1000")
        db.executescript(_SCHEMA)
    except sqlite3.Error:
        db.close()
        raise
    return db


class GroupCommit:
    """Groups changes into commits, and defers callbacks until the commit.

    Changes that may be rolled back go to the database at once. Changes that record an event that
    has already happened are marks: they are repeated until a commit succeeds.

    A commit has two halves: `write` does not wait for the disk, and the callbacks wait until the
    owner has synced the database, between `begin_sync` and `end_sync`.

    Attributes:
        failing: whether the latest write failed.
        unsynced: whether changes were written since `begin_sync`.
    """

    def __init__(self, database: BundleDatabase) -> None:
        self._database = database
        self._marks: list[Callable[[], None]] = []
        self._waiting: list[Callable[[StoreError | None], None]] = []
        self._written: list[Callable[[StoreError | None], None]] = []
        self._syncing: list[Callable[[StoreError | None], None]] = []
        self._ids = self._committed = database.durable
        self.failing = self.unsynced = False

    @property
    def pending(self) -> bool:
        """Whether there are changes or callbacks to commit."""
        return bool(self._marks or self._waiting) or self._database.gathering

    def add_retried(self, write: Callable[[], None]) -> None:
        """Execute `write` in the next commit, and again in later ones until one succeeds."""
        self._marks.append(write)

    def on_commit(self, on_committed: Callable[[StoreError | None], None]) -> None:
        """Call back after the next commit, with None on success, otherwise with the error."""
        self._waiting.append(on_committed)

    def commit(self) -> None:
        """Write and sync the pending changes, and run all callbacks."""
        self.write()
        self.begin_sync()
        try:
            self._database.sync()
        except StoreError as error:
            self.end_sync(error)
        else:
            self.end_sync()
            self.release()

    def begin_sync(self) -> None:
        """Begin the sync of all written changes, including those of a failed sync."""
        self._syncing, self._written, self.unsynced = self._syncing + self._written, [], False
        self._ids = self._committed

    def end_sync(self, failure: StoreError | None = None) -> None:
        """Run the callbacks of the sync that has ended, even if one raises."""
        done, self._syncing = self._syncing, []
        _run(done, failure)

    def release(self) -> None:
        """Let links and application have the bundles of the sync that has ended."""
        self._database.durable = self._ids

    def write(self) -> None:
        """Write the pending changes; if that fails, run their callbacks, even if one raises."""
        failure: StoreError | None = None
        try:
            for write in self._marks:
                write()
            self._database.commit()
            self._marks.clear()
            self._committed = self._database.last_ids()
        except StoreError as error:
            failure = error
            self._database.rollback()
        if failure is not None and not self.failing:
            _LOG.error("commit of the bundle store failed: %s", failure)
        self.failing = failure is not None
        waiting, self._waiting = self._waiting, []
        if failure is not None:
            _run(waiting, failure)
            return
        self._written += waiting
        self.unsynced = True


def _run(
    callbacks: Iterable[Callable[[StoreError | None], None]], failure: StoreError | None
) -> None:
    with ExitStack() as stack:
        for callback in reversed([*callbacks]):
            stack.callback(callback, failure)
