"""The bridge to NASA ION: how it ends, hangs and is watched; a real process."""

import asyncio
import os
import signal
from pathlib import Path

import pytest

from adapters.bundle.daemons.ion_bridge import Spool
from adapters.bundle.daemons.ion_frames import Received
from tests.bundle.bridges import QUICK, attached, bridge_of, gone, stat_of
from tests.bundle.ion_node import DTN_NOW_MS, bpadmin, ion_nodes
from tests.bundle.worlds import TWO


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_bridge_that_is_asked_to_end_closes_its_endpoint_and_another_follows(
    tmp_path: Path, number: signal.Signals
) -> None:
    async def run() -> None:
        async with (
            ion_nodes(tmp_path, 1, 2) as nodes,
            attached(tmp_path, 1) as one,
            attached(tmp_path, 2) as two,
        ):
            first = bridge_of(nodes, "ipn:2.1")
            os.kill(first, number)
            await gone(first)
            assert nodes.closed == ["ipn:2.1"]
            await one.agent.send(TWO, b"meanwhile")
            assert await two.take(1) == [b"meanwhile"]
            assert bridge_of(nodes, "ipn:2.1") != first

    asyncio.run(run())


def test_what_ion_has_forgotten_and_the_agent_has_not_comes_from_the_spool(
    tmp_path: Path,
) -> None:
    async def run() -> None:
        left = Received("ipn:2.1", DTN_NOW_MS, 7, b"left")
        spool = Spool(tmp_path / "1.received")
        spool.save(left)
        assert spool.load() == left
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            async with attached(tmp_path, 1) as one:
                delivery = await one.take_one()
                assert (delivery.payload, delivery.source) == (b"left", TWO)
                await one.until(lambda: spool.load() is None)
            spool.save(left)
            async with attached(tmp_path, 1) as one:
                nodes.bring("ipn:2.1", "ipn:1.1", b"next")
                await nodes.change(1)
                assert await one.take(1) == [b"next"]

    asyncio.run(run())


def test_half_a_spool_is_no_unit(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    Spool(path).save(Received("ipn:2.1", 1, 2, b"payload"))
    path.write_bytes(path.read_bytes()[:-3])
    assert Spool(path).load() is None
    Spool(path).clear()
    assert Spool(path).load() is None


def test_a_locked_database_is_noticed_and_nobody_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpadmin(tmp_path, 1)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")

    async def run() -> None:
        async with (
            ion_nodes(tmp_path, 1, 2) as nodes,
            attached(tmp_path, 2) as two,
            attached(tmp_path, 1, QUICK) as one,
        ):
            bridge = bridge_of(nodes, "ipn:1.1")
            await nodes.change(1, locked=True)
            await one.until(lambda: not one.agent.health().neighbours[0].contact)
            await one.agent.send(TWO, b"x")
            await nodes.change(1, locked=False)
            assert await two.take(1) == [b"x"]
            await one.until(lambda: one.agent.health().neighbours[0].contact)
            assert bridge_of(nodes, "ipn:1.1") == bridge

    asyncio.run(run())


def test_a_bridge_that_hangs_is_noticed_asked_to_end_and_never_killed(
    tmp_path: Path,
) -> None:
    """A process that is stopped stands for one that waits within ION, holding Python's lock."""

    async def run() -> None:
        async with (
            ion_nodes(tmp_path, 1, 2) as nodes,
            attached(tmp_path, 1, QUICK) as one,
            attached(tmp_path, 2) as two,
        ):
            await one.until(lambda: one.agent.health().neighbours[0].contact)
            bridge = bridge_of(nodes, "ipn:1.1")
            os.kill(bridge, signal.SIGSTOP)
            try:
                await one.until(lambda: not one.agent.health().neighbours[0].contact)
                await one.agent.send(TWO, b"x")
                assert ") T " in stat_of(bridge)
            finally:
                os.kill(bridge, signal.SIGCONT)
            await gone(bridge)
            assert nodes.closed == ["ipn:1.1"]
            assert await two.take(1) == [b"x"]
            await one.until(lambda: one.agent.health().neighbours[0].contact)

    asyncio.run(run())


def test_who_closes_while_ion_hangs_leaves_the_bridge_to_end_by_itself(tmp_path: Path) -> None:
    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            async with attached(tmp_path, 1, QUICK):
                bridge = bridge_of(nodes, "ipn:1.1")
                await nodes.change(1, locked=True)
            assert ") S " in stat_of(bridge)
            await nodes.change(1, locked=False)
            await gone(bridge)
            assert nodes.closed == ["ipn:1.1"]

    asyncio.run(run())
