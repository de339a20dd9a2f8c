"""Attached to a uD3TN daemon that answers late, wrongly or not at all."""

import asyncio
import random
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from adapters.bundle.aap2.client import Aap2Daemon
from adapters.bundle.agent_settings import make_agent
from adapters.bundle.codec.eid import Dtn, Ipn
from adapters.bundle.codec.eid import node_of as node_of_eid
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.daemons.link import Inbound, OnResult
from adapters.bundle.links.contact import ContactOverride
from adapters.bundle.node.port import DeliveryStatus
from adapters.bundle.node.settings import (
    Aap2Settings,
    Address,
    DaemonLink,
    Neighbour,
    NodeSettings,
)
from tests.bundle.aap2_daemon import Aap2Server, Network, daemons
from tests.bundle.agents import LIMIT_S, Running, payloads_of, send_all
from tests.bundle.worlds import ONE, TWO, node_of


@asynccontextmanager
async def attached(
    folder: Path,
    number: int,
    *,
    tcp: Address | None = None,
    whole: bool = False,
    keepalive_s: int = 15,
) -> AsyncIterator[Running]:
    """Have an agent attached to the daemon of its node for the time of a with."""
    path = None if tcp else str(folder / f"{number}.socket")
    settings = Aap2Settings(path, tcp, whole=whole, keepalive_s=keepalive_s, answer_s=2.0)
    node = node_of(number, DaemonLink(Ipn(3 - number, 1), whole))
    running = Running(make_agent(node, folder / f"{number}.db", settings))
    await running.agent.open(running.notices.append)
    try:
        yield running
    finally:
        await running.agent.close()


@pytest.mark.parametrize("whole", [False, True])
def test_what_was_not_answered_is_sent_again_and_carried_whole_comes_once(
    whole: bool, tmp_path: Path
) -> None:
    async def run() -> None:
        async with (
            daemons(tmp_path, 1, 2) as servers,
            attached(tmp_path, 1, whole=whole) as one,
            attached(tmp_path, 2, whole=whole) as two,
        ):
            servers[1].faults.lost_before_response = 1
            payloads = payloads_of(10)
            await send_all(one, TWO, payloads)
            await one.until(lambda: one.agent.health().queued == 0)
            assert servers[1].sent == 11
            assert {notice.fate for notice in one.notices} == {DeliveryStatus.HANDED_ON}
            taken = await two.take(10 if whole else 11)
            assert sorted(set(taken)) == payloads
            await two.until(lambda: two.agent.health().unread == 0)
            await one.agent.send(TWO, b"last")
            assert await two.take(1) == [b"last"]

    asyncio.run(run())


def test_what_the_daemon_refuses_waits_and_does_not_hold_up_the_rest(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            daemons(tmp_path, 1, 2) as servers,
            attached(tmp_path, 1) as one,
            attached(tmp_path, 2) as two,
        ):
            servers[1].faults.refused = 1
            await send_all(one, TWO, [b"refused", b"taken"])
            assert await two.take(1) == [b"taken"]
            assert await two.take(1) == [b"refused"]
            await one.until(lambda: one.agent.health().queued == 0)

    asyncio.run(run())


def test_a_daemon_that_restarts_is_found_again_with_what_it_kept(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            daemons(tmp_path, 1, 2) as servers,
            attached(tmp_path, 1) as one,
            attached(tmp_path, 2) as two,
        ):
            await servers[2].stop()
            await two.until(lambda: not two.agent.health().neighbours[0].contact)
            await one.agent.send(TWO, b"kept by the daemon")
            await two.agent.send(ONE, b"kept by the agent")
            await servers[2].listen(tmp_path / "2.socket")
            assert await two.take(1) == [b"kept by the daemon"]
            assert await one.take(1) == [b"kept by the agent"]
            assert two.agent.health().neighbours[0].contact

    asyncio.run(run())


def test_a_daemon_that_is_silent_is_left_and_dialled_again(tmp_path: Path) -> None:
    async def run() -> None:
        async with daemons(tmp_path, 1, 2) as servers:
            servers[1].faults.silent = True
            async with attached(tmp_path, 1, keepalive_s=1) as one:
                await one.until(lambda: servers[1].keepalives > 1)
                servers[1].deliver_from("ipn:2.1", "ipn:1.1", b"after all")
                servers[1].faults.silent = False
                assert await one.take(1) == [b"after all"]

    asyncio.run(run())


def test_what_arrives_is_acknowledged_once_it_is_on_the_disk(tmp_path: Path) -> None:
    """The daemon hears nothing before the commit, and nothing at all if there is none."""

    async def run() -> None:
        async with daemons(tmp_path, 1) as servers:
            server, told = servers[1], list[OnResult]()
            arrived = asyncio.Event()

            def hear(_: Inbound, tell: OnResult) -> None:
                told.append(tell)
                arrived.set()

            settings = Aap2Settings(str(tmp_path / "1.socket"), keepalive_s=1)
            daemon = Aap2Daemon(settings, ONE, 1000, redial_s=0.01)
            await daemon.open(hear, lambda: None)
            server.deliver_from("ipn:2.1", "ipn:1.1", b"x")
            async with asyncio.timeout(LIMIT_S):
                await arrived.wait()
                assert server.acknowledged == []
                arrived.clear()
                told[0]("no room")
                await arrived.wait()
                assert server.acknowledged == []
                told[1](None)
                while not server.acknowledged:
                    await asyncio.sleep(0.01)
            assert server.acknowledged == [1]
            await daemon.close()

    asyncio.run(run())


