"""The world itself: time, kills, what the dead reach, clocks, loops, disks and topics."""

import asyncio
import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.simulated.disk import Fate, Nth, rows
from tests.simulated.process import Process
from tests.simulated.system import SimSystem
from tests.simulated.world import World

Main = Callable[[Process], Coroutine[Any, Any, object]]


@pytest.fixture
def world() -> Iterator[World]:
    with World(1) as world:
        yield world


def running(world: World, main: Main, name: str = "one", host: str = "10.0.0.1") -> Process:
    process = world.process(name, host, lambda process: process.run(main(process)))
    process.begin()
    return process


def ledger(process: Process, synchronous: str = "FULL") -> sqlite3.Connection:
    database = SimSystem(process).connect(process.folder / "ledger.db")
    database.execute("PRAGMA journal_mode = WAL")
    database.execute(f"PRAGMA synchronous = {synchronous}")
    database.execute("CREATE TABLE IF NOT EXISTS entries (number INTEGER PRIMARY KEY)")
    return database


def numbers(process: Process) -> list[int]:
    path = process.stored / "ledger.db"
    if not rows(path, "SELECT 1 FROM sqlite_schema"):  # lost with the first commits
        return []
    return [number for (number,) in rows(path, "SELECT * FROM entries")]


async def write_for_ever(process: Process, synchronous: str = "FULL") -> None:
    database = ledger(process, synchronous)
    while True:
        database.execute("BEGIN")
        database.execute("INSERT INTO entries DEFAULT VALUES")
        database.execute("COMMIT")
        await asyncio.sleep(1.0)


def test_time_passes_by_command_of_the_loop(world: World) -> None:
    seen: list[float] = []

    async def main(_: Process) -> None:
        async with asyncio.timeout(5.0):
            await asyncio.sleep(2.0)
        seen.append(asyncio.get_running_loop().time())
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1.0):
                await asyncio.Event().wait()
        seen.append(asyncio.get_running_loop().time())
        seen.append(await asyncio.to_thread(lambda: 7.0))

    process = running(world, main)
    world.run(10.0)
    assert seen == [2.0, 3.0, 7.0]
    assert (process.status, world.errors, world.now_s) == (0, [], 10.0)


def test_a_dead_process_reaches_nothing(world: World) -> None:
    received: list[str] = []

    async def main(process: Process) -> None:
        database = ledger(process)
        system = SimSystem(process)
        publisher = world.topics.publisher(process, "topic")
        bound = world.network.datagrams(process.present, ("0.0.0.0", 7), 1 << 16)
        try:
            await asyncio.sleep(5.0)
            process.kill()
        except Exception:
            received.append("caught")
        finally:
            received.append("finally")
            publisher.publish("from the dead")
            bound.sendto(b"from the dead", ("10.0.0.2", 7))
            with pytest.raises(SystemExit):
                system.replace(process.folder / "file", b"from the dead")
            with pytest.raises(SystemExit):
                system.listen(("0.0.0.0", 8), bound.family)
            database.execute("BEGIN")
            database.execute("INSERT INTO entries DEFAULT VALUES")
            database.execute("COMMIT")

    async def listen(process: Process) -> None:
        world.topics.subscribe(process, "topic", received.append)
        bound = world.network.datagrams(process.present, ("0.0.0.0", 7), 1 << 16)
        process.loop.add_reader(bound, lambda: received.append("datagram"))
        await asyncio.Event().wait()

    process = running(world, main)
    running(world, listen, "two", "10.0.0.2")
    world.run(10.0)
    assert received == ["finally"]
    assert process.status == 137
    assert numbers(process) == []
    assert not (process.stored / "file").exists()
    assert world.errors == []


def test_a_kill_at_a_commit_is_exact(world: World) -> None:
    process = running(world, write_for_ever)
    process.on_end = lambda *_: world.stop()
    process.disk.plan = plan = Nth()
    stored = []
    for fate in (Fate.KILLED_BEFORE, Fate.KILLED_AFTER, Fate.KILLED_BEFORE):
        plan.after(3, fate)
        world.run(100.0)
        stored.append(len(numbers(process)))
        process.begin()
    assert stored == [2, 5, 7]


def test_the_dead_are_freed_without_a_word() -> None:
    ends: list[str] = []

    async def main(_: Process) -> None:
        try:
            await asyncio.sleep(100.0)
        finally:
            await asyncio.sleep(1.0)
            ends.append("waited")
            raise OSError("a file that is closed")

    with World(1) as world:
        process = running(world, main)
        world.at(1.0, process.kill)
        world.run(200.0)
        assert ends == []
    assert world.errors == []


def test_a_kill_between_events_precedes_the_next(world: World) -> None:
    done: list[str] = []

    async def main(_: Process) -> None:
        loop = asyncio.get_running_loop()
        for name in ("first", "second", "third"):
            loop.call_soon(done.append, name)
        await asyncio.Event().wait()

    def before(process: Process, name: str) -> None:
        if name == "list.append" and len(done) == 1:
            process.kill()

    world.before_event = before
    process = running(world, main)
    world.run(1.0)
    assert (done, process.status) == (["first"], 137)


