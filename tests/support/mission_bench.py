"""The twelve missions of `config/plans/missions`, on a rover without physics, past their waits.

A situation is a mission with the events that decide its branches: voltages, a camera that fails,
a lost link, answers. They depend on the stored reports and the time only, so that a run that was
interrupted meets the same ones.
"""

from calendar import timegm
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import strptime
from typing import Any, Final

from executive.commands import (
    ActivatePlan,
    AnswerQuestion,
    Command,
    PlanDefinition,
    Request,
    ResumePlan,
    SubmitPlan,
)
from executive.commands.lifecycle import Accepted, Duplicate
from executive.obstacles.zones import KeepOut, Zones
from executive.plans import FORMAT, PlanNode
from executive.plans.active_run import ActiveRun
from executive.record import Ledger, Synchronous
from executive.record.writer import Batch, InlineWriter, WriterState
from executive.settings import Settings
from executive.values.clock import ManualClock
from executive.values.reasons import Reason
from executive.values.reports import Identity, PlanStatus, Report, Stage
from tests.support.kinematic import STEP_S, KinematicRover, ignoring
from tests.support.plans import PlanBench
from trees.plan import PlanBehaviour, PlanTree

FOLDER: Final = Path(__file__).parents[2] / "config/plans/missions"
PLAN_ID: Final = "day"
ANSWER_S: Final = 30.0
"""Time until the operators answer a question."""
LINK: Final = "operators"
"""A link whose commands do not count as contact with the ground."""
ACTIVATE: Final = Identity("MOE", 2)
_RESUMES: Final = '<root after_restart="resume" '
Statuses = str
Cells = tuple[Any, ...]


def utc(text: str) -> float:
    """Return a time of day on 2026-11-27, or a date with one, in seconds since 1970-01-01 UTC."""
    stamp = text if "T" in text else f"2026-11-27T{text}:00Z"
    return float(timegm(strptime(stamp, "%Y-%m-%dT%H:%M:%SZ")))


class MissionClock(ManualClock):
    """A manual clock that starts at a given time."""

    def __init__(self, start_utc_s: float) -> None:
        super().__init__()
        self._start_utc_s = start_utc_s

    def utc_s(self) -> float:
        return self._start_utc_s + self.now_s()


@dataclass(frozen=True, slots=True)
class Situation:
    """A mission and what happens in it.

    Attributes:
        file: begin of the name of the mission's file.
        edits: texts of the mission and their replacements: shorter times.
        voltage_v, camera, link: of the rover, at any time of the run.
        answer: of the operators to each question; None if they do not answer.
        blocked: corners of a zone that the rover may not enter, m.
        rounds: whether the time limit decides how often something is repeated.
        parallel: whether two branches may end in either order.
    """

    name: str
    file: str
    start: str = "09:00"
    edits: tuple[tuple[str, str], ...] = ()
    voltage_v: "Callable[[MissionBench], float]" = lambda _: 26.0
    camera: "Callable[[MissionBench], bool]" = lambda _: True
    link: "Callable[[MissionBench], bool]" = lambda _: True
    answer: str | None = None
    blocked: tuple[tuple[float, float], ...] = ()
    rounds: bool = False
    parallel: bool = False

    def plan(self, resumes: bool) -> PlanDefinition:
        """Return the mission as submitted."""
        (path,) = FOLDER.glob(f"{self.file}-*.xml")
        text = path.read_text(encoding="utf-8")
        for old, new in self.edits:
            assert old in text, (path, old)
            text = text.replace(old, new)
        text = text.replace("<root ", _RESUMES) if resumes else text
        return PlanDefinition(PLAN_ID, self.name, FORMAT, text.encode())

    def settings(self) -> Settings:
        """Return the settings of the rover."""
        settings = ignoring("odometry_rate_low")  # in a wait that is passed over there is none
        if not self.blocked:
            return settings
        return replace(settings, zones=Zones(keep_out=(KeepOut("blocked", self.blocked),)))