def test_a_daemon_that_makes_no_sense_or_says_nothing_is_dialled_again(tmp_path: Path) -> None:
    async def run() -> None:
        async with daemons(tmp_path, 1) as servers:
            server = servers[1]
            chance = random.Random(1)
            nothing = b"\x2f\x00"
            long = b"\x2f" + b"\xff" * 12
            server.faults.babbles = (
                *(chance.randbytes(40) for _ in range(4)),
                *(b"\x2f" + chance.randbytes(40) for _ in range(4)),
                nothing,
                long,
            )
            settings = Aap2Settings(str(tmp_path / "1.socket"), answer_s=0.2)
            heard: list[Inbound] = []

            def hear(inbound: Inbound, tell: OnResult) -> None:
                heard.append(inbound)
                tell(None)

            daemon = Aap2Daemon(settings, ONE, 1000, redial_s=0.001)
            await daemon.open(hear, lambda: None)
            async with asyncio.timeout(LIMIT_S):
                while server.faults.babbles:
                    await asyncio.sleep(0.01)
                server.faults.dead = True
                await asyncio.sleep(0.3)
                server.faults.dead = False
                server.deliver_from("ipn:2.1", "ipn:1.1", b"x")
                while not heard:
                    await asyncio.sleep(0.01)
            assert [inbound.payload for inbound in heard] == [b"x"]
            await daemon.close()

    asyncio.run(run())


def test_over_tcp_it_is_the_same(tmp_path: Path) -> None:
    async def run() -> None:
        network = Network()
        servers = {number: Aap2Server(network, number) for number in (1, 2)}
        ports = {number: await server.listen() for number, server in servers.items()}
        there = {number: Address("127.0.0.1", port) for number, port in ports.items()}
        async with (
            attached(tmp_path, 1, tcp=there[1]) as one,
            attached(tmp_path, 2, tcp=there[2]) as two,
        ):
            await one.agent.send(TWO, b"x")
            assert await two.take(1) == [b"x"]
        for server in servers.values():
            await server.stop()

    asyncio.run(run())


def test_one_daemon_reaches_many(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            daemons(tmp_path, 1, 2, 3),
            attached(tmp_path, 2) as two,
        ):
            others = (Ipn(2, 1), Ipn(3, 1))
            neighbours = tuple(Neighbour(node_of_eid(eid), DaemonLink(eid)) for eid in others)
            settings = NodeSettings(ONE, (ONE,), neighbours)
            daemon = Aap2Settings(str(tmp_path / "1.socket"))
            one = Running(make_agent(settings, tmp_path / "1.db", daemon))
            await one.agent.open(one.notices.append)
            one.agent.override(Ipn(3, 0), ContactOverride.DOWN)
            for eid in others:
                await one.agent.send(eid, b"x")
            assert await two.take(1) == [b"x"]
            await two.agent.send(ONE, b"y")
            assert (await one.take_one()).source == TWO
            first, second = one.agent.health().neighbours
            assert (first.last_heard_s is None, second.last_heard_s is None) == (False, True)
            assert (first.contact, second.contact, second.queued) == (True, False, 1)
            await one.agent.close()

    asyncio.run(run())


def test_status_reports_of_the_daemon_are_no_application_data(tmp_path: Path) -> None:
    async def run() -> None:
        async with daemons(tmp_path, 1) as servers, attached(tmp_path, 1) as one:
            servers[1].deliver_from("ipn:2.0", "ipn:1.1", b"\x82", report=True)
            servers[1].deliver_from("no endpoint", "ipn:1.1", b"y")
            servers[1].deliver_from("ipn:2.1", "ipn:1.1", b"x")
            assert await one.take(1) == [b"x"]
            await one.until(lambda: servers[1].acknowledged == [1, 2, 3])

    asyncio.run(run())


def test_the_daemon_of_another_node_is_no_daemon_of_ours(tmp_path: Path) -> None:
    async def run() -> None:
        network = Network()
        server = Aap2Server(network, 7)
        await server.listen(tmp_path / "1.socket")
        with pytest.raises(BundleError, match=r"is ipn:7\.0, not ipn:1\.0"):
            async with attached(tmp_path, 1):
                pass
        await server.stop()

    asyncio.run(run())


def test_an_endpoint_that_somebody_else_has_is_waited_for(tmp_path: Path) -> None:
    async def run() -> None:
        async with daemons(tmp_path, 1, 2) as servers, attached(tmp_path, 2) as two:
            servers[1].registered["ipn:1.1"] = ["of somebody else"]
            async with attached(tmp_path, 1) as one:
                await one.agent.send(TWO, b"x")
                assert not one.agent.health().neighbours[0].contact
                servers[1].registered["ipn:1.1"].clear()
                assert await two.take(1) == [b"x"]

    asyncio.run(run())


def test_endpoints_of_the_dtn_scheme_have_their_path_as_agent() -> None:
    from adapters.bundle.aap2.connection import _agent_id

    assert _agent_id(Ipn(1, 4)) == "4"
    assert _agent_id(Dtn("//rover/relay/one")) == "relay/one"


def test_who_has_not_the_package_hears_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("adapters.bundle.aap2")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "ud3tn_utils", None)
    monkeypatch.setitem(sys.modules, "ud3tn_utils.aap2", None)
    node = node_of(1, DaemonLink(TWO))
    with pytest.raises(BundleError, match=r"pip install 'rover-executive\[aap2\]'"):
        make_agent(node, tmp_path / "1.db", Aap2Settings("somewhere"))
