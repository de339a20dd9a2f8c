"""Attached to NASA ION: the bridge is a real process, with a model of pyion in it."""

import asyncio
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from adapters.bundle.agents import make_agent
from adapters.bundle.attached.settings import IonSettings
from adapters.bundle.eid import Dtn, Ipn
from adapters.bundle.errors import BundleError
from adapters.bundle.ion.frames import Received
from adapters.bundle.ion.spool import Spool
from adapters.bundle.port import Fate
from adapters.bundle.settings import DaemonLink, Neighbour, NodeSettings
from tests.bundle.agents import LIMIT_S, Running, payloads_of, send_all
from tests.bundle.ion_node import DTN_NOW_MS, IonNodes, bpadmin, ion_nodes
from tests.bundle.worlds import ONE, TWO, node_of

QUICK = IonSettings(answer_s=0.5, look_s=0.1)
PATIENT = IonSettings(answer_s=20.0)


@asynccontextmanager
async def attached(
    folder: Path, number: int, settings: IonSettings = PATIENT
) -> AsyncIterator[Running]:
    """Have an agent attached to a node of ION for the time of a with."""
    node = node_of(number, DaemonLink(Ipn(3 - number, 1), settings.whole))
    running = Running(make_agent(node, folder / f"{number}.db", settings))
    await running.agent.open(running.notices.append)
    try:
        yield running
    finally:
        await running.agent.close()


def bridge_of(nodes: IonNodes, eid: str) -> int:
    """Return the process that has an endpoint open."""
    return max(handle.pid for handle in nodes.handles.values() if handle.eid == eid)


async def gone(pid: int) -> None:
    async with asyncio.timeout(LIMIT_S):
        while Path(f"/proc/{pid}/stat").exists() and ") Z " not in _stat(pid):
            await asyncio.sleep(0.02)