def _square(x_m: float, y_m: float, half_m: float = 0.4) -> tuple[tuple[float, float], ...]:
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return tuple((x_m + half_m * each, y_m + half_m * other) for each, other in corners)


def _charging(bench: "MissionBench") -> float:
    """Return a low voltage for half an hour after the first leg."""
    return 22.5 if bench.done >= 1 and bench.utc_s < bench.done_utc_s(1) + 1800 else 26.0


def _hill(bench: "MissionBench") -> bool:
    """Return whether there is a link: it is lost behind the hill, and returns after a minute."""
    if bench.done:
        return bench.utc_s > bench.done_utc_s(1) + 60
    return bench.utc_s < bench.activated_utc_s + 1


_SILENT: Final = (("LINK_SILENT_S &lt; 600", "LINK_SILENT_S &lt; 11"), ("10,4", "10,4;80,4"))
"""With a path that is long enough for this silence after each of several restarts."""
_PATROL: Final = (('msec="7200000"', 'msec="60000"'),)
_WATCH: Final = (('num_cycles="12"', 'num_cycles="3"'),)

SITUATIONS: Final = (
    Situation("outcrop", "01"),
    Situation("outcrop, low battery", "01", voltage_v=lambda b: 23.0 if b.done >= 5 else 26.0),
    Situation("outcrop, too late", "01", start="14:30"),
    Situation("outcrop, a picture fails", "01", camera=lambda b: b.done != 3 or b.failed > 0),
    Situation("passes", "02", link=lambda b: b.utc_s > utc("10:14")),
    Situation("passes, the first missed", "02", link=lambda b: b.utc_s > utc("12:06")),
    Situation("viewpoint", "03"),
    Situation("viewpoint, rim blocked", "03", blocked=_square(8, 3)),
    Situation("ditch, crossed", "04", answer="cross"),
    Situation("ditch, stays", "04", answer="stay"),
    Situation("ditch, no answer", "04"),
    Situation("traverse", "05"),
    Situation("traverse, charges", "05", voltage_v=_charging),
    Situation("night", "06", start="17:00"),
    Situation(
        "night, cold",
        "06",
        start="17:00",
        voltage_v=lambda b: 23.0 if b.utc_s > utc("2026-11-28T05:00:00Z") else 26.0,
    ),
    Situation("stake", "07", edits=_WATCH),
    Situation("stake, a picture fails", "07", edits=_WATCH, camera=lambda b: b.failed > 0),
    Situation("patrol", "08", edits=_PATROL, rounds=True),
    Situation("patrol, a point blocked", "08", edits=_PATROL, rounds=True, blocked=_square(2, 2)),
    Situation("stow", "09"),
    Situation("stow, a picture fails", "09", camera=lambda b: b.done < 3),
    Situation("hill", "10"),
    Situation("hill, link lost", "10", edits=_SILENT, link=_hill),
    Situation("marks, believed", "11", answer="yes"),
    Situation("marks, no answer", "11"),
    Situation("two things", "12", parallel=True),
    Situation("two things, a picture fails", "12", camera=lambda b: b.failed > 0, parallel=True),
)


@dataclass(frozen=True, slots=True)
class Change:
    """State of a plan's tree after a tick.

    Attributes:
        waits: kinds of the nodes that wait.
    """

    utc_s: float
    statuses: Statuses
    cells: Cells
    waits: tuple[str, ...] = ()

    @property
    def tree(self) -> tuple[Statuses, Cells]:
        """Statuses and blackboard."""
        return self.statuses, self.cells


@dataclass(frozen=True, slots=True)
class World:
    """All that remains after the process was killed, without the files.

    Attributes:
        changes: number of changes of the trace that are on the disk, or will be.
    """

    rover: KinematicRover
    now_s: float
    changes: int


class _Writer:
    """Commits at once, and reports it before and after."""

    def __init__(self, ledger: Ledger, bench: "MissionBench") -> None:
        self._inline, self._bench = InlineWriter(ledger), bench

    def put(self, batch: Batch) -> None:
        self._bench.on_commit(batch, committed=False)
        self._inline.put(batch)
        self._bench.on_commit(batch, committed=True)

    def poll(self) -> WriterState:
        return self._inline.poll()

    def close(self) -> None:
        self._inline.close()

    def abandon(self) -> None:
        self._inline.abandon()


