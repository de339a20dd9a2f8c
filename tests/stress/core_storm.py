"""Random commands, repeats, late arrivals, crashes: do the promises of the core hold?

Each command is executed at most once and ends in exactly one terminal report, reports are numbered
without gaps, and nothing moves while the rover is stopped or safe. All this though the record is
kept as short as settings allow.
"""

import tempfile
from dataclasses import replace
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from executive.commands import Mode, OnlyAt, Precondition
from executive.commands.catalogue import Command, PreemptionPolicy, Stop
from executive.settings import MIN_REPORTS, Settings
from executive.values.geometry import STANDING
from executive.values.reports import Identity, Report
from sim.rover import World
from sim.rover.camera import Backend, PictureSettings
from sim.rover.faults import OdometryLost
from sim.rover.lockstep import LockStep
from tests.stress.command_generator import random_request
from tests.stress.findings import Findings, LifecycleFault, Log, broken_lifecycles
from tests.support.figures import Figure

ODD: Final = 0.02
"""Of the figures in commands: those that make no sense."""
PICTURE: Final = PictureSettings(width=16, height=12, backend=Backend.RAYS)
END: Final = Identity("end of the storm", 1)
REST_S: Final = 6.0
BURST: Final = 50


@unique
class StormFault(Enum):
    """What must not be, beside what no life of a command may show."""

    MOVED = "motion while stopped or safe"


class Storm:
    """Sends random commands from two sources over two links to one rover.

    Attributes:
        sent: every command that was delivered, repeats included.
        crashes: how often the executive was lost.
        findings: what is wrong.
    """

    def __init__(self, settings: Settings, folder: Path, random: Random, log: Log) -> None:
        forgetful = replace(settings, retained_reports=MIN_REPORTS)
        self.lockstep = LockStep(forgetful, World(), folder, picture=PICTURE)
        self.random = random
        self.sent: list[Command] = []
        self.crashes = 0
        self.findings = Findings(log)
        self._tick_s = settings.tick_s
        self._late: list[Command] = []
        self._reports: list[Report] = []
        self.let_time_pass(2)

    def receive_commands(self, count: int) -> None:
        """Send new commands, some held back, some held back before, some again."""
        for _ in range(count):
            match self.random.randrange(5):
                case 0:
                    self._late.append(self._command())
                case 1 if self._late:
                    self._deliver(self._late.pop(self.random.randrange(len(self._late))))
                case 2 if self.sent:
                    self._deliver(self.random.choice(self.sent))
                case _:
                    self._deliver(self._command())
            if self.random.random() < 0.2:
                self.let_time_pass(1)

    def let_time_pass(self, ticks: int) -> None:
        for _ in range(ticks):
            self.lockstep.run(self._tick_s)
            self._poll()
        self._read()

    def crash(self) -> None:
        """Lose the executive as by kill -9, and start another on its ledger."""
        self.crashes += 1
        self.lockstep.kill()
        self.lockstep.start()
        if self.lockstep.executive.velocity != STANDING:
            self.findings.add(StormFault.MOVED, "at the start")

    def set_odometry(self, works: bool) -> None:
        if works:
            self.lockstep.rover.clear(OdometryLost)
        else:
            self.lockstep.rover.inject(OdometryLost())

    def end(self) -> Findings:
        """Stop, let the rover come to rest, and return what is wrong."""
        self.set_odometry(works=True)
        self.let_time_pass(2)
        self.lockstep.submit(Command(END, Stop(), "direct"))
        self.let_time_pass(round(REST_S / self._tick_s))
        self.lockstep.executive.simulate_crash()
        for fault, about in broken_lifecycles(self._reports):
            self.findings.add(fault, about)
        return self.findings

    def _deliver(self, command: Command) -> None:
        self.lockstep.submit(command)
        self.sent.append(command)
        self._poll()

    def _read(self) -> None:
        """Read what was reported since, before it is forgotten."""
        executive = self.lockstep.executive
        since = self._reports[-1].sequence + 1 if self._reports else 1
        if executive.last_sequence >= since:
            self._reports += executive.reports(since, count=MIN_REPORTS)

    def _poll(self) -> None:
        executive = self.lockstep.executive
        if executive.mode in {Mode.STOPPED, Mode.SAFE} and executive.velocity != STANDING:
            self.findings.add(StormFault.MOVED, executive.velocity)

    def _command(self) -> Command:
        random = self.random
        return Command(
            Identity(random.choice(("MOE", "MOPS")), random.randrange(100_000)),
            random_request(random, len(self.sent), ODD),
            random.choice(("direct", "relay")),
            created_utc_s=self.lockstep.clock.utc_s(),
            lifetime_s=random.choice((None, None, random.uniform(0.0, 5.0))),
            preemption=random.choice(tuple(PreemptionPolicy)),
            precondition=random.choice((None, None, None, self._precondition())),
        )

    def _precondition(self) -> Precondition:
        random = self.random
        at = OnlyAt(random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0), random.uniform(0.1, 5.0))
        after = self.sent[-1].identity.command_id or None if self.sent else None
        mode = random.choice(tuple(Mode))
        return random.choice((Precondition(at), Precondition(after=after), Precondition(mode=mode)))


def measure(settings: Settings, count: int, seed: int, log: Log) -> list[Figure]:
    """Return how often the promises were broken in a storm of this many commands."""
    random = Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        storm = Storm(settings, Path(folder), random, log)
        while len(storm.sent) < count:
            storm.receive_commands(BURST)
            storm.let_time_pass(random.randrange(20))
            storm.set_odometry(works=random.random() < 0.9)
            if random.random() < 0.2:
                storm.crash()
        findings = storm.end()
    beside = f"{len(storm.sent)} commands, {storm.crashes} crashes, lock step"
    return [
        *findings.figures("storm", LifecycleFault, beside),
        *findings.figures("storm", StormFault, beside),
    ]
