"""The agent on real sockets, over each convergence layer, where links and sessions break."""

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
from adapters.bundle.codec.errors import StoreError
from adapters.bundle.links import udp
from adapters.bundle.links.contact import Contact, ContactPlan
from adapters.bundle.node.database import BundleDatabase
from adapters.bundle.node.reporting import DeliveryStatus
from adapters.bundle.node.settings import (
    Address,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    TcpclLink,
    UdpLink,
)
from tests.bundle.worlds import (
    ANY,
    ONE,
    TWO,
    Proxy,
    Running,
    payloads_of,
    port_of,
    running,
    send_all,
)
from tests.support.ports import free_udp_ports


@pytest.mark.parametrize("acknowledge", [True, False])
async def test_tcpcl_transfers_in_both_directions_for_either_dialler(
    tmp_path: Path, acknowledge: bool
) -> None:
    waits = TcpclLink(None, acknowledge=acknowledge)
    async with running(tmp_path, 2, 1, waits, Listen(tcpcl=ANY)) as two:
        address = port_of(two.agent.listens.tcpcl)
        dials = TcpclLink(address, acknowledge=acknowledge)
        async with running(tmp_path, 1, 2, dials, Listen()) as one:
            payloads = [bytes(200_000), *payloads_of(1000)]
            await asyncio.gather(send_all(one, TWO, payloads), send_all(two, ONE, payloads))
            assert sorted(await two.take(1001)) == sorted(payloads)
            assert sorted(await one.take(1001)) == sorted(payloads)
            await one.until(lambda: one.agent.health().queued == 0)


async def test_a_store_that_fails_is_tried_again_now_and_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = 0

    def fail(_: BundleDatabase) -> None:
        nonlocal tried
        tried += 1
        raise StoreError("no disk")

    waits = TcpclLink(None)
    async with running(tmp_path, 2, 1, waits, Listen(tcpcl=ANY)) as two:
        dials = TcpclLink(port_of(two.agent.listens.tcpcl))
        async with running(tmp_path, 1, 2, dials, Listen()) as one:
            await send_all(one, TWO, [b"unit"])
            async with two.agent.receive():
                monkeypatch.setattr(BundleDatabase, "commit", fail)
            await two.until(lambda: tried > 3)
            before = asyncio.get_running_loop().time()
            await two.until(lambda: tried > 8)
            assert asyncio.get_running_loop().time() - before > 0.3
            monkeypatch.undo()


