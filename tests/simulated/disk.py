"""The disk of a simulated process: commits that fail or are the last, and losses of power."""

import errno
import os
import sqlite3
import struct
from contextlib import closing
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

if TYPE_CHECKING:
    from tests.simulated.process import Incarnation, Process

_FREE_OCTETS: Final = 1 << 36
_WAL_HEADER: Final = 32
_FRAME_HEADER: Final = 24
_SALT: Final = slice(32, 40)
_CHANGES: Final = ("INSERT", "UPDATE", "DELETE")


class Fate(Enum):
    """What becomes of a write."""

    DONE = "done"
    KILLED_BEFORE = "killed before"
    KILLED_AFTER = "killed after"
    FAILED = "failed"


class Plan(Protocol):
    """Decides about each write of a process, such as a plan of kills."""

    def fate(self, process: "Process", path: Path) -> Fate:
        """Return what becomes of a commit to a database, or of a file that is written anew."""
        ...


class Untroubled:
    """A plan by which everything is written."""

    def fate(self, process: "Process", path: Path) -> Fate:
        """Return that it is written."""
        return Fate.DONE


class Nth:
    """A plan by which the nth write from now on has another fate, and the rest are done.

    Attributes:
        count: how many writes there were.
        next: the number of the write that has it; None for none.
        then: that fate.
    """

    def __init__(self, number: int | None = None, then: Fate = Fate.KILLED_AFTER) -> None:
        self.count, self.next, self.then = 0, number, then

    def after(self, writes: int, then: Fate) -> None:
        """Have the nth write from now on end so."""
        self.next, self.then = self.count + writes, then

    def fate(self, process: "Process", path: Path) -> Fate:
        """Return what becomes of a write."""
        self.count += 1
        if self.next is None or self.count < self.next:
            return Fate.DONE
        self.next = None
        return self.then


class Disk:
    """What all lives of a process write to.

    Args:
        process: whose.

    Attributes:
        plan: decides about each write.
        full: whether nothing more can be written.
        unfilled_octets: what is free, unless it is full.
        commits: how many there were.
        unwritten: how many files could not be written anew.
    """

    def __init__(self, process: "Process") -> None:
        self._process = process
        self._chance = process.world.random(f"disk/{process.name}")
        self.plan: Plan = Untroubled()
        self.full = False
        self.unfilled_octets = _FREE_OCTETS
        self.commits = self.unwritten = 0

    def connect(self, incarnation: "Incarnation", database: Path | str) -> "SimConnection":
        """Open a file for a life of the process."""
        incarnation.require()
        connection = sqlite3.connect(database, isolation_level=None, factory=SimConnection)
        connection.belong(self, incarnation, Path(database).absolute())
        incarnation.databases.append(connection)
        return connection

    def replace(self, incarnation: "Incarnation", path: Path, content: bytes) -> None:
        """Write a file anew, whole or not at all."""
        incarnation.require()
        fate = self._fate(path)
        if fate is Fate.KILLED_BEFORE:
            self._process.kill()
        incarnation.require()
        if self.full or fate is Fate.FAILED:
            self.unwritten += 1
            number = errno.ENOSPC if self.full else errno.EIO
            raise OSError(number, os.strerror(number), str(path))
        new = path.with_name(f"{path.name}.new")
        new.write_bytes(content)
        new.replace(path)
        if fate is Fate.KILLED_AFTER:
            self._process.kill()
            incarnation.require()

    def commit(
        self, connection: "SimConnection", incarnation: "Incarnation", path: Path
    ) -> sqlite3.Cursor:
        """Commit, or do not, as the plan says."""
        incarnation.require()
        fate = self._fate(path)
        if fate is Fate.KILLED_BEFORE:
            self._process.kill()
        incarnation.require()
        if self.full or fate is Fate.FAILED:
            if self._chance.random() < 0.5:  # some errors of SQLite undo the transaction
                connection.run("ROLLBACK")
            raise _full() if self.full else _failed()
        done = connection.run("COMMIT")
        self.commits += 1
        if fate is Fate.KILLED_AFTER:
            self._process.kill()
            incarnation.require()
        return done

    def sync(self, incarnation: "Incarnation", database: Path) -> None:
        """Make the commits to a database survive a loss of power."""
        incarnation.require()
        for connection in incarnation.databases:
            if connection.path == database.absolute():
                connection.synced_frames = _frames(connection.path)

    def free_octets(self) -> int:
        """Return what is free."""
        return 0 if self.full else self.unfilled_octets

    def lose_unsynced(self, saved: Path) -> None:
        """Take from a copy of the folder what was not synced: of each database some last commits.

        Only such that do not sync each commit lose any, and only what was not moved from the log to
        the file yet: the log is cut somewhere behind that.
        """
        folder = self._process.folder.absolute()
        for connection in self._process.present.databases:
            path = connection.path
            if connection.synced or not path.is_relative_to(folder):
                continue
            log = saved / path.relative_to(folder).with_name(f"{path.name}-wal")
            index = path.with_name(f"{path.name}-shm")
            if log.exists() and index.exists():
                self._cut(log, index, connection.synced_frames)

    def _cut(self, log: Path, index: Path, synced: tuple[bytes, int]) -> None:
        """Cut a log at any frame behind those that are in the file (SQLite's WAL-index format).

        Those that were synced since the log began anew stay as well.
        """
        with index.open("rb") as file:
            header = file.read(100)
        with log.open("rb") as file:
            log_header = file.read(_WAL_HEADER)
        if len(header) < 100 or len(log_header) < _WAL_HEADER:
            return
        (last,) = struct.unpack_from("=I", header, 16)
        (moved,) = struct.unpack_from("=I", header, 96)
        (page_octets,) = struct.unpack_from(">I", log_header, 8)
        if last <= moved:
            return
        salt, synced_frames = synced
        least = max(moved, synced_frames) if salt == header[_SALT] else moved
        frames = self._chance.randint(least, last)
        os.truncate(log, _WAL_HEADER + frames * (_FRAME_HEADER + page_octets))

    def _fate(self, path: Path) -> Fate:
        return self.plan.fate(self._process, path)


