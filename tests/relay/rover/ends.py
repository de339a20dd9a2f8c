"""Both ends of the relay between real bundle agents, with a list where ROS would be."""

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from adapters.bundle import (
    Address,
    BundleAgent,
    Ipn,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    Peer,
)
from adapters.mops import Message, decode, event_of, fingerprint, load_dictionary, telemetry_of
from adapters.relay.rover import RelaySettings
from adapters.relay.rover.bridge import BundleBridge
from executive.commands.catalogue import SetTravelSpeed
from executive.values.parameters import Parameter
from executive.values.reports import Identity, Report, ReportKind, Severity
from tests.support.ports import free_udp_ports

DICTIONARY = load_dictionary()
SPELLING = DICTIONARY.spelling
LIMIT_S = 60.0
ORBITER, ROVER, STRANGER = Ipn(1, 1), Ipn(2, 1), Ipn(1, 2)
HERE = "127.0.0.1"


def orbiter_agent(folder: Path, own: int, rover: int) -> BundleAgent:
    neighbour = Neighbour(Ipn(2, 0), LtpLink(Address(HERE, rover)))
    settings = NodeSettings(ORBITER, (ORBITER,), (neighbour,))
    return BundleAgent(settings, folder / "orbiter.db", Listen(ltp=Address(HERE, own)))


def settings_of(own: int, orbiter: int) -> RelaySettings:
    return RelaySettings(
        asset="JACKAL",
        eid=str(ROVER),
        orbiter=Peer(eid=str(ORBITER), ltp=LtpLink(Address(HERE, orbiter))),
        listen=Listen(ltp=Address(HERE, own)),
        health_interval_s=3600.0,
    )


class Rover:
    """The bridge's topics: what was published, whether anybody is there and confirms it."""

    bridge: BundleBridge

    def __init__(self) -> None:
        self.there = threading.Event()
        self.there.set()
        self.confirms = self.confirms_stops = True
        self.commands: list[str] = []
        self.stops: list[str] = []
        self.confirmed: list[int] = []

    def publish(self, text: str, *, stops: bool) -> None:
        (self.stops if stops else self.commands).append(text)
        if self.confirms_stops if stops else self.confirms:
            self.bridge.on_confirmed(fingerprint(text))

    def has_listener(self, *, stops: bool) -> bool:
        return self.there.is_set()

    def confirm(self, mark: int) -> None:
        self.confirmed.append(mark)


def bridge_of(settings: RelaySettings, store: Path, rover: Rover) -> BundleBridge:
    rover.bridge = BundleBridge(settings, store, None, DICTIONARY, rover)
    return rover.bridge


class Ends:
    """Both ends of the relay."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.ports = free_udp_ports(2)
        self.rover = Rover()
        self.received: list[Message] = []

    def link(self) -> BundleBridge:
        return bridge_of(settings_of(*self.ports), self.folder / "relay.db", self.rover)

    @asynccontextmanager
    async def orbiter(self) -> AsyncIterator[BundleAgent]:
        agent = orbiter_agent(self.folder, self.ports[1], self.ports[0])
        await agent.open(lambda _: None)
        receiving = asyncio.create_task(self._receive(agent))
        try:
            yield agent
        finally:
            receiving.cancel()
            await agent.close()

    @property
    def reports(self) -> list[Message]:
        return [message for message in self.received if message.command == "EVENT"]

    async def _receive(self, agent: BundleAgent) -> None:
        while True:
            async with agent.receive() as delivery:
                self.received.append(decode(delivery.payload))


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


def event(number: int) -> Message:
    report = Report(number, 1.0, ReportKind.EVENT, Severity.WARNING, "near")
    return event_of(report, SPELLING.event, "JACKAL")


def telemetry(x_m: float) -> Message:
    return telemetry_of({Parameter.POS_X: x_m}, SPELLING.telemetry, "JACKAL", "ALL")
