"""The computer of a simulated process, as the product is handed it."""

import socket
import sqlite3
from pathlib import Path
from typing import cast

from adapters.system import BindAddress, Socket, SocketAddress
from tests.simulated.process import Incarnation, Process


class SimSystem:
    """The port `adapters.system.System`, of one life of a process.

    Args:
        process: which is running.
    """

    def __init__(self, process: Process) -> None:
        self._process = process
        self._incarnation: Incarnation = process.present
        self._world = process.world
        self._random = process.world.random(f"octets/{process.name}")

    def now_s(self) -> float:
        """Return the time of its loops."""
        return self._world.now_s

    def utc_s(self) -> float:
        """Return what its clock says."""
        return self._process.utc_s()

    def random_octets(self, count: int) -> bytes:
        """Return octets of the process's own stream."""
        return self._random.randbytes(count)

    def connect(self, database: Path | str, *, any_thread: bool = False) -> sqlite3.Connection:
        """Open an SQLite file, whose commits go by the plan of the disk."""
        return self._process.disk.connect(self._incarnation, database)

    def sync(self, database: Path) -> None:
        """Make the commits to an SQLite file survive a loss of power."""
        self._process.disk.sync(self._incarnation, database)

    def replace(self, path: Path, content: bytes) -> None:
        """Write a file anew."""
        self._process.disk.replace(self._incarnation, path, content)

    def free_octets(self, folder: Path) -> int:
        """Return what is free."""
        return self._process.disk.free_octets()

    def cpu_s(self) -> float:
        """Return nothing: what a simulated process does takes no time."""
        return 0.0

    def memory_octets(self) -> int | None:
        """Return that it is not known."""
        return None

    def listen(self, address: SocketAddress, family: socket.AddressFamily) -> Socket:
        """Return a listening socket for the loop's `sock_accept`; not a real one."""
        listener = self._world.network.listen(self._incarnation, address)
        return cast("Socket", listener)

    def datagrams(
        self, address: BindAddress, family: socket.AddressFamily, buffer_octets: int
    ) -> Socket:
        """Return a bound socket for the loop's `add_reader`; not a real one."""
        where = str(address[0]), int(address[1])
        bound = self._world.network.datagrams(self._incarnation, where, buffer_octets)
        return cast("Socket", bound)
