"""Random commands, repeats, late arrivals, crashes: do the promises of the core hold?

Each command is executed at most once and ends in exactly one terminal report, reports are numbered
without gaps, and nothing moves while the rover is stopped or safe. All this though the record is
kept as short as settings allow.
"""

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nan
from pathlib import Path
from random import Random
from typing import Final

from executive.commands import (
    Arrival,
    Command,
    DriveFor,
    FollowPath,
    Mode,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    RotateBy,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.geometry import STANDING
from executive.reports import Identity, Report, Stage
from executive.settings import FEWEST_REPORTS, Settings
from sim.rover import World
from sim.rover.body import Fault
from sim.rover.camera import Backend, PictureSettings
from sim.rover.lockstep import LockStep
from tests.support.figures import Figure, Goal

ODD_FIGURES: Final = (nan, inf, -0.0, 1e9)
PICTURE: Final = PictureSettings(width=16, height=12, backend=Backend.RAYS)
END: Final = Identity("end of the storm", 1)
REST_S: Final = 6.0
BURST: Final = 50


@dataclass(frozen=True, slots=True)
class Broken:
    """How often each promise was broken.

    Attributes:
        repeated: command stages other than PROGRESS that were reported more than once.
        unended: commands without exactly one terminal report.
        moved: ticks in which a held rover was told to move.
        gaps: reports whose number does not follow the one before.
    """

    repeated: int
    unended: int
    moved: int
    gaps: int


class Storm:
    """Sends random commands from two sources over two links to one rover.

    Attributes:
        sent: every command that was delivered, repeats included.
        crashes: how often the executive was lost.
    """

    def __init__(self, settings: Settings, folder: Path, random: Random) -> None:
        """Begin with a rover that stands and knows where it is."""
        forgetful = replace(settings, kept_reports=FEWEST_REPORTS)
        self.lockstep = LockStep(forgetful, World(), folder, picture=PICTURE)
        self.random = random
        self.sent: list[Command] = []
        self.crashes = 0
        self._tick_s = settings.tick_s
        self._late: list[Command] = []
        self._moved = 0
        self._reports: list[Report] = []
        self.let_time_pass(2)

    def commands_come(self, count: int) -> None:
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
        """Let ticks pass."""
        for _ in range(ticks):
            self.lockstep.run(self._tick_s)
            self._look()
        self._read()

    def crash(self) -> None:
        """Lose the executive as by kill -9, and start another on its ledger."""
        self.crashes += 1
        self.lockstep.restart()
        self._moved += self.lockstep.executive.velocity != STANDING

    def set_odometry(self, works: bool) -> None:
        """Lose the odometry, or find it again."""
        if works:
            self.lockstep.rover.clear(Fault.ODOMETRY_LOST)
        else:
            self.lockstep.rover.inject(Fault.ODOMETRY_LOST)

    def end(self) -> Broken:
        """Stop, let the rover come to rest, and count the promises that were broken."""
        self.set_odometry(works=True)
        self.let_time_pass(2)
        self.lockstep.submit(Command(END, Stop(), "direct"))
        self.let_time_pass(round(REST_S / self._tick_s))
        self.lockstep.executive.abandon()
        return _broken(self._reports, self._moved)

    def _deliver(self, command: Command) -> None:
        self.lockstep.submit(command)
        self.sent.append(command)
        self._look()

    def _read(self) -> None:
        """Read what was reported since, before it is forgotten."""
        executive = self.lockstep.executive
        since = self._reports[-1].sequence + 1 if self._reports else 1
        if executive.last_sequence >= since:
            self._reports += executive.reports(since, count=FEWEST_REPORTS)

    def _look(self) -> None:
        executive = self.lockstep.executive
        if executive.mode in {Mode.STOPPED, Mode.SAFE} and executive.velocity != STANDING:
            self._moved += 1

    def _command(self) -> Command:
        random = self.random
        return Command(
            Identity(random.choice(("MOE", "MOPS")), random.randrange(100_000)),
            self._request(),
            random.choice(("direct", "relay")),
            created_utc_s=self.lockstep.clock.utc_s(),
            lifetime_s=random.choice((None, None, random.uniform(0.0, 5.0))),
            arrival=random.choice(tuple(Arrival)),
        )

    def _request(self) -> Request:
        random, near = self.random, self._near
        ask = random.choice(
            (
                lambda: MoveTo(self._waypoint()),
                lambda: MoveForward(near()),
                lambda: RotateBy(near()),
                lambda: DriveFor(near() / 3, near() / 2, abs(near())),
                lambda: FollowPath(tuple(self._waypoint() for _ in range(random.randrange(4)))),
                lambda: SetTravelSpeed(near()),
                lambda: SetCameraAngles(near(), random.choice((None, near()))),
                TakePicture,
                Stop,
                Resume,
                Resume,
            )
        )
        return ask()

    def _waypoint(self) -> Waypoint:
        return Waypoint(self._near(), self._near(), self.random.choice((None, self._near())))

    def _near(self) -> float:
        odd = self.random.random() < 0.02
        return self.random.choice(ODD_FIGURES) if odd else self.random.uniform(-3.0, 3.0)


def _broken(reports: Sequence[Report], moved: int) -> Broken:
    stages = Counter(
        (report.identity, report.stage)
        for report in reports
        if report.identity is not None and report.stage is not None
    )
    ends = Counter(identity for identity, stage in stages.elements() if stage.terminal)
    return Broken(
        repeated=sum(
            count > 1 for (_, stage), count in stages.items() if stage is not Stage.PROGRESS
        ),
        unended=sum(ends[identity] != 1 for identity in {identity for identity, _ in stages}),
        moved=moved,
        gaps=sum(report.sequence != place for place, report in enumerate(reports, 1)),
    )


def measure(settings: Settings, count: int, seed: int) -> list[Figure]:
    """Return how often the promises were broken in a storm of this many commands."""
    random = Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        storm = Storm(settings, Path(folder), random)
        while len(storm.sent) < count:
            storm.commands_come(BURST)
            storm.let_time_pass(random.randrange(20))
            storm.set_odometry(works=random.random() < 0.9)
            if random.random() < 0.2:
                storm.crash()
        broken = storm.end()
    beside = f"{len(storm.sent)} commands, {storm.crashes} crashes, lock step"
    return [
        Figure("storm: stages reported twice", broken.repeated, "commands", beside, Goal(0)),
        Figure("storm: not exactly one end", broken.unended, "commands", beside, Goal(0)),
        Figure("storm: motion while stopped or safe", broken.moved, "ticks", beside, Goal(0)),
        Figure("storm: gaps in the numbering", broken.gaps, "reports", beside, Goal(0)),
    ]
