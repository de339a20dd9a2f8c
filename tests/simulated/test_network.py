"""The simulated network: by itself, under the product's MAL, and under its bundle agents."""

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from itertools import count
from typing import Any

import pytest

from adapters.bundle.agent import BundleAgent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import StoreError
from adapters.bundle.node.settings import (
    Address,
    AnyLink,
    Listen,
    Neighbour,
    NodeSettings,
    TcpclLink,
    UdpLink,
)
from adapters.mal import CallContext, Consumer, MalError, Provider
from tests.mal.wiretest import SERVICE, SPECIFICATION
from tests.simulated.disk import Fate, Nth
from tests.simulated.network import Channel
from tests.simulated.process import Process
from tests.simulated.system import SimSystem
from tests.simulated.world import World

Main = Callable[[Process], Coroutine[Any, Any, object]]
A, B = "10.0.0.1", "10.0.0.2"
PORT = 7000


@pytest.fixture
def world() -> Iterator[World]:
    with World(1) as world:
        yield world
        assert world.errors == []


def running(world: World, host: str, main: Main) -> Process:
    process = world.process(f"at {host}", host, lambda process: process.run(main(process)))
    process.begin()
    return process


class Recorder(asyncio.Protocol):
    """What came over a connection, with the times."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.arrived: list[tuple[float, str]] = []
        self.octets = 0
        self.paused: list[bool] = []
        self.transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self.note("made")

    def data_received(self, data: bytes) -> None:
        self.octets += len(data)
        self.note(data[:10].decode())

    def eof_received(self) -> None:
        self.note("end")

    def connection_lost(self, exc: Exception | None) -> None:
        self.note("lost" if exc is None else type(exc).__name__)

    def pause_writing(self) -> None:
        self.paused.append(True)

    def resume_writing(self) -> None:
        self.paused.append(False)

    def note(self, what: str) -> None:
        self.arrived.append((round(self.world.now_s, 3), what))


class Pair:
    """A process that listens and one that connects to it, a second of light apart."""

    def __init__(self, world: World) -> None:
        self.world = world
        world.network.set_channel(A, B, Channel(1.0))
        self.near, self.far = Recorder(world), Recorder(world)
        self.refused: list[tuple[float, str]] = []
        self.server = running(world, B, self.serve)
        self.client = running(world, A, self.connect)

    async def serve(self, _: Process) -> None:
        await asyncio.get_running_loop().create_server(lambda: self.far, "0.0.0.0", PORT)
        await asyncio.Event().wait()

    async def connect(self, _: Process) -> None:
        try:
            await asyncio.get_running_loop().create_connection(lambda: self.near, B, PORT)
        except OSError as error:
            self.refused.append((round(self.world.now_s, 3), type(error).__name__))
        await asyncio.Event().wait()

    def write(self, octets: bytes) -> None:
        """Have the client write, as the next event of it."""
        self.client.loop.call_soon(self.near.transport.write, octets)

    def close(self) -> None:
        self.client.loop.call_soon(self.near.transport.close)


def test_octets_arrive_in_order(world: World) -> None:
    pair = Pair(world)
    for at_s, text in ((5.0, b"one"), (5.0, b"two"), (6.0, b"three")):
        world.at(at_s, pair.write, text)
    world.at(7.0, pair.close)
    world.run(20.0)
    assert pair.near.arrived == [(2.0, "made"), (7.0, "lost")]
    assert pair.far.arrived == [
        (3.0, "made"),
        (6.0, "onetwo"),
        (7.0, "three"),
        (8.0, "end"),
        (8.0, "lost"),
    ]


def test_a_killed_peer_resets(world: World) -> None:
    pair = Pair(world)
    world.at(10.0, pair.server.kill)
    world.run(20.0)
    assert pair.near.arrived[1:] == [(11.0, "ConnectionResetError")]
    assert pair.far.arrived == [(3.0, "made")]


def test_a_half_open_connection_is_silent_until_the_peer_is_back(world: World) -> None:
    pair = Pair(world)
    world.at(10.0, lambda: pair.server.kill(silent=True))
    world.at(20.0, pair.write, b"vanishes")
    world.at(100.0, pair.server.begin)
    world.run(100.0)
    assert pair.near.arrived == [(2.0, "made")]
    world.run(220.0)
    assert [what for _, what in pair.near.arrived] == ["made", "ConnectionResetError"]


def test_a_reset_that_is_lost_leaves_a_half_open_connection(world: World) -> None:
    pair = Pair(world)
    world.run(5.0)
    world.network.set_channel(A, B, Channel(1.0, open=lambda now_s: now_s > 12.0))
    world.at(10.0, pair.server.kill)
    world.at(50.0, pair.write, b"is answered")
    world.run(60.0)
    assert pair.near.arrived == [(2.0, "made"), (52.0, "ConnectionResetError")]


def test_what_vanishes_ends_a_connection_at_last(world: World) -> None:
    pair = Pair(world)
    world.at(10.0, lambda: pair.server.kill(silent=True))
    world.at(20.0, pair.write, b"vanishes")
    world.run(2000.0)
    ((at_s, what),) = pair.near.arrived[1:]
    assert (what, 900.0 < at_s < 1100.0) == ("TimeoutError", True)


def test_a_port_without_listener(world: World) -> None:
    pair = Pair(world)
    pair.server.kill()
    world.run(10.0)
    assert pair.refused == [(2.0, "ConnectionRefusedError")]


def test_nothing_is_answered_by_a_computer_that_is_off(world: World) -> None:
    pair = Pair(world)
    pair.server.cut_power()
    world.run(1000.0)
    ((at_s, what),) = pair.refused
    assert (what, 100.0 < at_s < 200.0) == ("TimeoutError", True)


def test_tcp_outlasts_an_eclipse(world: World) -> None:
    pair = Pair(world)
    world.run(4.0)
    world.network.set_channel(
        A, B, Channel(1.0, loss=0.3, open=lambda now_s: not 10.0 < now_s < 40.0)
    )
    for number in range(30):
        world.at(5.0 + number, pair.write, b"%d " % number)
    world.run(200.0)
    assert pair.far.octets == sum(len(b"%d " % number) for number in range(30))


def test_a_slow_reader_stops_the_writer(world: World) -> None:
    pair = Pair(world)
    world.run(5.0)
    pair.far.transport.pause_reading()
    for _ in range(64):
        pair.write(bytes(16 << 10))
    world.run(10.0)
    assert pair.near.paused == [True]
    assert pair.near.transport.get_write_buffer_size() == (1 << 20) - world.network.window_octets
    assert pair.far.octets == 0
    pair.far.transport.resume_reading()
    world.run(60.0)
    assert (pair.near.paused, pair.far.octets) == ([True, False], 1 << 20)


def test_a_stopped_process_does_not_read_either(world: World) -> None:
    pair = Pair(world)
    world.run(5.0)
    pair.server.pause()
    for _ in range(64):
        pair.write(bytes(16 << 10))
    world.run(100.0)
    assert (pair.near.paused, pair.far.octets) == ([True], 0)
    pair.server.resume()
    world.run(200.0)
    assert (pair.near.paused, pair.far.octets) == ([True, False], 1 << 20)


def test_datagrams_get_lost_overtake_and_arrive_twice(world: World) -> None:
    world.network.set_channel(A, B, Channel(1.0, 0.5, 0.2, 0.1, lambda now_s: now_s < 90.0))
    received: list[int] = []

    async def receive(process: Process) -> None:
        bound = world.network.datagrams(process.present, ("0.0.0.0", PORT), 1 << 20)
        loop = asyncio.get_running_loop()
        loop.add_reader(bound, lambda: received.append(int(bound.recvfrom(100)[0])))
        await asyncio.Event().wait()

    async def send(process: Process) -> None:
        bound = world.network.datagrams(process.present, ("0.0.0.0", 0), 1 << 20)
        await asyncio.sleep(1.0)
        for number in range(990):
            bound.sendto(b"%d" % number, (B, PORT))
            await asyncio.sleep(0.1)

    running(world, B, receive)
    running(world, A, send)
    world.run(200.0)
    times = Counter(received)
    assert max(times) <= 890
    assert 640 < len(times) < 780
    assert 40 < sum(1 for each in times.values() if each == 2) < 110
    assert received != sorted(received)


def test_mal_survives_kills(world: World, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)
    world.network.set_channel(A, B, Channel(0.1, 0.05))
    world.network.split = 0.2
    served: list[str] = []
    outcomes: list[str] = []

    async def provide(process: Process) -> None:
        provider = Provider(SPECIFICATION, SERVICE, system=SimSystem(process))

        def submit(_: CallContext, name: str, _on: bool) -> None:
            served.append(name)

        provider.serve(SERVICE, "doSubmit", submit)
        await provider.start("0.0.0.0", PORT, clear_text=True)
        await asyncio.Event().wait()

    async def consume(process: Process) -> None:
        numbers, system, uri = count(), SimSystem(process), f"maltcp://{B}:{PORT}/{SERVICE}"
        while True:
            try:
                consumer = await Consumer.connect(SPECIFICATION, uri, system=system)
                while True:
                    name = f"lamp {next(numbers)}"
                    await consumer.submit(SERVICE, "doSubmit", name, True)
                    outcomes.append(name)
                    await asyncio.sleep(0.5)
            except MalError as error:
                outcomes.append(str(error))
                await asyncio.sleep(1.0)

    provider = running(world, B, provide)
    running(world, A, consume)
    for at_s in (10.0, 15.3, 20.7):
        world.at(at_s, provider.kill)
        world.at(at_s + 2.0, provider.begin)
    world.run(30.0)
    done = [outcome for outcome in outcomes if outcome.startswith("lamp")]
    assert set(done) <= set(served)
    assert len(done) > 20
    assert len(outcomes) - len(done) >= 3


def agent_of(process: Process, number: int, other: int, link: AnyLink) -> BundleAgent:
    settings = NodeSettings(
        Ipn(number, 1), (Ipn(number, 1),), (Neighbour(Ipn(other, 0), link, default=True),)
    )
    here = Address("0.0.0.0", PORT)
    listen, path = Listen(tcpcl=here, udp=here), process.folder / "bundles.db"
    return BundleAgent(settings, path, listen, system=SimSystem(process))


@pytest.mark.parametrize("kind", [UdpLink, TcpclLink])
@pytest.mark.parametrize("kills", [0, 6])
def test_each_bundle_arrives(world: World, kind: type[UdpLink | TcpclLink], kills: int) -> None:
    """Over loss, duplication and an eclipse once; a kill within a delivery repeats that one."""
    received: list[str] = []
    sent: list[str] = []
    numbers = count()

    async def send(process: Process) -> None:
        agent = agent_of(process, 1, 2, kind(Address(B, PORT), confirm_after_s=5.0))
        await agent.open(lambda _: None)
        while len(sent) < 40:
            text = f"message {next(numbers)}"
            with suppress(StoreError):  # not sent
                await agent.send(Ipn(2, 1), text.encode(), lifetime_s=3600.0, confirm=True)
                sent.append(text)
            await asyncio.sleep(1.0)
        await asyncio.Event().wait()

    async def receive(process: Process) -> None:
        agent = agent_of(process, 2, 1, kind(Address(A, PORT), confirm_after_s=5.0))
        await agent.open(lambda _: None)
        while True:
            async with agent.receive() as delivery:
                received.append(delivery.payload.decode())

    def begin_again(process: Process, _: int) -> None:
        world.after(1.5, process.begin)

    channel = Channel(
        0.5, 0.2, loss=0.1, duplicate=0.05, open=lambda now_s: not 15.0 < now_s < 30.0
    )
    world.network.set_channel(A, B, channel)
    chance = world.random("kills")
    for process in (running(world, A, send), running(world, B, receive)):
        process.on_end = begin_again
        process.disk.plan = plan = Nth()
        for number in range(kills):
            at_s, then = chance.uniform(0.0, 60.0), list(Fate)[number % len(Fate)]
            world.at(at_s, plan.after, 1, then)
            world.at(chance.uniform(0.0, 60.0), process.kill)
    world.run(600.0)
    assert len(sent) == 40
    assert set(sent) <= set(received)
    assert len(received) - len(set(received)) <= kills
    assert (sum(process.present.number for process in world.processes.values()) > 2) == (kills > 0)
