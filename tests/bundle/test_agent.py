"""The embedded agent on real sockets, over each convergence layer."""

import asyncio
import random
import socket
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from adapters.bundle.agent import BundleAgent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import AgentClosed, StoreFull
from adapters.bundle.links import udp
from adapters.bundle.links.contact import Contact, ContactOverride, ContactPlan
from adapters.bundle.node.database import Limits
from adapters.bundle.node.reporting import DeliveryStatus
from adapters.bundle.node.settings import (
    Address,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    UdpLink,
)
from tests.bundle.agents import ANY, Proxy, Running, payloads_of, port_of, running, send_all
from tests.support.ports import free_udp_ports

ONE, TWO = Ipn(1, 1), Ipn(2, 1)


@asynccontextmanager
async def ltp_pair(
    folder: Path, *, loss: float = 0.0, answer_s: float = 0.1
) -> AsyncIterator[tuple[Running, Running, tuple[Proxy, Proxy]]]:
    """Two agents with a proxy in front of each."""
    chance = random.Random(1)
    proxies = Proxy(chance, loss, loss), Proxy(chance, loss, loss)
    before_one, before_two = [await proxy.open() for proxy in proxies]
    to_one = LtpLink(before_one, answer_s=answer_s)
    to_two = LtpLink(before_two, answer_s=answer_s)
    async with (
        running(folder, 1, 2, to_two, Listen(ltp=ANY)) as one,
        running(folder, 2, 1, to_one, Listen(ltp=ANY)) as two,
    ):
        proxies[0].target = port_of(one.agent.listens.ltp)
        proxies[1].target = port_of(two.agent.listens.ltp)
        yield one, two, proxies
    for proxy in proxies:
        await proxy.close()


def test_ltp_brings_everything_through_loss(tmp_path: Path) -> None:
    async def run() -> None:
        async with ltp_pair(tmp_path, loss=0.2) as (one, two, _):
            payloads = payloads_of(1000)
            sending = asyncio.gather(send_all(one, TWO, payloads), send_all(two, ONE, payloads))
            assert sorted(await two.take(1000)) == payloads
            assert sorted(await one.take(1000)) == payloads
            await sending
            await one.until(lambda: one.agent.health().queued == 0)

    asyncio.run(run())


def test_what_was_sent_in_the_dark_comes_when_it_is_over(tmp_path: Path) -> None:
    async def run() -> None:
        async with ltp_pair(tmp_path) as (one, two, proxies):
            for proxy in proxies:
                proxy.dark = True
            payloads = payloads_of(300)
            await send_all(one, TWO, payloads)
            health = one.agent.health()
            assert health.queued == 300
            assert health.neighbours[0].last_heard_s is None
            for proxy in proxies:
                proxy.dark = False
            assert sorted(await two.take(300)) == payloads
            await one.until(lambda: len(one.notices) == 300)
            assert {notice.status for notice in one.notices} == {DeliveryStatus.HANDED_ON}
            assert one.agent.health().neighbours[0].last_heard_s is not None

    asyncio.run(run())


def test_the_operator_closes_and_opens_a_link(tmp_path: Path) -> None:
    async def run() -> None:
        async with ltp_pair(tmp_path) as (one, two, _):
            one.agent.override(Ipn(2, 0), ContactOverride.DOWN)
            await one.agent.send(TWO, b"late")
            await two.agent.send(ONE, b"early")
            assert await one.take(1) == [b"early"]
            assert one.agent.health().queued == 1
            assert not one.agent.health().neighbours[0].contact
            one.agent.override(Ipn(2, 0), ContactOverride.UP)
            assert await two.take(1) == [b"late"]

    asyncio.run(run())


def test_the_plan_opens_a_link(tmp_path: Path) -> None:
    async def run() -> None:
        async with ltp_pair(tmp_path) as (one, two, _):
            one.agent.set_plan(ContactPlan())
            await one.agent.send(TWO, b"planned")
            assert one.agent.health().queued == 1
            one.agent.set_plan(ContactPlan((Contact(0.0, 1e12, 1, 2, 1_000_000),)))
            assert await two.take(1) == [b"planned"]

    asyncio.run(run())


def test_what_an_application_does_not_keep_comes_again(tmp_path: Path) -> None:
    async def run() -> None:
        async with ltp_pair(tmp_path) as (one, two, _):
            identity = await one.agent.send(TWO, b"x", confirm=True)
            with pytest.raises(ZeroDivisionError):
                async with two.agent.receive():
                    raise ZeroDivisionError
            delivery = await two.take_one()
            assert (delivery.identity, delivery.endpoint, delivery.source) == (identity, TWO, ONE)
            await one.until(lambda: one.agent.health().queued == 0)
            fates = {DeliveryStatus.HANDED_ON, DeliveryStatus.DELIVERED}
            await one.until(lambda: {notice.status for notice in one.notices} == fates)

    asyncio.run(run())


def test_a_full_store_says_so(tmp_path: Path) -> None:
    async def run() -> None:
        limits = Limits(most_octets=200_000)
        link = LtpLink(Address("127.0.0.1", 9))
        async with running(tmp_path, 1, 2, link, Listen(ltp=ANY), limits=limits) as one:
            sent = 0
            while not one.agent.health().full:
                await one.agent.send(TWO, bytes(1000))
                sent += 1
            with pytest.raises(StoreFull):
                await one.agent.send(TWO, b"x")
            assert one.agent.health().queued == sent

    asyncio.run(run())


