"""Power cuts at any moment, with disks of any speed: does the ledger have all that was sent?

A power cut ends each run of the executive: uncommitted batches are lost. Then the same commands
arrive again. The ledger has each report that was sent and each command that moved the rover; no
command moves the rover twice, and no answered stop is released.
"""

import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from executive.commands import (
    ActivatePlan,
    Command,
    Mode,
    MoveForward,
    Request,
    Resume,
    ResumePlan,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    SuspendPlan,
)
from executive.commands.lifecycle import Accepted, Duplicate, SubmitResult
from executive.values.geometry import STANDING
from executive.values.reports import Identity, Report, Stage
from tests.stress.findings import Findings, Log
from tests.support.figures import Figure
from tests.support.kinematic import Bench
from tests.support.plans import plan
from tests.support.slow_disk import SlowWriter, drawn

COMMIT_S: Final = (0.0, 0.02, 0.1, 0.4, 0.8)
"""Mean durations of a commit; each run draws one."""
MAX_STEPS: Final = 60
STEPS: Final = 6
_STEP: Final = '<moveForward distance="0.02" deadline_s="60"/>'
PLAN: Final = f"<Sequence>{STEPS * _STEP}</Sequence>"


@unique
class PowerCut(Enum):
    """What must not be after a power cut."""

    SENT = "reports sent that the ledger does not have"
    ANSWERED = "commands answered as accepted that the ledger does not have"
    MOVED = "commands that moved the rover and that the ledger does not have"
    TWICE = "commands that moved the rover in two runs"
    RELEASED = "answered stops that a restart released"
    STEPS = "plans that executed a step twice"
    FAILED = "ledgers that refused a batch"
    GAP = "gaps in the numbers of the ledger"


@dataclass(frozen=True, slots=True)
class Mix:
    """Shares of the requests of a run."""

    name: str
    motions: int
    settings: int
    stops: int
    plans: int


MIXES: Final = (
    Mix("everything", 4, 4, 3, 1),
    Mix("motion and plans", 10, 1, 2, 6),
    Mix("stops", 3, 1, 8, 0),
)


class PowerCuts:
    """One rover over many runs of its executive."""

    def __init__(self, folder: Path, random: Random, mix: Mix, log: Log) -> None:
        self.random, self.mix = random, mix
        self.findings = Findings(log)
        self.answers = 0
        self.bench = Bench(folder)
        self._sent: list[Command] = []
        self._moved: set[Identity] = set()
        self._sent_before = self._submitted = 0
        self._plan = "p0"
        self._slow_down()

    def run(self) -> None:
        """Send commands for a while, cut the power, start again, and compare."""
        moved: set[Identity] = set()
        self._accepted: set[Identity] = set()
        self._stopped = self._resumed = 0
        for _ in range(self.random.randrange(MAX_STEPS)):
            if self.random.random() < 0.4:
                command = self._command()
                self.bench.executive.submit(command, self._noting(command))
                if self.random.random() < 0.5:
                    self.bench.executive.serve_inbox()
            self.bench.step()
            active = self.bench.executive.active_command
            if not self.bench.executive.ledger_writable:
                self.findings.add(PowerCut.FAILED, self.bench.ledger.state.error)
            if active is not None and self.bench.rover.velocity != STANDING:
                moved.add(active)
        self._cut_power()
        self._compare(moved)
        self._slow_down()

    def _cut_power(self) -> None:
        """Lose the uncommitted batches; the rover stops before the executive starts again."""
        sent = self.bench.received.reports[self._sent_before :]
        self.bench.executive.simulate_crash()
        self.bench.rover.velocity = STANDING
        self.bench.restart()
        self._reports = sent

    def _compare(self, moved: set[Identity]) -> None:
        ledger, find = self.bench.ledger, self.findings.add
        numbers = {each.sequence: each for each in _all_reports(self.bench)}
        if list(numbers) != list(range(1, len(numbers) + 1)):
            find(PowerCut.GAP, sorted(numbers)[-3:])
        for report in self._reports:
            if numbers.get(report.sequence) != report:
                find(PowerCut.SENT, report)
        for identity in self._accepted:
            if ledger.digest_of(identity) is None:
                find(PowerCut.ANSWERED, identity)
        for identity in moved:
            if ledger.digest_of(identity) is None:
                find(PowerCut.MOVED, identity)
            if identity in self._moved:
                find(PowerCut.TWICE, identity)
        self._moved |= moved
        executed = Counter(
            each.identity.source
            for each in numbers.values()
            if each.identity is not None and each.stage is Stage.EXECUTED
        )
        for source, count in executed.items():
            if source != "MOE" and count > STEPS:
                find(PowerCut.STEPS, (source, count))
        held = self.bench.executive.mode in {Mode.STOPPED, Mode.SAFE}
        if self._stopped > self._resumed and not held:
            find(PowerCut.RELEASED, self.bench.executive.mode)
        self._sent_before = len(self.bench.received.reports)

    def _noting(self, command: Command) -> Callable[[SubmitResult], None]:
        self._submitted = submitted = self._submitted + 1
        if isinstance(command.request, Resume):
            self._resumed = submitted  # from now on the stops before may be released

        def reply(result: SubmitResult) -> None:
            self.answers += 1
            if isinstance(result, Accepted | Duplicate):
                self._accepted.add(command.identity)
            if isinstance(result, Accepted) and isinstance(command.request, Stop):
                self._stopped = max(self._stopped, submitted)

        return reply

    def _command(self) -> Command:
        """Draw a new command, or one that was sent before."""
        if self._sent and self.random.random() < 0.3:
            return self.random.choice(self._sent[-20:])
        mix, number = self.mix, len(self._sent) + 1
        kinds: dict[Callable[[], Request], int] = {
            lambda: MoveForward(self.random.uniform(0.05, 0.5)): mix.motions,
            lambda: SetTravelSpeed(self.random.uniform(0.1, 0.5)): mix.settings,
            Stop: mix.stops,
            Resume: mix.stops + 1,
            lambda: self._new_plan(number): mix.plans,
            lambda: ActivatePlan(self._plan): 2 * mix.plans,
            lambda: SuspendPlan(self._plan): 2 * mix.plans,
            lambda: ResumePlan(self._plan): 4 * mix.plans,
        }
        (draw,) = self.random.choices(list(kinds), list(kinds.values()))
        command = Command(Identity("MOE", number), draw(), "direct")
        self._sent.append(command)
        return command

    def _new_plan(self, number: int) -> SubmitPlan:
        self._plan = f"p{number}"
        return SubmitPlan(plan(PLAN, self._plan))

    def _slow_down(self) -> None:
        ledger = self.bench.ledger
        ledger.writer = SlowWriter(
            ledger, ledger.sealed, self.bench.clock.now_s, drawn(self.random, *COMMIT_S)
        )


def _all_reports(bench: Bench) -> list[Report]:
    return list(bench.ledger.reports(1, count=10**6))


def measure(kills: int, seed: int, log: Log) -> list[Figure]:
    """Return how often a promise was broken over this many power cuts in each mix."""
    figures = []
    for mix in MIXES:
        random = Random(f"{mix.name} {seed}")
        with tempfile.TemporaryDirectory() as folder:
            rig = PowerCuts(Path(folder), random, mix, log)
            for _ in range(kills):
                rig.run()
            rig.bench.executive.simulate_crash()
        beside = f"{kills} power cuts, {rig.answers} answers, simulated time"
        figures += rig.findings.figures(f"power cuts, {mix.name}", PowerCut, beside)
    return figures
