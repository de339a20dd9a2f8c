"""The rover's end of the relay between real bundle agents, with a list where ROS would be."""

import asyncio
import logging
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.bundle.agent_settings import Peer
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.embedded import EmbeddedAgent, Listen
from adapters.bundle.node.settings import (
    Address,
    LtpLink,
    Neighbour,
    NodeSettings,
)
from adapters.mops.codec import Message, decode
from adapters.mops.dictionary import load_dictionary
from adapters.mops.reports import refusal_of
from adapters.relay.rover.bridge import LONGEST_PAYLOAD, BundleBridge
from adapters.relay.rover.settings import RelaySettings
from executive.commands.catalogue import SetTravelSpeed, Stop
from executive.reports import Identity
from tests.relay.rover.test_tray import DICTIONARY, event, telemetry
from tests.support.ports import free_udp_ports

LIMIT_S = 60.0
ORBITER, ROVER, STRANGER = Ipn(1, 1), Ipn(2, 1), Ipn(1, 2)
HERE = "127.0.0.1"


def orbiter_agent(folder: Path, own: int, rover: int) -> EmbeddedAgent:
    neighbour = Neighbour(Ipn(2, 0), LtpLink(Address(HERE, rover)))
    settings = NodeSettings(ORBITER, (ORBITER,), (neighbour,))
    return EmbeddedAgent(settings, folder / "orbiter.db", Listen(ltp=Address(HERE, own)))


def settings_of(own: int, orbiter: int) -> RelaySettings:
    return RelaySettings(
        asset="JACKAL",
        eid=str(ROVER),
        orbiter=Peer(eid=str(ORBITER), ltp=LtpLink(Address(HERE, orbiter))),
        listen=Listen(ltp=Address(HERE, own)),
        health_interval_s=3600.0,
    )


class Rover:
    """The exits of the link: commands that came, and whether anybody is there to take them."""

    def __init__(self) -> None:
        self.there = threading.Event()
        self.there.set()
        self.commands: list[str] = []
        self.numbers: list[int] = []

    def command(self, text: str, answered: Callable[[], bool]) -> bool:
        if not self.there.is_set():
            return answered()
        self.commands.append(text)
        return True

    @property
    def heard(self) -> bool:
        return self.there.is_set()

    def kept(self, sequence: int) -> None:
        self.numbers.append(sequence)


