"""How fast commands that waited for contact are taken aboard, and when a stop behind them acts.

The orbiter's agent is here; `rover-relay`, `rover-executive`, the wire and a witness are processes,
joined by LTP and ROS on this machine. A command is taken when its report RECEIVED says so; a stop
has come when its bundle has left the wire, and acts when the rover is commanded to stand.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cattrs
import yaml

from adapters.bundle import (
    Address,
    BundleAgent,
    ContactOverride,
    Ipn,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    Peer,
)
from adapters.mops import MopsError, load_dictionary, messages_in, report_of
from adapters.relay.rover import RelaySettings
from executive.commands.catalogue import Request, Resume, SetTravelSpeed, Stop
from executive.values.reports import Identity, Stage
from tests.benchmarks import stop_arrivals, stop_witness
from tests.support.figures import Figure, Goal, quantile
from tests.support.ports import free_udp_ports
from tests.support.victims import Victim, workplace

ORBITER, ROVER = Ipn(1, 1), Ipn(2, 1)
HERE: Final = "127.0.0.1"
SOURCE: Final = "MOE"
LIMIT_S: Final = 120.0
POLL_S: Final = 0.005
MS: Final = 1000.0
DICTIONARY: Final = load_dictionary()


@dataclass
class Ground:
    """The orbiter's agent, what it sent, and when the executive took each command.

    Attributes:
        received_utc_s: when each command was taken, by its number.
        stages: what was reported on each, by the reports' sequence numbers: a report that comes
            again is the same report.
    """

    agent: BundleAgent
    wire: Victim
    witness: Victim
    received_utc_s: dict[int, float] = field(default_factory=dict)
    stages: dict[int, dict[int, Stage]] = field(default_factory=dict)
    last: int = 0

    async def send(self, request: Request) -> int:
        """Send a command, a stop before all others; return its number."""
        self.last += 1
        message = DICTIONARY.command(request, Identity(SOURCE, self.last), "JACKAL")
        octets = str(message).encode("ascii")
        await self.agent.send(ROVER, octets, expedited=isinstance(request, Stop))
        return self.last

    async def listen(self) -> None:
        """Take reports, for as long as the agent is open."""
        while True:
            async with self.agent.receive() as delivery:
                for message in messages_in(delivery.payload.decode(), print):
                    with suppress(MopsError):
                        report = report_of(message, DICTIONARY, 0.0)
                        if report.identity is not None and report.stage is not None:
                            number = report.identity.command_id
                            self.received_utc_s.setdefault(number, report.utc_s)
                            self.stages.setdefault(number, {})[report.sequence] = report.stage

    async def took(self, number: int) -> float:
        """Wait until the executive has reported on a command; return when it took it."""
        await until(lambda: number in self.received_utc_s, f"command {number}")
        return self.received_utc_s[number]

    def executed(self, number: int) -> int:
        """Return how often a command was executed."""
        return list(self.stages.get(number, {}).values()).count(Stage.EXECUTED)

    async def dark(self, numbers: int, request: Request) -> Sequence[int]:
        """Send commands while there is no contact."""
        self.agent.override(Ipn(ROVER.node, 0), ContactOverride.DOWN)
        return [await self.send(request) for _ in range(numbers)]

    async def stop(self) -> float:
        """Stop; return after how many seconds zero is commanded."""
        sent_s = time.perf_counter()
        await self.took(await self.send(Stop()))
        arrival_s = await self._first(self.wire, "", sent_s)
        return await self._first(self.witness, stop_witness.ZERO, arrival_s) - arrival_s

    async def _first(self, teller: Victim, word: str, after_s: float) -> float:
        """Wait for the first line of a word and a time after another; return that time."""
        times_s: list[float] = []

        def reported() -> bool:
            lines = teller.child.log.read_text(encoding="utf-8").split("\n")[1:-1]
            text = (line.removeprefix(word) for line in lines if line.startswith(word))
            times_s.extend(at_s for each in text if (at_s := float(each)) > after_s)
            return bool(times_s)

        await until(reported, f"{teller.name}: {word}")
        return times_s[0]

    def dawn(self) -> float:
        """Have contact again; return when."""
        self.agent.override(Ipn(ROVER.node, 0), ContactOverride.UP)
        return time.time()


async def until(done: Callable[[], bool], what: str) -> None:
    """Wait for something.

    Raises:
        TimeoutError: it did not come.
    """
    deadline_s = time.monotonic() + LIMIT_S
    while not done():
        if time.monotonic() > deadline_s:
            raise TimeoutError(what)
        await asyncio.sleep(POLL_S)


@asynccontextmanager
async def orbiter(store: Path, port: int, rover_port: int) -> AsyncIterator[BundleAgent]:
    link = LtpLink(Address(HERE, rover_port))
    settings = NodeSettings(ORBITER, (ORBITER,), (Neighbour(Ipn(ROVER.node, 0), link),))
    agent = BundleAgent(settings, store, Listen(ltp=Address(HERE, port)))
    await agent.open(lambda _: None)
    try:
        yield agent
    finally:
        await agent.close()


def measure(commands: int, samples: int, refused: int, log: Callable[[str], None]) -> list[Figure]:
    """Return the figures.

    Args:
        commands: how many wait for the contact whose drain is measured.
        samples: stops behind each of the queues.
        refused: bundles that hold no command, before a stop.
        log: is told of each step.
    """
    orbiter_port, to_orbiter, to_rover, rover_port = ports = free_udp_ports(4)
    with workplace() as workspace:
        settings = RelaySettings(
            asset="JACKAL",
            eid=str(ROVER),
            orbiter=Peer(eid=str(ORBITER), ltp=LtpLink(Address(HERE, to_rover))),
            listen=Listen(ltp=Address(HERE, rover_port)),
        )
        config = workspace.folder / "jackal.relay.yaml"
        config.write_text(yaml.safe_dump(cattrs.unstructure(settings)), encoding="utf-8")
        data = ("--data", workspace.folder / "aboard")
        executive = workspace.start(
            "executive", "adapters.onboard.process", "--relay", "--port", 0, *data
        )
        executive.wait()
        relay = workspace.start(
            "relay", "adapters.relay.rover.process", "--config", config, *data,
            up="relays for JACKAL",
        )  # fmt: skip
        relay.wait()
        witness = workspace.start(
            "witness", "tests.benchmarks.stop_witness", stop_witness.EVERY, up=stop_witness.WATCHES
        )
        wire = workspace.start(
            "wire", "tests.benchmarks.stop_arrivals", *ports, up=stop_arrivals.JOINS
        )
        for each in (witness, wire):
            each.wait()

        async def session() -> list[Figure]:
            async with orbiter(workspace.folder / "orbiter.db", orbiter_port, to_orbiter) as agent:
                ground = Ground(agent, wire, witness)
                listening = asyncio.create_task(ground.listen())
                try:
                    await ground.took(await ground.send(Resume()))
                    figures = await _drain(ground, commands, log)
                    for behind in (0, 100, 1000, 3000):
                        figures += await _stops(ground, behind, samples, log)
                    figures += await _stops_behind_refused(ground, refused, samples, log)
                finally:
                    listening.cancel()
                    await asyncio.gather(listening, return_exceptions=True)
                return figures

        return asyncio.run(session())


async def _drain(ground: Ground, commands: int, log: Callable[[str], None]) -> list[Figure]:
    log(f"{commands} commands that waited for contact ...")
    numbers = await ground.dark(commands, SetTravelSpeed(0.25))
    began_utc_s = ground.dawn()
    took_s = max([await ground.took(number) for number in numbers]) - began_utc_s
    await until(lambda: all(ground.executed(number) for number in numbers), "all executed")
    twice = sum(ground.executed(number) > 1 for number in numbers)
    beside = f"{commands} commands in the dark, one bundle each, LTP on loopback"
    return [
        Figure("drained after contact", commands / took_s, "1/s", beside, Goal(1000.0, True)),
        Figure("executed twice", twice, "", beside, Goal(0.0)),
    ]


async def _stops(
    ground: Ground, behind: int, samples: int, log: Callable[[str], None]
) -> list[Figure]:
    log(f"stops behind {behind} commands ...")
    delays_s = []
    for _ in range(samples):
        await ground.dark(behind, SetTravelSpeed(0.25))
        ground.dawn()
        await until(lambda: ground.agent.health().queued == 0, "all commands are aboard")
        delays_s.append(await ground.stop())
        await _resume(ground)
    return _figures(f"stop behind {behind} commands that came", delays_s)


async def _stops_behind_refused(
    ground: Ground, refused: int, samples: int, log: Callable[[str], None]
) -> list[Figure]:
    log(f"stops behind {refused} refused bundles ...")
    delays_s = []
    for _ in range(samples):
        ground.agent.override(Ipn(ROVER.node, 0), ContactOverride.DOWN)
        for first in range(0, refused, 500):
            numbers = range(first, first + 500)
            await asyncio.gather(*(ground.agent.send(ROVER, b"%d" % each) for each in numbers))
        ground.dawn()
        await until(lambda: ground.agent.health().queued < 100, "the refused are nearly aboard")
        delays_s.append(await ground.stop())
        await until(lambda: ground.agent.health().queued == 0, "the refused are aboard")
        await _resume(ground)
    return _figures(f"stop behind {refused} refused bundles", delays_s)


async def _resume(ground: Ground) -> None:
    number = await ground.send(Resume())
    await until(lambda: ground.executed(number) > 0, "resumed")


def _figures(name: str, delays_s: Sequence[float]) -> list[Figure]:
    beside = f"{len(delays_s)} stops, from the arrival of their bundle to zero on cmd_vel"
    return [
        Figure(f"{name}, p99", MS * quantile(delays_s, 0.99), "ms", beside, Goal(20.0)),
        Figure(f"{name}, max", MS * max(delays_s), "ms", beside, Goal(50.0)),
    ]