class Cutter:
    """Passes TCP on in odd pieces and cuts it, often."""

    def __init__(self, target: Address, chance: random.Random) -> None:
        self.target, self.chance = target, chance
        self.cuts = 0
        self._writers: list[asyncio.StreamWriter] = []
        self._calls: set[asyncio.Task[None] | None] = set()

    async def serve(self) -> tuple[asyncio.Server, Address]:
        server = await asyncio.start_server(self._call, "127.0.0.1", 0)
        return server, Address(*server.sockets[0].getsockname()[:2])

    async def close(self, server: asyncio.Server) -> None:
        server.close()
        await asyncio.sleep(0)
        while any(call and not call.done() for call in self._calls):
            for writer in self._writers:
                writer.transport.abort()
            await asyncio.sleep(0)
        await asyncio.sleep(0)

    async def _call(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        self._calls.add(asyncio.current_task())
        left = self.chance.randrange(8_000, 32_000)
        try:
            far_reader, far_writer = await asyncio.open_connection(
                self.target.host, self.target.port
            )
            self._writers.append(far_writer)
            await asyncio.gather(
                self._pass_on(reader, far_writer, left), self._pass_on(far_reader, writer, left)
            )
            far_writer.transport.abort()
        finally:
            writer.transport.abort()

    async def _pass_on(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, left: int
    ) -> None:
        try:
            while octets := await reader.read(self.chance.randrange(1, 3000)):
                left -= len(octets)
                if left < 0:
                    self.cuts += 1
                    writer.transport.abort()
                    break
                writer.write(octets)
                await writer.drain()
        except OSError:
            pass
        writer.close()


async def test_tcpcl_loses_nothing_where_sessions_break(tmp_path: Path) -> None:
    async with running(
        tmp_path, 2, 1, TcpclLink(None, window_octets=5000), Listen(tcpcl=ANY)
    ) as two:
        cutter = Cutter(port_of(two.agent.listens.tcpcl), random.Random(3))
        server, address = await cutter.serve()
        dials = TcpclLink(address, redial_s=0.02, segment_octets=50, window_octets=5000)
        async with running(tmp_path, 1, 2, dials, Listen()) as one:
            payloads = payloads_of(1500)
            await asyncio.gather(send_all(one, TWO, payloads), send_all(two, ONE, payloads))
            assert sorted(await two.take(1500)) == payloads
            assert sorted(await one.take(1500)) == payloads
            assert cutter.cuts > 0
            (to_two,) = one.agent.health().neighbours
            assert to_two.traffic.retransmitted > 0
            assert to_two.traffic.round_trip_s is not None
        await cutter.close(server)


@pytest.mark.parametrize(
    "octets", [b"GET / HTTP/1.1\r\n\r\n", b"dtn!\x04", b"dtn!\x03\x00\x00\x00\x07ipn:9.0"]
)
async def test_tcpcl_hangs_up_on_strangers(tmp_path: Path, octets: bytes) -> None:
    async with running(tmp_path, 2, 1, TcpclLink(None), Listen(tcpcl=ANY)) as two:
        where = port_of(two.agent.listens.tcpcl)
        reader, writer = await asyncio.open_connection(where.host, where.port)
        writer.write(octets)
        async with asyncio.timeout(10.0):
            while await reader.read(100):
                pass
        writer.close()


async def test_ends_that_do_not_agree_on_acknowledgements_report_it_and_lose_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    waits = TcpclLink(None, acknowledge=False)
    async with running(tmp_path, 2, 1, waits, Listen(tcpcl=ANY)) as two:
        dials = TcpclLink(port_of(two.agent.listens.tcpcl), redial_s=0.02)
        async with running(tmp_path, 1, 2, dials, Listen()) as one:
            await one.agent.send(TWO, b"x")
            await one.until(lambda: "set acknowledge: false here, too" in caplog.text)
            assert one.agent.health().queued == 1
            assert one.notices == []


async def test_an_absent_peer_is_reported_once_and_dialled_until_present(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.socket() as held:  # bound, and nobody listens
        held.bind(("127.0.0.1", 0))
        where = Address(*held.getsockname())
        dials = TcpclLink(where, redial_s=0.02)
        async with running(tmp_path, 1, 2, dials, Listen()) as one:
            await one.until(lambda: "ipn:2.0 at 127.0.0.1" in caplog.text)
            await one.agent.send(TWO, b"x")
            assert not one.agent.health().neighbours[0].contact
            held.close()
            async with running(tmp_path, 2, 1, TcpclLink(None), Listen(tcpcl=where)) as two:
                assert await two.take(1) == [b"x"]
                assert one.agent.health().neighbours[0].contact
    assert caplog.text.count("ipn:2.0 at 127.0.0.1") == 1


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


async def test_the_plan_opens_a_link(tmp_path: Path) -> None:
    async with ltp_pair(tmp_path) as (one, two, _):
        one.agent.set_plan(ContactPlan())
        await one.agent.send(TWO, b"planned")
        assert one.agent.health().queued == 1
        one.agent.set_plan(ContactPlan((Contact(0.0, 1e12, 1, 2, 1_000_000),)))
        assert await two.take(1) == [b"planned"]


async def test_garbage_on_the_socket_is_counted_and_changes_nothing(tmp_path: Path) -> None:
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


async def test_ltp_by_a_router_needs_to_know_it_and_an_unknown_engine_is_reported_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ports = [Address("127.0.0.1", port) for port in free_udp_ports(2)]
    reported = "segments of LTP engine 9 dropped: it is no neighbour"
    as_router = LtpLink(ports[1], answer_s=0.1)
    async with running(tmp_path, 9, 2, as_router, Listen(ltp=ports[0])) as router:
        for via in (None, "ipn:9.0"):
            to_one = LtpLink(ports[0], via=via, answer_s=0.1)
            async with running(tmp_path, 2, 1, to_one, Listen(ltp=ports[1])) as two:
                if via is None:
                    await router.agent.send(TWO, b"x")
                    await two.until(lambda: reported in caplog.text)
                    await router.agent.send(TWO, b"y")
                    await asyncio.sleep(0.3)
                    assert caplog.text.count(reported) == 1
                else:
                    assert sorted(await two.take(2)) == [b"x", b"y"]
                    assert two.agent.health().neighbours[0].last_received_s is not None
                    await router.until(lambda: router.agent.health().queued == 0)


async def test_a_burst_of_datagrams_is_taken_whole(tmp_path: Path) -> None:
    async with running(tmp_path, 2, 1, UdpLink(ANY), Listen(udp=ANY)) as two:
        link = UdpLink(port_of(two.agent.listens.udp), rate_octets_s=1 << 30)
        async with running(tmp_path, 1, 2, link, Listen(udp=ANY)) as one:
            payloads = payloads_of(1000)
            await send_all(one, TWO, payloads)
            assert sorted(await two.take(1000)) == payloads


async def test_udp_brings_fragments_and_is_confirmed(tmp_path: Path) -> None:
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


async def test_what_udp_loses_is_sent_again_until_it_is_confirmed(tmp_path: Path) -> None:
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
            traffic = one.agent.health().neighbours[0].traffic
            assert traffic.acknowledged == 50
            assert traffic.sent == 50 + traffic.retransmitted > 50
            assert traffic.round_trip_s is None
    await proxy.close()


async def test_two_neighbours_of_one_host_are_known_by_their_ports(tmp_path: Path) -> None:
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
        received = [each.last_received_s is not None for each in one.agent.health().neighbours]
        assert received == [True, number == 3]
    await one.agent.close()


@pytest.mark.parametrize("link", [LtpLink, UdpLink])
async def test_an_unknown_name_is_reported_once_and_resolved_beside_the_loop(
    tmp_path: Path,
    link: type[LtpLink] | type[UdpLink],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    known, requested = False, 0
    look_up = socket.getaddrinfo

    def names(host: str, *others: object, **more: object) -> object:
        nonlocal requested
        if host == "orbiter.example" and others[-1] != socket.AI_NUMERICHOST:
            assert threading.current_thread() is not threading.main_thread()
            requested += 1
            if not known:
                raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
            host = "127.0.0.1"
        return look_up(host, *others, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(udp, "LOOKUP_RETRY_S", 0.02)
    monkeypatch.setattr(socket, "getaddrinfo", names)
    (port,) = free_udp_ports(1)
    to_two = link(Address("orbiter.example", port))
    key = "ltp" if link is LtpLink else "udp"
    async with running(tmp_path, 1, 2, to_two, Listen(**{key: ANY})) as one:
        await one.agent.send(TWO, b"x")
        await one.until(lambda: requested > 1)
        assert not one.agent.health().neighbours[0].contact
        assert one.agent.health().queued == 1
        reported = "ipn:2.0 at orbiter.example"
        assert [reported in record.message for record in caplog.records].count(True) == 1
        to_one = link(getattr(one.agent.listens, key))
        two_listens = Listen(**{key: Address("127.0.0.1", port)})
        async with running(tmp_path, 2, 1, to_one, two_listens) as two:
            known = True
            assert await two.take(1) == [b"x"]
            assert one.agent.health().neighbours[0].contact


@pytest.mark.parametrize(
    ("link", "listen"),
    [(LtpLink(ANY), Listen(ltp=ANY)), (UdpLink(ANY), Listen(udp=ANY))],
)
async def test_a_burst_of_datagrams_finds_a_large_buffer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, link: LtpLink | UdpLink, listen: Listen
) -> None:
    requested: dict[int, int] = {}
    set_option = socket.socket.setsockopt

    def note(here: socket.socket, level: int, option: int, value: int) -> None:
        if here.type is socket.SOCK_DGRAM and level == socket.SOL_SOCKET:
            requested[option] = value
        set_option(here, level, option, value)

    monkeypatch.setattr(socket.socket, "setsockopt", note)
    async with running(tmp_path, 1, 2, link, listen):
        assert requested[socket.SO_RCVBUF] >= 4 << 20
