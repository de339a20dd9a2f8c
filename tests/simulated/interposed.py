"""Puts the simulated computer under product code that is not handed a `System` yet.

To be removed with the last such part.
"""

import socket
import sqlite3
import time
from types import SimpleNamespace
from typing import Any

import pytest

import adapters.bundle.links.udp
import adapters.bundle.node.database
import adapters.mal.admission
import adapters.mal.connection
import adapters.mal.transactions
from tests.simulated.datagrams import DatagramSocket
from tests.simulated.process import Process
from tests.simulated.system import SimSystem
from tests.simulated.world import World

_A_LOOK_S = 20e-6
"""What a piece of work takes by the clock that shares the loop's time among connections."""


class _Module(SimpleNamespace):
    """A module of which some parts are others."""

    def __init__(self, module: Any, **parts: Any) -> None:
        super().__init__(**parts)
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


class _Unbound:
    """A UDP socket before `bind`."""

    def __init__(self, process: Process) -> None:
        self._process, self._octets = process, 1 << 16
        self._bound: DatagramSocket | None = None

    def setsockopt(self, _level: int, _option: int, octets: int) -> None:
        self._octets = octets

    def setblocking(self, _: bool) -> None:
        """Never block."""

    def bind(self, address: tuple[str, int]) -> None:
        network = self._process.world.network
        self._bound = network.datagrams(self._process.present, address, self._octets)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bound, name)


def interpose(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the sockets, files and clocks of the process whose event is under way be simulated."""
    looks = 0

    def process() -> Process:
        assert world.running is not None
        return world.running.process

    def create_server(address: tuple[str, int], **_: Any) -> Any:
        return SimSystem(process()).listen(address, socket.AF_INET)

    def connect(path: Any, **_: Any) -> sqlite3.Connection:
        return SimSystem(process()).connect(path)

    def perf_counter() -> float:
        nonlocal looks
        looks += 1
        return world.now_s + looks * _A_LOOK_S

    def time_ns() -> int:
        return int(1e9 * process().utc_s())

    def randbits(count: int) -> int:
        return int.from_bytes(SimSystem(process()).random_octets(8), "big") >> (64 - count)

    def datagrams(_family: int, _kind: int) -> _Unbound:
        return _Unbound(process())

    parts: dict[Any, dict[str, Any]] = {
        adapters.mal.admission: {"socket": _Module(socket, create_server=create_server)},
        adapters.mal.connection: {"perf_counter": perf_counter},
        adapters.mal.transactions: {
            "secrets": SimpleNamespace(randbits=randbits),
            "time": _Module(time, time_ns=time_ns),
        },
        adapters.bundle.links.udp: {"socket": _Module(socket, socket=datagrams)},
        adapters.bundle.node.database: {"sqlite3": _Module(sqlite3, connect=connect)},
    }
    for module, replaced in parts.items():
        for name, part in replaced.items():
            if hasattr(module, name):
                monkeypatch.setattr(module, name, part)