class SimConnection(sqlite3.Connection):
    """An SQLite file of a simulated process; COMMIT goes by its disk.

    Attributes:
        path: the file.
        synced: whether each commit is to survive loss of power.
        synced_frames: frames of the log that do so anyway, with the salt of its beginning.
    """

    path: Path
    synced = True
    synced_frames: tuple[bytes, int] = (b"", 0)

    def belong(self, disk: Disk, incarnation: "Incarnation", path: Path) -> None:
        """Know whose it is."""
        self._disk, self._incarnation, self.path = disk, incarnation, path

    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        """Run a statement."""
        if sql == "COMMIT":
            return self._disk.commit(self, self._incarnation, self.path)
        if sql.startswith("PRAGMA synchronous"):
            self.synced = sql.rstrip(" ;").upper().endswith(("FULL", "EXTRA"))
            sql = "PRAGMA synchronous = OFF"
        if sql.startswith(_CHANGES) and not self.in_transaction:  # commits by itself
            super().execute("BEGIN")
            cursor = super().execute(sql, parameters)
            try:
                self._disk.commit(self, self._incarnation, self.path)
            except sqlite3.Error:
                self.rollback()
                raise
            return cursor
        return super().execute(sql, parameters)

    def commit(self) -> None:
        """Commit, if there is something to."""
        if self.in_transaction:
            self.execute("COMMIT")

    def run(self, sql: str) -> sqlite3.Cursor:
        """Run a statement on the real file."""
        return super().execute(sql)


def _frames(database: Path) -> tuple[bytes, int]:
    """Return the salt of a database's log, and how many frames it has (the WAL-index header)."""
    with database.with_name(f"{database.name}-shm").open("rb") as file:
        header = file.read(48)
    return header[_SALT], struct.unpack_from("=I", header, 16)[0]


def rows(path: Path, query: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
    """Return what is committed to a file, as a judge reads it: no part of the simulation."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
        return connection.execute(query, values).fetchall()


def _full() -> sqlite3.OperationalError:
    error = sqlite3.OperationalError("database or disk is full")
    error.sqlite_errorcode = sqlite3.SQLITE_FULL
    error.sqlite_errorname = "SQLITE_FULL"
    return error


def _failed() -> sqlite3.OperationalError:
    error = sqlite3.OperationalError("disk I/O error")
    error.sqlite_errorcode = sqlite3.SQLITE_IOERR
    error.sqlite_errorname = "SQLITE_IOERR"
    return error
