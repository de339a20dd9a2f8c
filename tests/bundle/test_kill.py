"""kill -9 of real processes on real sockets: what `send` returned for arrives, and once."""

import asyncio
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractAsyncContextManager, contextmanager
from pathlib import Path
from typing import TypeVar

from tests.bundle.ion_node import ion_nodes
from tests.bundle.victim import lines
from tests.support.ports import free_udp_ports

T = TypeVar("T")

CHECKOUT = Path(__file__).resolve().parents[2]
KILLS = {"ltp": 12, "ion": 4}
LIMIT_S = 60.0


class Victim:
    def __init__(self, role: str, folder: Path, carrier: str) -> None:
        self.command = [sys.executable, "-m", "tests.bundle.victim", role, str(folder), carrier]
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(self.command, cwd=CHECKOUT)

    def kill(self) -> None:
        assert self.process.poll() is None, "it ended by itself"
        self.process.kill()
        self.process.wait()


@contextmanager
def meanwhile(have: Callable[[], AbstractAsyncContextManager[T]]) -> Iterator[T]:
    """Have something on a loop of its own for the time of a with."""
    there: list[T] = []
    ready, over = threading.Event(), threading.Event()

    async def serve() -> None:
        async with have() as had:
            there.append(had)
            ready.set()
            await asyncio.to_thread(over.wait)

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert ready.wait(LIMIT_S)
    try:
        yield there[0]
    finally:
        over.set()
        thread.join()


def wait_for_growth(path: Path, before: int) -> None:
    """Wait until a record has grown: the process runs and works."""
    deadline_s = time.monotonic() + LIMIT_S
    while not path.exists() or path.stat().st_size <= before:
        assert time.monotonic() < deadline_s, f"{path.name} does not go on"
        time.sleep(0.01)


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def test_no_kill_loses_or_doubles_anything(tmp_path: Path) -> None:
    one, two = free_udp_ports(2)
    storm(tmp_path, f"{one}:{two}", f"{two}:{one}", KILLS["ltp"])


def test_nor_does_it_where_ion_carries_and_no_endpoint_stays_open(tmp_path: Path) -> None:
    """The agents are killed, their bridges end by themselves."""
    with meanwhile(lambda: ion_nodes(tmp_path, 1, 2)) as nodes:
        storm(tmp_path, "ion", "ion", KILLS["ion"])
        deadline_s = time.monotonic() + LIMIT_S
        while nodes.handles:
            assert time.monotonic() < deadline_s, "an endpoint stays open"
            time.sleep(0.02)
        assert len(nodes.closed) == KILLS["ion"] + 3


def storm(folder: Path, by: str, back: str, kills: int) -> None:
    """Kill a sender and a receiver at random, and look at what each has written down."""
    chance = random.Random(1)
    sent, received = folder / "send", folder / "receive"
    victims = [Victim("send", folder, by), Victim("receive", folder, back)]
    try:
        for _ in range(kills):
            for path in (sent, received):
                wait_for_growth(path, size_of(path))
            time.sleep(chance.uniform(0.0, 0.1))
            victim = chance.choice(victims)
            victim.kill()
            victim.start()
        wait_for_growth(sent, size_of(sent))
        victims[0].kill()
        numbers = {line.strip() for line in lines(sent)}
        last_s = time.monotonic() + LIMIT_S
        # The sender's store still holds what was not handed on: it goes on from there.
        victims[0].start()
        while not numbers <= {line.split()[-1] for line in lines(received)}:
            assert time.monotonic() < last_s, "something does not arrive"
            time.sleep(0.05)
    finally:
        for victim in victims:
            victim.process.kill()
            victim.process.wait()
    had = [line.rsplit(" ", 1)[0] for line in lines(received)]
    assert len(had) == len(set(had))
    assert len(numbers) > kills