def test_commits_fail_and_disks_fill(world: World) -> None:
    errors: list[int] = []
    free: list[int] = []

    async def main(process: Process) -> None:
        database = ledger(process)
        system = SimSystem(process)
        while True:
            try:
                database.execute("BEGIN")
                database.execute("INSERT INTO entries DEFAULT VALUES")
                database.execute("COMMIT")
            except sqlite3.OperationalError as error:
                errors.append(error.sqlite_errorcode)
                if database.in_transaction:
                    database.execute("ROLLBACK")
            free.append(system.free_octets(process.folder))
            await asyncio.sleep(1.0)

    process = running(world, main)
    process.disk.plan = Nth(2, Fate.FAILED)
    world.at(3.5, setattr, process.disk, "full", True)
    world.at(5.5, setattr, process.disk, "full", False)
    world.run(7.5)
    assert errors == [sqlite3.SQLITE_IOERR, sqlite3.SQLITE_FULL, sqlite3.SQLITE_FULL]
    assert numbers(process) == [1, 2, 3, 4, 5]
    assert (free[3], free[4], free[6] > 0) == (process.disk.unfilled_octets, 0, True)


@pytest.mark.parametrize("synchronous", ["FULL", "NORMAL"])
def test_a_power_cut_discards_unsynced_data(synchronous: str) -> None:
    stored = set()
    for seed in range(12):
        with World(seed) as world:
            process = running(world, lambda process: write_for_ever(process, synchronous))
            world.run(9.5)
            process.cut_power()
            there = numbers(process)
            assert there == list(range(1, len(there) + 1))
            stored.add(len(there))
            process.begin()
            world.run(10.0)
            assert len(numbers(process)) == len(there) + 1
    if synchronous == "FULL":
        assert stored == {10}
    else:
        assert len(stored) > 3


def test_a_stopped_process_continues_in_order(world: World) -> None:
    message: list[tuple[float, int]] = []

    def send(number: int) -> None:
        message.append((world.now_s, number))

    async def main(_: Process) -> None:
        for number in range(1, 5):
            asyncio.get_running_loop().call_later(number, send, number)
        await asyncio.Event().wait()

    process = running(world, main)
    world.at(1.5, process.pause)
    world.at(3.5, process.resume)
    world.run(5.0)
    assert message == [(1.0, 1), (3.5, 2), (3.5, 3), (4.0, 4)]


def test_clocks_step_and_drift(world: World) -> None:
    process = running(world, write_for_ever)
    world.run(100.0)
    process.step_clock(-3.0)
    process.set_drift(0.01)
    world.run(200.0)
    process.set_drift(0.0)
    world.run(300.0)
    assert process.utc_s() - world.start_utc_s == pytest.approx(298.0)


def test_an_error_at_the_start_is_the_end_of_the_process(world: World) -> None:
    def start(_: Process) -> None:
        raise OSError("no disk")

    ends: list[int] = []
    process = world.process("one", "10.0.0.1", start)
    process.on_end = lambda _, status: ends.append(status)
    process.begin()
    world.run(1.0)
    process.restart()
    world.run(2.0)
    assert ends == [1, 1]


def test_an_uncaught_error_is_recorded(world: World) -> None:
    async def main(_: Process) -> None:
        asyncio.get_running_loop().call_soon(lambda: 1 // 0)
        await asyncio.sleep(1.0)

    running(world, main)
    world.run(2.0)
    assert [(error.process, type(error.fault)) for error in world.errors] == [
        ("one", ZeroDivisionError)
    ]


def test_publishers_discover_subscribers_after_a_while(world: World) -> None:
    counts: list[int] = []
    received: list[int] = []

    async def publish(process: Process) -> None:
        publisher = world.topics.publisher(process, "topic")
        for number in range(10):
            counts.append(publisher.subscriber_count)
            publisher.publish(number)
            await asyncio.sleep(0.5)

    async def listen(process: Process) -> None:
        world.topics.subscribe(process, "topic", received.append)
        await asyncio.Event().wait()

    running(world, publish)
    running(world, listen, "two", "10.0.0.2")
    world.at(3.6, world.processes["two"].kill)
    world.run(10.0)
    assert counts[:3] == [0, 0, 0]
    assert counts[4:] == [1, 1, 1, 1, 0, 0]
    assert received == list(range(counts.index(1), 8))


def storm(seed: int) -> str:
    """Play a short storm; return its digest."""
    with World(seed) as world:
        chance = world.random("storm")

        async def main(process: Process) -> None:
            bound = world.network.datagrams(process.present, ("0.0.0.0", 7), 1 << 16)
            asyncio.get_running_loop().add_reader(bound, lambda: bound.recvfrom(100))
            database = ledger(process)
            names = {f"name {number}" for number in range(20)}
            while True:
                for number in (1, 2, 3):
                    bound.sendto(str(sorted(names)).encode(), (f"10.0.0.{number}", 7))
                database.execute("BEGIN")
                database.execute("INSERT INTO entries DEFAULT VALUES")
                database.execute("COMMIT")
                await asyncio.sleep(SimSystem(process).random_octets(1)[0] / 256)

        def supervise(process: Process, _: int) -> None:
            world.after(chance.random(), process.begin)

        for number in (1, 2, 3):
            process = running(world, main, f"p{number}", f"10.0.0.{number}")
            process.on_end = supervise
            for _ in range(5):
                world.at(chance.uniform(0.0, 20.0), process.kill)
        world.run(25.0)
        assert world.errors == []
        assert sum(process.present.number for process in world.processes.values()) > 10
        return world.digest


def test_the_same_seed_is_the_same_world() -> None:
    assert storm(3) == storm(3) != storm(4)


def test_the_order_of_hashes_changes_nothing() -> None:
    code = "from tests.simulated.test_world import storm; print(storm(3))"
    root = Path(__file__).parents[2]
    for hash_seed in ("1", "2"):
        environment = os.environ | {"PYTHONHASHSEED": hash_seed, "PYTHONPATH": str(root)}
        message = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert message.stdout.strip() == storm(3)