def test_who_waits_hears_that_the_agent_was_closed(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(tmp_path, 1, 2, LtpLink(ANY), Listen(ltp=ANY)) as one:
            waiting = asyncio.create_task(one.take(1))
            await asyncio.sleep(0)
            await one.agent.close()
            with pytest.raises(AgentClosed):
                await waiting
            with pytest.raises(AgentClosed):
                await one.agent.send(TWO, b"x")

    asyncio.run(run())


def test_garbage_on_the_socket_is_counted_and_changes_nothing(tmp_path: Path) -> None:
    async def run() -> None:
        async with ltp_pair(tmp_path) as (one, two, _):
            where = port_of(two.agent.listens.ltp)
            transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                asyncio.DatagramProtocol, remote_addr=(where.host, where.port)
            )
            for number in range(50):
                transport.sendto(random.Random(number).randbytes(50))
            await one.agent.send(TWO, b"x")
            assert await two.take(1) == [b"x"]
            await two.until(lambda: two.agent.health().malformed > 0)
            transport.close()
            await asyncio.sleep(0)

    asyncio.run(run())


def test_udp_brings_fragments_and_is_confirmed(tmp_path: Path) -> None:
    async def run() -> None:
        chance = random.Random(4)
        proxy = Proxy(chance, 0.0, 0.2)
        before_two = await proxy.open()
        async with running(tmp_path, 1, 2, UdpLink(before_two), Listen(udp=ANY)) as one:
            back = UdpLink(port_of(one.agent.listens.udp))
            async with running(tmp_path, 2, 1, back, Listen(udp=ANY)) as two:
                proxy.target = port_of(two.agent.listens.udp)
                payload = chance.randbytes(20_000)
                await one.agent.send(TWO, payload, confirm=True)
                assert await two.take(1) == [payload]
                await one.until(lambda: one.agent.health().queued == 0)
                assert one.notices[-1].status is DeliveryStatus.DELIVERED
        await proxy.close()

    asyncio.run(run())


def test_what_udp_loses_is_sent_again_until_it_is_confirmed(tmp_path: Path) -> None:
    async def run() -> None:
        proxy = Proxy(random.Random(5), 0.3, 0.0)
        before_two = await proxy.open()
        link = UdpLink(before_two, confirm_after_s=0.2)
        async with running(tmp_path, 1, 2, link, Listen(udp=ANY)) as one:
            back = UdpLink(port_of(one.agent.listens.udp))
            async with running(tmp_path, 2, 1, back, Listen(udp=ANY)) as two:
                proxy.target = port_of(two.agent.listens.udp)
                payloads = payloads_of(50)
                await asyncio.gather(
                    *(one.agent.send(TWO, payload, confirm=True) for payload in payloads)
                )
                assert sorted(await two.take(50)) == payloads
                await one.until(lambda: one.agent.health().queued == 0)
        await proxy.close()

    asyncio.run(run())


def test_two_neighbours_of_one_host_are_known_by_their_ports(tmp_path: Path) -> None:
    async def run() -> None:
        ports = free_udp_ports(3)
        ones = NodeSettings(
            ONE,
            (ONE,),
            tuple(
                Neighbour(Ipn(2 + n, 0), UdpLink(Address("localhost", port)))
                for n, port in enumerate(ports[1:])
            ),
        )
        listen = Listen(udp=Address("127.0.0.1", ports[0]))
        one = Running(BundleAgent(ones, tmp_path / "1.db", listen))
        await one.agent.open(one.notices.append)
        await one.until(lambda: all(each.contact for each in one.agent.health().neighbours))
        back = UdpLink(Address("127.0.0.1", ports[0]))
        for number, port in ((2, ports[1]), (3, ports[2])):
            listen = Listen(udp=Address("127.0.0.1", port))
            async with running(tmp_path, number, 1, back, listen) as other:
                await other.agent.send(ONE, b"x")
                assert (await one.take_one()).source == Ipn(number, 1)
            heard = [each.last_heard_s is not None for each in one.agent.health().neighbours]
            assert heard == [True, number == 3]
        await one.agent.close()

    asyncio.run(run())


@pytest.mark.parametrize("link", [LtpLink, UdpLink])
def test_a_name_that_is_not_known_is_told_of_once_and_looked_up_beside_the_loop(
    tmp_path: Path,
    link: type[LtpLink] | type[UdpLink],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    known, asked = False, 0
    look_up = socket.getaddrinfo

    def names(host: str, *others: object, **more: object) -> object:
        nonlocal asked
        if host == "orbiter.example" and others[-1] != socket.AI_NUMERICHOST:
            assert threading.current_thread() is not threading.main_thread()
            asked += 1
            if not known:
                raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
            host = "127.0.0.1"
        return look_up(host, *others, **more)  # type: ignore[arg-type]

    async def run() -> None:
        nonlocal known
        (port,) = free_udp_ports(1)
        to_two = link(Address("orbiter.example", port))
        key = "ltp" if link is LtpLink else "udp"
        async with running(tmp_path, 1, 2, to_two, Listen(**{key: ANY})) as one:
            await one.agent.send(TWO, b"x")
            await one.until(lambda: asked > 1)
            assert not one.agent.health().neighbours[0].contact
            assert one.agent.health().queued == 1
            told = "ipn:2.0 at orbiter.example"
            assert [told in record.message for record in caplog.records].count(True) == 1
            to_one = link(getattr(one.agent.listens, key))
            two_listens = Listen(**{key: Address("127.0.0.1", port)})
            async with running(tmp_path, 2, 1, to_one, two_listens) as two:
                known = True
                assert await two.take(1) == [b"x"]
                assert one.agent.health().neighbours[0].contact

    monkeypatch.setattr(udp, "LOOKUP_AGAIN_S", 0.02)
    monkeypatch.setattr(socket, "getaddrinfo", names)
    asyncio.run(run())