def _stat(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ") Z "


def test_ion_hears_the_lifetime_and_has_its_endpoint_closed(tmp_path: Path) -> None:
    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
                await one.agent.send(TWO, b"x", lifetime_s=3600.0)
                delivery = await two.take_one()
                assert delivery.source == ONE
                assert delivery.identity.creation.time_ms == DTN_NOW_MS
                assert 3590 < nodes.lifetimes_s[0] <= 3600
            assert sorted(nodes.closed) == ["ipn:1.1", "ipn:2.1"]
            assert nodes.handles == {}

    asyncio.run(run())


def test_what_ion_refuses_waits_and_is_offered_again(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            ion_nodes(tmp_path, 1, 2) as nodes,
            attached(tmp_path, 1) as one,
            attached(tmp_path, 2) as two,
        ):
            await nodes.change(1, refused=1)
            await send_all(one, TWO, [b"refused", b"taken"])
            assert await two.take(1) == [b"taken"]
            assert await two.take(1) == [b"refused"]
            await one.until(lambda: one.agent.health().queued == 0)
            assert {notice.fate for notice in one.notices} == {Fate.HANDED_ON}

    asyncio.run(run())


def test_an_ion_without_room_holds_up_what_is_sent_and_nothing_else(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            ion_nodes(tmp_path, 1, 2) as nodes,
            attached(tmp_path, 1) as one,
            attached(tmp_path, 2) as two,
        ):
            await nodes.change(1, full=True)
            payloads = payloads_of(40)
            await send_all(one, TWO, payloads)
            await two.agent.send(ONE, b"the other way")
            assert await one.take(1) == [b"the other way"]
            assert one.agent.health().queued == 40
            await nodes.change(1, full=False)
            assert sorted(await two.take(40)) == payloads

    asyncio.run(run())


def test_one_of_several_nodes_on_a_machine_is_found_by_its_folder(tmp_path: Path) -> None:
    async def run() -> None:
        folder = tmp_path / "nodes"
        for number in ("1", "2"):
            (folder / number).mkdir(parents=True)
        settings = IonSettings(node_list=str(folder))
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            async with (
                attached(tmp_path, 1, settings) as one,
                attached(tmp_path, 2, settings) as two,
            ):
                await one.agent.send(TWO, b"x")
                assert await two.take(1) == [b"x"]
            assert nodes.folders == {str(folder / "1"), str(folder / "2")}

    asyncio.run(run())


def test_an_agent_that_is_killed_takes_its_bridge_along_and_leaves_nothing_open(
    tmp_path: Path,
) -> None:
    """Here the socket ends without a word, as it does when the kernel closes it."""

    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes, attached(tmp_path, 1) as one:
            bridge = bridge_of(nodes, "ipn:1.1")
            daemon = one.agent._daemon
            daemon._writer.close()  # type: ignore[union-attr]
            await gone(bridge)
            assert nodes.closed == ["ipn:1.1"]

    asyncio.run(run())


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


def test_an_endpoint_that_another_process_has_open_is_waited_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """pyion opens it all the same; it is the first receive that fails (measured, R10)."""

    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            other = nodes._open("ipn:1.1", os.getppid())["handle"]
            async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
                await one.until(lambda: "has the endpoint open" in caplog.text)
                del nodes.handles[other]
                await two.agent.send(ONE, b"x")
                assert await one.take(1) == [b"x"]

    asyncio.run(run())


def test_an_ion_that_is_started_later_is_found(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            await nodes.change(1, stopped=True)
            async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
                assert "Is ION running on this host?" in caplog.text
                await one.agent.send(TWO, b"x")
                assert not one.agent.health().neighbours[0].contact
                await nodes.change(1, stopped=False)
                assert await two.take(1) == [b"x"]
                assert one.agent.health().neighbours[0].contact

    asyncio.run(run())


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
            bridge = bridge_of(nodes, "ipn:1.1")
            os.kill(bridge, signal.SIGSTOP)
            try:
                await one.until(lambda: not one.agent.health().neighbours[0].contact)
                await one.agent.send(TWO, b"x")
                assert ") T " in _stat(bridge)
            finally:
                os.kill(bridge, signal.SIGCONT)
            await gone(bridge)
            assert nodes.closed == ["ipn:1.1"]
            assert await two.take(1) == [b"x"]
            assert one.agent.health().neighbours[0].contact

    asyncio.run(run())


def test_who_closes_while_ion_hangs_leaves_the_bridge_to_end_by_itself(tmp_path: Path) -> None:
    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            async with attached(tmp_path, 1, QUICK):
                bridge = bridge_of(nodes, "ipn:1.1")
                await nodes.change(1, locked=True)
            assert ") S " in _stat(bridge)
            await nodes.change(1, locked=False)
            await gone(bridge)
            assert nodes.closed == ["ipn:1.1"]

    asyncio.run(run())


def test_who_has_no_pyion_hears_what_to_do(tmp_path: Path) -> None:
    async def run() -> None:
        with pytest.raises(BundleError, match=r"cannot import pyion: .*Build the pyion of your"):
            async with attached(tmp_path, 1):
                pass

    asyncio.run(run())


def test_who_names_no_interpreter_hears_so(tmp_path: Path) -> None:
    async def run() -> None:
        async with attached(tmp_path, 1, IonSettings(python=str(tmp_path / "none"))) as one:
            assert not one.agent.health().neighbours[0].contact

    asyncio.run(run())


def test_ion_has_numbers_for_nodes(tmp_path: Path) -> None:
    async def run() -> None:
        own, other = Dtn("//rover/relay"), Dtn("//orbiter/relay")
        neighbour = Neighbour(Dtn("//orbiter/"), DaemonLink(other))
        settings = NodeSettings(own, (own,), (neighbour,))
        agent = make_agent(settings, tmp_path / "1.db", PATIENT)
        with pytest.raises(BundleError, match=r"ipn endpoints, not dtn://rover"):
            await agent.open(lambda _: None)

    asyncio.run(run())


def test_a_daemon_has_one_endpoint(tmp_path: Path) -> None:
    settings = NodeSettings(ONE, (ONE, Ipn(1, 2)), (Neighbour(Ipn(2, 0), DaemonLink(TWO)),))
    with pytest.raises(BundleError, match="no other endpoint"):
        make_agent(settings, tmp_path / "1.db", PATIENT)
