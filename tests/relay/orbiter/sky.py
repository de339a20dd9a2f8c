"""An orbiter with rovers below: real agents, real sockets, a clock that can be set forward."""

import asyncio
import socket
import sys
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from adapters.bundle import (
    Address,
    BundleAgent,
    ContactPlan,
    Ipn,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
)
from adapters.bundle.links.contact import Contact
from adapters.mops import (
    Housekeeping,
    LinkHealth,
    Message,
    decode,
    encode,
    event_of,
    health_message,
    housekeeping_message,
    load_dictionary,
    questions_message,
    reply_of,
    telemetry_of,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.transport import CLEAR
from adapters.relay.orbiter import OrbiterSettings, RelayedRoverSettings
from adapters.relay.orbiter.provider import RoverProvider
from adapters.relay.orbiter.relay import OrbiterRelay
from executive.commands import Mode
from executive.values.parameters import Parameter
from executive.values.plan_nodes import Question
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from tests.support.ports import free_port
from tests.support.processes import Running
from tests.support.timed_system import TimedSystem
from tests.support.unsynced import UNSYNCED

HERE = "127.0.0.1"
LIMIT_S = 30.0
ORBITER = Ipn(1, 1)
STAGES = (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED)
DICTIONARY = load_dictionary()


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while not true():
            await asyncio.sleep(0.02)


class Clock:
    """The time, set forward."""

    def __init__(self) -> None:
        self.shift_s = 0.0

    def utc_s(self) -> float:
        return time.time() + self.shift_s


class Sky:
    """Where everybody is: an orbiter, and rovers with nodes 2, 3, ..."""

    def __init__(self, folder: Path, *assets: str, numbered: bool = True) -> None:
        self.folder, self.numbered = folder, numbered
        self.operations: tuple[str, ...] | None = None
        self.orbiter_port = free_port(socket.SOCK_DGRAM)
        self.rover_ports = {asset: free_port(socket.SOCK_DGRAM) for asset in assets}
        self.to_orbiter = Address(HERE, self.orbiter_port)
        self.to_rover = {asset: Address(HERE, port) for asset, port in self.rover_ports.items()}

    def node(self, asset: str) -> Ipn:
        return Ipn(2 + list(self.rover_ports).index(asset), 1)

    def settings(self, **others: object) -> OrbiterSettings:
        return OrbiterSettings(
            eid=str(ORBITER),
            listen=Listen(ltp=Address(HERE, self.orbiter_port)),
            rovers=tuple(
                RelayedRoverSettings(
                    asset=asset,
                    description=f"{asset} through the relay",
                    domain=("meteron", asset),
                    eid=str(self.node(asset)),
                    ltp=LtpLink(self.to_rover[asset], answer_s=0.2),
                    port=0,
                    numbers_reports=self.numbered,
                    operations=self.operations,
                )
                for asset in self.rover_ports
            ),
            **others,  # type: ignore[arg-type]
        )


class FarRover:
    """A rover's end of the relay: takes each command once, and answers as an executive does.

    Attributes:
        lifecycle: the stages that it reports of a command.
        ledger: the name of the ledger that it has; empty for a brick, which numbers nothing.
        mute: whether what it says is lost.
        mode: what its telemetry says.
    """

    def __init__(self, sky: Sky, asset: str) -> None:
        self.name = asset.upper()
        self.lifecycle: tuple[Stage, ...] = STAGES
        self.ledger = "first"
        self.mute = False
        self.mode: Mode | None = None
        self.commands: list[Message] = []
        self.received = 0
        self._output: list[Report] = []
        neighbour = Neighbour(Ipn(ORBITER.node, 0), LtpLink(sky.to_orbiter, answer_s=0.2))
        own = sky.node(asset)
        self.agent = BundleAgent(
            NodeSettings(own, (own,), (neighbour,)),
            sky.folder / f"far-{asset}.db",
            Listen(ltp=Address(HERE, sky.rover_ports[asset])),
            system=UNSYNCED,
        )

    async def answer(self) -> None:
        while True:
            async with self.agent.receive() as delivery:
                self.received += 1
                message = decode(delivery.payload)
                identity = Identity(message.source, message.moe_inputs_id or 0)
                mine = [report for report in self._output if report.identity == identity]
                if mine:
                    await self._send(self._reply(message, mine[-1]))
                    continue
                self.commands.append(message)
                for stage in self.lifecycle:
                    report = self._report(ReportKind.COMMAND, stage.name, identity, stage)
                    await self._send(self._reply(message, report))

    def forget(self, ledger: str) -> None:
        """Come back with another ledger."""
        self.ledger = ledger
        self._output.clear()

    async def send_report(self, command: Message, number: int, stage: Stage) -> None:
        """Report a stage of a command under a number, 0 for none."""
        identity = Identity(command.source, command.moe_inputs_id or 0)
        output = (
            number,
            time.time(),
            ReportKind.COMMAND,
            Severity.INFORMATIONAL,
            "",
            identity,
            stage,
        )
        reply = self._reply(command, Report(*output, link="relay"))
        await self._send(reply if number else replace(reply, outputs=reply.outputs[:3]))

    async def event(self, text: str) -> None:
        report = self._report(ReportKind.EVENT, text)
        await self.send_event(report, self.ledger)

    async def send_event(self, report: Report, ledger: str) -> None:
        await self._send(event_of(report, DICTIONARY.spelling.event, self.name, ledger))

    async def send_telemetry(self, **figures: float) -> None:
        known = {Parameter(name): figure for name, figure in figures.items()}
        spelling = DICTIONARY.spelling.telemetry
        await self._send(telemetry_of(known, spelling, self.name, "ALL", self.mode))

    async def link(self, health: LinkHealth) -> None:
        await self._send(health_message(health, DICTIONARY.spelling.link, self.name))

    async def housekeeping(self, **figures: float | None) -> None:
        reported = Housekeeping(time.time(), figures)
        await self._send(
            housekeeping_message(reported, DICTIONARY.spelling.housekeeping, self.name)
        )

    async def question(self, utc_s: float, **questions: Question) -> None:
        """Send the open questions, each of the plan of its name."""
        by_plan = {plan_id: (each,) for plan_id, each in questions.items()}
        await self._send(
            questions_message(by_plan, utc_s, DICTIONARY.spelling.questions, self.name)
        )

    def _report(
        self,
        kind: ReportKind,
        text: str,
        identity: Identity | None = None,
        stage: Stage | None = None,
    ) -> Report:
        link = None if identity is None else "relay"
        number = len(self._output) + 1
        report = Report(
            number, time.time(), kind, Severity.INFORMATIONAL, text, identity, stage, link
        )
        self._output.append(report)
        return report

    def _reply(self, command: Message, report: Report) -> Message:
        reply = reply_of(report, DICTIONARY.entry(command), self.name, ledger=self.ledger)
        return reply if self.ledger else replace(reply, outputs=reply.outputs[:3])

    async def _send(self, message: Message) -> None:
        if not self.mute:
            await self.agent.send(ORBITER, encode(message))


@asynccontextmanager
async def landed(sky: Sky, asset: str) -> AsyncIterator[FarRover]:
    """Have a rover answer for the time of a with."""
    rover = FarRover(sky, asset)
    await rover.agent.open(lambda _: None)
    answering = asyncio.create_task(rover.answer())
    try:
        yield rover
    finally:
        answering.cancel()
        await asyncio.gather(answering, return_exceptions=True)
        await rover.agent.close()


@asynccontextmanager
async def orbiting(
    sky: Sky,
    clock: Clock | None = None,
    plan: ContactPlan | None = None,
    again: Callable[[], ContactPlan | None] = lambda: None,
    **others: object,
) -> AsyncIterator[tuple[OrbiterRelay, Sequence[RoverProvider]]]:
    """Have the orbiter serve for the time of a with; the plan is read again by `again`."""
    system = TimedSystem((clock or Clock()).utc_s)
    settings = sky.settings(**others)
    plans = [plan]

    def read_plan() -> ContactPlan | None:
        return plans.pop() if plans else again()

    relay = OrbiterRelay(settings, sky.folder / "orbiter", read_plan, DICTIONARY, system=system)
    await relay.open()
    stations = [
        RoverProvider(
            rover,
            partial(relay.link_status, node),
            partial(relay.override_contact, node),
            relay.usage.measure,
            settings.link_timeout_s,
            CLEAR,
            system,
        )
        for node, rover in relay.rovers.items()
    ]
    for station in stations:
        await station.start(HERE, None, clear_text=False)
    receiving = asyncio.create_task(relay.receive())
    try:
        yield relay, stations
    finally:
        receiving.cancel()
        await asyncio.gather(receiving, return_exceptions=True)
        for station in stations:
            await station.close()
        await relay.close()


@asynccontextmanager
async def publishing(station: RoverProvider) -> AsyncIterator[None]:
    """Have the orbiter tell of the link again and again, for telemetry may be dropped."""

    async def log() -> None:
        while True:
            station.publish_health()
            await asyncio.sleep(0.2)

    publishing = asyncio.create_task(log())
    try:
        yield
    finally:
        publishing.cancel()
        await asyncio.gather(publishing, return_exceptions=True)


async def ground(station: RoverProvider, source: str = "MOE") -> MrsClient:
    return await MrsClient.connect(str(station.uri), source)


@asynccontextmanager
async def meeting(
    sky: Sky, clock: Clock | None = None, plan: ContactPlan | None = None, **others: object
) -> AsyncIterator[tuple[OrbiterRelay, FarRover, MrsClient]]:
    """Have the orbiter, its one rover and a client on the ground for the time of a with."""
    (asset,) = sky.rover_ports
    async with (
        orbiting(sky, clock, plan, lambda: None, **others) as (relay, (station,)),
        landed(sky, asset) as rover,
        await ground(station) as client,
    ):
        yield relay, rover, client


async def catch_up(client: MrsClient, count: int) -> list[Report]:
    """Return the past once it has so many reports."""
    async with asyncio.timeout(LIMIT_S):
        while len(past := await client.get_notifications()) < count:
            await asyncio.sleep(0.02)
    return [each.report for each in past]


def eclipse(clock: Clock) -> ContactPlan:
    dawn_s = clock.utc_s() + 3600.0
    return ContactPlan((Contact(dawn_s, dawn_s + 600.0, 1, 2, 100_000),))


async def rover(*arguments: str, typed: str = "") -> tuple[int, str]:
    """Run the command as a process, for this one serves the other end."""
    command = str(Path(sys.executable).with_name("rover"))
    with TemporaryDirectory() as folder:
        log, keyboard = Path(folder, "log"), Path(folder, "keyboard")
        keyboard.write_text(typed, encoding="utf-8")
        run = partial(Running, log, command, *arguments, typed=keyboard)
        process = await asyncio.to_thread(run)
        try:
            return await asyncio.to_thread(process.ended), process.text
        finally:
            process.clean_up()