class Ends:
    """Both ends of the relay."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ports = free_udp_ports(2)
        self.rover = Rover()
        self.heard: list[Message] = []

    def link(self) -> BundleBridge:
        settings = settings_of(*self.ports)
        return BundleBridge(settings, self.folder / "relay.db", None, DICTIONARY, self.rover)

    @asynccontextmanager
    async def orbiter(self) -> AsyncIterator[EmbeddedAgent]:
        agent = orbiter_agent(self.folder, self.ports[1], self.ports[0])
        await agent.open(lambda _: None)
        hearing = asyncio.create_task(self._hear(agent))
        try:
            yield agent
        finally:
            hearing.cancel()
            await agent.close()

    @property
    def reports(self) -> list[Message]:
        return [message for message in self.heard if message.command == "EVENT"]

    async def _hear(self, agent: EmbeddedAgent) -> None:
        while True:
            async with agent.receive() as delivery:
                self.heard.append(decode(delivery.payload))


@pytest.fixture
def ends(tmp_path: Path) -> Ends:
    return Ends(tmp_path)


@pytest.fixture
def link(ends: Ends) -> Iterator[BundleBridge]:
    link = ends.link()
    link.start()
    yield link
    link.close()
    assert not link.alive


async def until(done: Callable[[], bool]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while not done():
            await asyncio.sleep(0.01)


def command(number: int) -> Message:
    return DICTIONARY.command(SetTravelSpeed(0.25), Identity("MOE", number), "JACKAL")


def number_in(report: Message) -> int:
    return int(report.outputs[3])


def octets(*messages: Message) -> bytes:
    return "".join(map(str, messages)).encode()


def test_commands_arrive_in_order_and_once_whatever_is_in_a_bundle(
    ends: Ends, link: BundleBridge
) -> None:
    stop = DICTIONARY.command(Stop(), Identity("MOE", 3), "JACKAL")

    async def session() -> None:
        async with ends.orbiter() as orbiter:
            await orbiter.send(ROVER, octets(command(1), command(2)))
            await orbiter.send(ROVER, b"FLY#" + octets(stop) + b"half")
            await orbiter.send(ROVER, b"\xff\x00 nothing at all")
            await orbiter.send(ROVER, b"x" * (LONGEST_PAYLOAD + 1))
            await orbiter.send(ROVER, octets(command(4)))
            await until(lambda: len(ends.rover.commands) == 3)
            await until(lambda: link.refused == 4)

    asyncio.run(session())
    assert ends.rover.commands == [f"{command(1)}{command(2)}", str(stop), str(command(4))]


def test_reports_arrive_and_are_said_to_be_kept_in_their_order(
    ends: Ends, link: BundleBridge
) -> None:
    for number in range(1, 301):
        link.notify(str(event(number)))

    async def session() -> None:
        async with ends.orbiter():
            await until(lambda: len(ends.reports) == 300)

    asyncio.run(session())
    assert sorted(ends.reports, key=number_in) == [event(number) for number in range(1, 301)]
    assert ends.rover.numbers == list(range(1, 301))


def test_a_command_waits_until_somebody_takes_it_and_survives_a_restart(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    ends.rover.there.clear()
    link = ends.link()
    link.start()

    async def send() -> None:
        async with ends.orbiter() as orbiter:
            await orbiter.send(ROVER, octets(command(1)))
            await until(lambda: link.health is not None and link.health.unread == 1)

    asyncio.run(send())
    link.close()
    assert ends.rover.commands == []
    assert [each for each in caplog.messages if "nobody listens" in each] == caplog.messages != []
    ends.rover.there.set()
    again = ends.link()
    again.start()
    try:
        asyncio.run(until(lambda: ends.rover.commands == [str(command(1))]))
        asyncio.run(until(lambda: again.health is not None and again.health.unread == 0))
    finally:
        again.close()
    third = ends.link()
    third.start()
    third.close()
    assert ends.rover.commands == [str(command(1))]


def test_what_the_rover_has_from_before_a_kill_is_not_published_again(ends: Ends) -> None:
    ends.rover.there.clear()
    killed = ends.link()
    killed.start()

    async def send() -> None:
        async with ends.orbiter() as orbiter:
            for number in (1, 2):
                await orbiter.send(ROVER, octets(command(number)))
            await until(lambda: killed.health is not None and killed.health.unread == 2)

    asyncio.run(send())
    killed.close()
    again = ends.link()
    again.start()
    again.notify(str(refusal_of(command(1), "JACKAL", "said before the kill, and not kept")))
    ends.rover.there.set()
    try:
        asyncio.run(until(lambda: again.health is not None and again.health.unread == 0))
    finally:
        again.close()
    assert ends.rover.commands == [str(command(2))]


def test_a_command_that_is_answered_has_been_taken(ends: Ends, link: BundleBridge) -> None:
    ends.rover.there.clear()

    def unread() -> int:
        return -1 if link.health is None else link.health.unread

    async def session() -> None:
        async with ends.orbiter() as orbiter:
            await orbiter.send(ROVER, octets(command(1), command(2)))
            await until(lambda: unread() == 1)
            for number in (1, 2):
                link.notify(str(refusal_of(command(number), "JACKAL", "no")))
            await until(lambda: unread() == 0)

    asyncio.run(session())


def test_in_the_dark_reports_are_kept_and_of_telemetry_the_newest(ends: Ends) -> None:
    link = ends.link()
    link.start()
    for number in range(1, 21):
        link.notify(str(event(number)))
    asyncio.run(until(lambda: len(ends.rover.numbers) == 20))
    asyncio.run(until(lambda: link.health is not None and link.health.queued >= 20))
    for number in range(10):
        link.notify(str(telemetry(float(number))))

    async def session() -> None:
        async with ends.orbiter():
            await until(lambda: any(message.command == "TELEMETRY" for message in ends.heard))

    try:
        asyncio.run(session())
    finally:
        link.close()
    assert sorted(ends.reports, key=number_in) == [event(number) for number in range(1, 21)]
    told = [message for message in ends.heard if message.command == "TELEMETRY"]
    assert told == [telemetry(9.0)]


def test_what_ends_with_its_lifetime_is_logged_once(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    settings = replace(settings_of(*ends.ports), lifetime_s=0.2)
    link = BundleBridge(settings, ends.folder / "relay.db", None, DICTIONARY, ends.rover)
    link.start()
    link.notify(str(event(1)))
    asyncio.run(until(lambda: ends.rover.numbers == [1]))
    asyncio.run(until(lambda: "LIFETIME_EXPIRED" in caplog.text))
    link.close()
    (line,) = [each for each in caplog.messages if "ipn:2.1" in each]
    assert line.endswith("to ipn:1.1 deleted: LIFETIME_EXPIRED")


def test_the_ground_hears_how_the_relay_is(ends: Ends, link: BundleBridge) -> None:
    async def session() -> None:
        async with ends.orbiter():
            await until(lambda: any(message.command == "LINK" for message in ends.heard))

    asyncio.run(session())
    assert link.alive


def test_an_address_that_is_taken_is_told(ends: Ends, link: BundleBridge) -> None:
    second = BundleBridge(
        settings_of(*ends.ports), ends.folder / "second.db", None, load_dictionary(), ends.rover
    )
    assert link.alive
    with pytest.raises((OSError, BundleError)):
        second.start()
    second.close()