@dataclass(slots=True)
class _Seen:
    """What the stored reports show."""

    count: int = 0
    done: list[float] = field(default_factory=list)
    executed: Counter[str] = field(default_factory=Counter)
    failed: int = 0
    activated_utc_s: float = float("inf")
    questions: dict[str, float] = field(default_factory=dict)


class MissionBench(PlanBench):
    """A rover on a mission.

    Args:
        folder: of the ledger.
        situation: the mission.
        resumes: whether the plan continues by itself after a restart.
        world: of a process that was killed; None for a new one.
        watch: called before and after each commit, with whether it is done.

    Attributes:
        trace: each change of the plan's tree.
    """

    def __init__(
        self,
        folder: Path,
        situation: Situation,
        resumes: bool,
        world: World | None = None,
        watch: "Callable[[MissionBench, Batch, bool], None]" = lambda *_: None,
    ) -> None:
        clock = MissionClock(utc(situation.start))
        clock.set(0.0 if world is None else world.now_s)
        self.situation, self.resumes, self.watch = situation, resumes, watch
        self.trace: list[Change] = []
        self._seen, self._sent = _Seen(), set[int]()
        rover = KinematicRover(lazy_camera=True) if world is None else deepcopy(world.rover)
        super().__init__(folder, situation.settings(), rover=rover, clock=clock)

    def open_ledger(self) -> Ledger:
        """Open the ledger; each of its commits is watched, and its file stays small."""
        ledger = Ledger(self.folder / "ledger.sqlite", Synchronous.NORMAL)
        ledger.rows("PRAGMA wal_autocheckpoint = 16")
        ledger.writer = _Writer(ledger, self)
        self.received.reports[:] = ledger.reports(1, count=1_000_000)
        return ledger

    def on_commit(self, batch: Batch, committed: bool) -> None:
        """Call the watch."""
        self.watch(self, batch, committed)

    @property
    def utc_s(self) -> float:
        """The time, seconds since 1970-01-01 UTC."""
        return self.clock.utc_s()

    @property
    def seen(self) -> _Seen:
        """What the reports show, once each is taken."""
        seen, reports = self._seen, self.received.reports
        for report in reports[seen.count :]:
            self._take(report, seen)
        seen.count = len(reports)
        return seen

    def _take(self, report: Report, seen: _Seen) -> None:
        identity = report.identity
        if identity is None:
            head, _, rest = report.text.partition(", question ")
            if rest and head == f"plan {PLAN_ID}":
                seen.questions.setdefault(rest.partition(": ")[0], report.utc_s)
        elif (
            report.stage is Stage.EXECUTED and identity.command_id == 2 and identity.source == "MOE"
        ):
            seen.activated_utc_s = report.utc_s
        elif identity.source == f"plan:{PLAN_ID}":
            seen.failed += report.stage is Stage.FAILED and report.reason is not Reason.INTERRUPTED
            if report.stage is Stage.EXECUTED:
                seen.done.append(report.utc_s)
                ((request,),) = self.ledger.rows(
                    "SELECT name || request FROM commands WHERE source = ? AND command_id = ?",
                    (identity.source, identity.command_id),
                )
                seen.executed[request] += 1

    @property
    def done(self) -> int:
        """Number of the plan's commands that were executed."""
        return len(self.seen.done)

    def done_utc_s(self, number: int) -> float:
        """Return when the first, second, ... command was executed."""
        return self.seen.done[number - 1]

    @property
    def failed(self) -> int:
        """Number of the plan's commands that failed, but for those that were interrupted."""
        return self.seen.failed

    @property
    def activated_utc_s(self) -> float:
        """When the plan was activated."""
        return self.seen.activated_utc_s

    @property
    def plan_status(self) -> PlanStatus | None:
        """Status of the plan; None before it is submitted."""
        found = (each.status for each in self.executive.plans() if each.plan_id == PLAN_ID)
        return next(found, None)

    @property
    def run_of_plan(self) -> ActiveRun | None:
        """The running plan, if any."""
        run: ActiveRun | None = self.executive._planner._run
        return run

    def order(self, request: Request, number: int) -> bool:
        """Send a command, again under the same number if there was no answer; whether it counts."""
        if number in self._sent:
            return True
        command = Command(Identity("MOE", number), request, LINK)
        if isinstance(self.send(command), Accepted | Duplicate):
            self._sent.add(number)
        return number in self._sent

    def resume(self, number: int) -> None:
        """Resume the plan."""
        assert self.order(ResumePlan(PLAN_ID), number)

    def proceed(self) -> None:
        """Let the operators do what is due, then one tick pass, or a wait until its end."""
        situation, sent = self.situation, len(self._sent)
        if 1 not in self._sent:
            self.order(SubmitPlan(situation.plan(self.resumes)), 1)
        if 2 not in self._sent:
            self.order(ActivatePlan(PLAN_ID), 2)
        for number, (key, opened_s) in enumerate(self.seen.questions.items()):
            if situation.answer is not None and self.utc_s >= opened_s + ANSWER_S:
                self.order(AnswerQuestion(PLAN_ID, key, situation.answer), 10 + number)
        if len(self._sent) == sent:
            self._jump()
        self.step()
        self.note()

    def step(self) -> None:
        """Let one tick pass."""
        situation = self.situation
        self.voltage_v = situation.voltage_v(self)
        self.rover.camera_works = situation.camera(self)
        if situation.link(self):
            self.executive.ground.record_contact()
        super().step()

    def note(self) -> None:
        """Add the state of the plan to the trace, if it has changed."""
        run = self.run_of_plan
        if run is None:
            return
        state = run.tree.state()
        if not self.trace or self.trace[-1].tree != (state.statuses, state.cells):
            waits = tuple(
                node.plan.kind.name
                for node, letter in zip(_nodes(run), state.statuses, strict=True)
                if letter == "R" and node.waits
            )
            self.trace.append(Change(self.utc_s, state.statuses, state.cells, waits))

    def _jump(self) -> None:
        """Pass a wait of the plan up to two ticks before its end."""
        run = self.run_of_plan
        if run is None or self.executive.goal_count or not run.tree.waits():
            return
        left_s = min(self._ends(run), default=0.0) - self.utc_s - 2 * STEP_S
        if left_s > 1.0:
            self.clock.advance(left_s)
            self.executive._reactions._ticked_s = self.clock.now_s()  # no tick was late

    def _ends(self, run: ActiveRun) -> Iterator[float]:
        """Yield the times until which nothing happens."""
        state, start_s = run.tree.state(), self.utc_s - self.clock.now_s()
        yield from (start_s + each for each in state.timers if each is not None)
        for node, letter in zip(_nodes(run), state.statuses, strict=True):
            if letter == "R":
                plan: PlanNode = node.plan
                names = (name for name in ("utc", "from", "until") if name in plan.ports)
                yield from (at for name in names if (at := plan.number(name)) > self.utc_s)
                if (until_utc_s := getattr(node, "until_utc_s", None)) is not None:
                    yield until_utc_s
        for opened_s in self.seen.questions.values():
            if self.utc_s < opened_s + ANSWER_S:
                yield opened_s + ANSWER_S
        for text in ("10:14", "12:06", "2026-11-28T05:00:00Z"):
            if self.utc_s < utc(text) + 2 * STEP_S:
                yield utc(text) + 2 * STEP_S
        if self.done:
            yield from (
                end for s in (60, 1800) if (end := self.done_utc_s(1) + s + 2 * STEP_S) > self.utc_s
            )


def _nodes(run: ActiveRun) -> tuple[PlanBehaviour, ...]:
    assert isinstance(run.tree, PlanTree)
    return run.tree.nodes
