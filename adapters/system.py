"""`System`: the interface of a process to its computer: time, randomness, disk and sockets.

All other events of a process arrive through its event loop. With another system and another loop
the same code runs in simulated time.
"""

import os
import socket
import sqlite3
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Final, Protocol

_BACKLOG: Final = 128
"""Connections that the operating system holds until they are accepted."""
Socket = socket.socket
SocketAddress = tuple[str, int]
BindAddress = tuple[str | int | bytes, ...]
"""As returned by `getaddrinfo`."""


class System(Protocol):
    """The computer of a process. It also implements `executive.values.clock.Clock`."""

    def now_s(self) -> float:
        """Return seconds that never step back."""
        ...

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        ...

    def random_octets(self, count: int) -> bytes:
        """Return cryptographically secure random octets."""
        ...

    def connect(self, database: Path | str, *, any_thread: bool = False) -> sqlite3.Connection:
        """Open an SQLite file without implicit transactions; raises OSError or sqlite3.Error.

        With `any_thread` other threads may use it, too, one at a time.
        """
        ...

    def sync(self, database: Path) -> None:
        """Return once all commits to an SQLite file in WAL mode are on the disk; raises OSError."""
        ...

    def replace(self, path: Path, content: bytes) -> None:
        """Replace a file durably and atomically; raises OSError."""
        ...

    def free_octets(self, folder: Path) -> int:
        """Return the free space for this process on a disk; raises OSError."""
        ...

    def cpu_s(self) -> float:
        """Return the processor time of this process, s."""
        ...

    def memory_octets(self) -> int | None:
        """Return the resident memory of this process; None if unknown."""
        ...

    def listen(self, address: SocketAddress, family: socket.AddressFamily) -> Socket:
        """Return a listening TCP socket, for the loop's `sock_accept`; raises OSError."""
        ...

    def datagrams(
        self, address: BindAddress, family: socket.AddressFamily, buffer_octets: int
    ) -> Socket:
        """Return a bound UDP socket, for the loop's `add_reader`; raises OSError."""
        ...


def utc_ns(system: System) -> int:
    """Return nanoseconds since 1970-01-01 UTC."""
    return round(system.utc_s() * 1e9)


def wal_of(database: Path) -> Path:
    """Return the write-ahead log of an SQLite file."""
    return database.with_name(f"{database.name}-wal")


class OperatingSystem:
    """The operating system of this process."""

    now_s = staticmethod(time.monotonic)
    utc_s = staticmethod(time.time)
    random_octets = staticmethod(os.urandom)
    cpu_s = staticmethod(time.process_time)

    def connect(self, database: Path | str, *, any_thread: bool = False) -> sqlite3.Connection:
        """Open an SQLite file without implicit transactions."""
        return sqlite3.connect(database, isolation_level=None, check_same_thread=not any_thread)

    def sync(self, database: Path) -> None:
        """Return once all commits to an SQLite file in WAL mode are on the disk."""
        log = os.open(wal_of(database), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            os.fsync(log)
        finally:
            os.close(log)

    def replace(self, path: Path, content: bytes) -> None:
        """Replace a file durably and atomically."""
        new = path.with_name(f"{path.name}.new")
        with new.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)

    def free_octets(self, folder: Path) -> int:
        """Return the free space for this process on the disk of a folder."""
        disk = os.statvfs(folder)
        return disk.f_bavail * disk.f_frsize

    def memory_octets(self) -> int | None:
        """Return the resident memory of this process; None without /proc."""
        try:
            pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
            return int(pages) * os.sysconf("SC_PAGE_SIZE")
        except (OSError, ValueError, IndexError):
            return None

    def listen(self, address: SocketAddress, family: socket.AddressFamily) -> Socket:
        """Return a listening TCP socket that does not block."""
        listener = socket.create_server(address, family=family, backlog=_BACKLOG)
        listener.setblocking(False)
        return listener

    def datagrams(
        self, address: BindAddress, family: socket.AddressFamily, buffer_octets: int
    ) -> Socket:
        """Return a bound UDP socket that does not block."""
        bound = socket.socket(family, socket.SOCK_DGRAM)
        try:
            for buffer in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                bound.setsockopt(socket.SOL_SOCKET, buffer, buffer_octets)
            bound.setblocking(False)
            bound.bind(address)
        except OSError:
            bound.close()
            raise
        return bound


OPERATING_SYSTEM: Final = OperatingSystem()
SYNCED_APART: Final = (
    "PRAGMA synchronous = NORMAL",
    "PRAGMA wal_autocheckpoint = 0",
    "PRAGMA journal_size_limit = 0",
)
"""Settings of a connection in WAL mode for `sync_database`. Its commits survive `kill -9`, and wait
for the disk only when SQLite restarts the log, once in `_MAX_LOG_OCTETS`."""
_MAX_LOG_OCTETS: Final = 4 << 20
"""Size of a write-ahead log above which `sync_database` moves it into the file."""


def rewrite_log(database: Path) -> None:
    """Write a log again after a failed sync, on the thread that writes the database.

    Linux counts the pages of a failed sync as written: the next one would succeed without them.
    """
    with suppress(OSError), wal_of(database).open("r+b") as log:
        octets = log.read()
        log.seek(0)
        log.write(octets)


def sync_database(system: System, database: Path) -> None:
    """Return once the commits to a file survive loss of power; for any thread.

    Raises:
        OSError, sqlite3.Error: they may not survive it; a later call includes them.
    """
    system.sync(database)
    log = wal_of(database)
    if log.exists() and log.stat().st_size > _MAX_LOG_OCTETS:
        with closing(system.connect(database)) as other:
            other.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()
