"""The orbiter's agent in the test, and rover-relay as a process."""

import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import pytest

from adapters.bundle import BundleAgent
from adapters.mops import Message, MopsError, load_dictionary, messages_in, report_of
from adapters.relay.rover import load_relay
from executive.values.reports import Identity, Report, Stage
from tests.conftest import port_of
from tests.relay.rover.ends import ROVER, octets, orbiter_agent
from tests.support.processes import Running

LIMIT_S = 90.0
DICTIONARY = load_dictionary()
SOURCE = "MOE"


class Orbiter:
    """The other end: sends commands as bundles, keeps what comes by the numbers of reports."""

    def __init__(self, agent: BundleAgent) -> None:
        self._agent = agent
        self.messages: list[Message] = []

    async def request(self, *commands: Message) -> None:
        await self._agent.send(ROVER, octets(*commands))

    @property
    def queued(self) -> int:
        return self._agent.health().queued

    async def receive(self) -> None:
        while True:
            async with self._agent.receive() as delivery:
                self.messages += messages_in(delivery.payload.decode(), pytest.fail)

    @property
    def reports(self) -> list[Report]:
        """The reports, by number; the same number is the same report."""
        found: dict[int, Report] = {}
        for message in self.messages:
            try:
                report = report_of(message, DICTIONARY, 0.0)
            except MopsError:
                continue
            assert found.setdefault(report.sequence, report) == report
        return [found[number] for number in sorted(found)]

    def stages(self, number: int) -> list[Stage | None]:
        mine = Identity(SOURCE, number)
        return [report.stage for report in self.reports if report.identity == mine]

    def ended(self, number: int) -> bool:
        stages = self.stages(number)
        return bool(stages) and stages[-1] is not None and stages[-1].terminal

    async def until(self, done: Callable[[], bool], what: str) -> None:
        try:
            async with asyncio.timeout(LIMIT_S):
                while not done():
                    await asyncio.sleep(0.02)
        except TimeoutError:
            reported = "\n".join(map(str, self.messages))
            raise AssertionError(f"waited in vain: {what}\n{reported}") from None


class RelayPair:
    """A place where the processes meet."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder = folder
        self.orbiter_port, self.rover_port = port_of(domain), port_of(domain)
        _, path = load_relay("jackal")
        text = path.read_text().replace("1113", str(self.orbiter_port))
        self.config = folder / "jackal.relay.yaml"
        self.config.write_text(text.replace("1114", str(self.rover_port)))

    @contextmanager
    def relay(self) -> Iterator[Running]:
        with self.relay_that_starts() as process:
            process.output("relays for JACKAL")
            yield process

    @contextmanager
    def relay_that_starts(self) -> Iterator[Running]:
        log = self.folder / f"relay-{len(list(self.folder.glob('relay-*')))}.log"
        options = ("--config", str(self.config), "--data", str(self.folder / "relay"))
        process = Running(log, sys.executable, "-m", "adapters.relay.rover.process", *options)
        try:
            yield process
        finally:
            process.clean_up()

    @asynccontextmanager
    async def orbiter(self) -> AsyncIterator[Orbiter]:
        agent = orbiter_agent(self.folder, self.orbiter_port, self.rover_port)
        await agent.open(lambda _: None)
        orbiter = Orbiter(agent)
        receiving = asyncio.create_task(orbiter.receive())
        try:
            yield orbiter
        finally:
            receiving.cancel()
            await agent.close()
