"""`try_once`: one run of a plan in lock step, with drawn conditions and drawn answers."""

import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from executive.commands import (
    ActivatePlan,
    AnswerQuestion,
    Command,
    PlanDefinition,
    SubmitPlan,
)
from executive.obstacles.zones import Footprint
from executive.plans import PlanRoot, check_plan, nodes
from executive.settings import SettingsError, load_yaml
from executive.values.clock import START_UTC_S
from executive.values.plan_nodes import PlanNodeReport, Question
from executive.values.reasons import Refusal
from executive.values.reports import Identity, PlanStatus, PlanUpdate, Stage
from sim.campaign.draws import draw
from sim.campaign.model import Campaign, Variation
from sim.rover.lockstep import LockStep
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import LockstepRun, run_in_lock_step
from sim.scenario.model import RunMode, Scenario, Send
from sim.scenario.outcome import digest_of
from sim.scenario.reading import read_scenario, scenario_path
from sim.scenario.record import Record, SentCommand
from sim.trial.choices import Choices, CountingTree

BEGIN_S: Final = 1.0
"""Time of the submission after the start; the sensors have then been measured."""
BEGINS_BEFORE_S: Final = 60.0
"""Time of the begin before the first absolute time in a plan, unless it is given; chosen."""
SUSPENDED_S: Final = 65.0
"""Suspension after which a run ends: later than a plan continues by itself after a restart."""
REFUSED_S: Final = 2.0
"""Time after which a plan that was not activated has been refused."""
MAX_ANSWER_S: Final = 600.0
"""Maximum time to an answer of a question without a deadline; chosen."""
_FLAT: Final[dict[str, Any]] = {
    "title": "plan",
    "duration": 3600,
    "expect": [{"rover": "stationary", "for": 1}],
}
"""Scenario without a file."""
OPERATOR: Final = "MOE"
ANSWERS_FROM: Final = 1_000_000
"""Minimum number of a drawn answer; commands of a scenario have smaller ones."""
_AFTER_S: Final = {
    PlanStatus.COMPLETED: 0.0,
    PlanStatus.FAILED: 0.0,
    PlanStatus.ABORTED: 0.0,
    PlanStatus.SUSPENDED: SUSPENDED_S,
}
"""Time from a status of the plan to the end of the run."""


Floats = NDArray[np.float64]


class PlanRefusedError(Exception):
    """The rover would refuse the plan; the text is the refusal."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A plan, and the conditions of its runs.

    Attributes:
        scenario: path of a scenario, or its name in config/scenarios; None for flat ground.
        changes: overrides of the scenario in all runs.
        vary: varied keys of the scenario.
        seed: seed of all draws.
        begin_utc_s: UTC of the begin; None for one minute before the first time in the plan.
        limit_s: maximum simulated duration of a run.
    """

    plan: PlanDefinition
    asset: str | None = None
    scenario: str | None = None
    changes: tuple[Override, ...] = ()
    vary: tuple[Variation, ...] = ()
    seed: int = 0
    begin_utc_s: float | None = None
    limit_s: float = 172_800.0

    def scenario_of(self, number: int) -> Scenario:
        """Return the scenario of a draw; it submits and activates the plan.

        Raises:
            SettingsError: a value does not fit.
        """
        raw: Any = _FLAT
        path = Path(self.plan.plan_id)
        if self.scenario is not None:
            path = scenario_path(self.scenario)
            raw = load_yaml(path)
        drawn = draw(self._campaign, number).changes
        asset = () if self.asset is None else (Override("asset", self.asset),)
        scenario = read_scenario(raw, path, RunMode.LOCK_STEP, (*asset, *self.changes, *drawn))
        sent = (SubmitPlan(self.plan), ActivatePlan(self.plan.plan_id))
        entries = tuple(Send(at_s=BEGIN_S, command=each) for each in sent)
        timeline = (*scenario.timeline, *entries)
        title = self.plan.plan_id
        return replace(scenario, title=title, timeline=timeline, duration_s=self.limit_s)

    @property
    def _campaign(self) -> Campaign:
        return Campaign(
            title="", scenarios=("",), runs=1, seed=self.seed, vary=self.vary, criteria=()
        )


@dataclass(frozen=True, slots=True)
class TrialResult:
    """Result of a run.

    Attributes:
        draw: its number.
        status: status of the plan at the end.
        reason: text of its last report.
        duration_s: time from the begin to the end of the plan.
        energy_j: energy drawn from the battery in the run.
        clearance_m: minimum distance of the rover from a rock, a wall or a step; None without.
        digest: digest of all events; equal for runs that are identical bit for bit.
        nodes: nodes of the plan at the end; empty after a refusal.
        choices: number of the node, choice, and how often it was chosen.
    """

    draw: int
    status: PlanStatus
    reason: str
    duration_s: float
    energy_j: float
    clearance_m: float | None
    digest: str
    nodes: tuple[PlanNodeReport, ...]
    choices: tuple[tuple[int, str, int], ...]

    @property
    def completed(self) -> bool:
        """Whether the plan was completed."""
        return self.status is PlanStatus.COMPLETED


def checked_plan(trial: Trial) -> PlanRoot:
    """Return the plan of a trial, as the first draw's rover reads it.

    Raises:
        PlanRefusedError: it would be refused.
        SettingsError: a value of the scenario does not fit.
    """
    root = check_plan(trial.plan, trial.scenario_of(0).settings)
    if isinstance(root, Refusal):
        raise PlanRefusedError(f"{root.reason.value} {root.reason.name}: {root.text}")
    return root


def begin_utc_s(plan: PlanRoot, given_utc_s: float | None) -> float:
    """Return the begin of a plan: the given one, or shortly before its first absolute time."""
    if given_utc_s is not None:
        return given_utc_s
    ports = [each.ports.get(name) for each in nodes(plan) for name in ("utc", "from", "until")]
    times = [float(each) for each in ports if isinstance(each, float | int)]
    return min(times) - BEGINS_BEFORE_S if times else START_UTC_S


def try_once(trial: Trial, number: int, out: Path | None = None) -> TrialResult:
    """Run a draw; with a folder, write map, timeline and reports into it.

    Raises:
        SettingsError: a value does not fit.
    """
    scenario, choices = trial.scenario_of(number), Choices()
    root = check_plan(trial.plan, scenario.settings)
    if isinstance(root, Refusal):
        raise SettingsError(f"draw {number}: the plan is refused: {root.text}")
    ends: list[_PlanEnd] = []

    def run(scenario: Scenario, lock: LockStep, record: Record) -> LockstepRun:
        return _TrialRun(scenario, lock, record, (trial.seed, number), ends)

    with tempfile.TemporaryDirectory(prefix="rover-try-") as folder:
        record = run_in_lock_step(
            scenario,
            Path(folder),
            start_utc_s=begin_utc_s(root, trial.begin_utc_s) - BEGIN_S,
            build_tree=partial(CountingTree, choices),
            run=run,
            skips=True,
        )
        if out is not None:
            from sim.scenario.pictures import write_run

            out.mkdir(parents=True, exist_ok=True)
            write_run(out, scenario, record)
    last, nodes_at_end = ends[0]
    status, reason = last.status, last.text
    if status is PlanStatus.SUBMITTED:
        refusals = [each.text for each in record.reports if each.stage is Stage.REJECTED]
        reason = f"refused: {refusals[-1] if refusals else 'no contact'}"
    return TrialResult(
        draw=number,
        status=status,
        reason=reason,
        duration_s=max(0.0, round(record.since_start_s(last.utc_s) - BEGIN_S, 3)),
        energy_j=record.energy_j or 0.0,
        clearance_m=_clearance_m(scenario, record),
        digest=digest_of(record),
        nodes=nodes_at_end,
        choices=tuple((*key, count) for key, count in sorted(choices.items())),
    )


_PlanEnd = tuple[PlanUpdate, tuple[PlanNodeReport, ...]]


@dataclass(frozen=True, slots=True)
class _DrawnAnswer:
    """An answer, and its time on the clock; infinite if none is given."""

    option: str
    at_s: float


class _TrialRun(LockstepRun):
    """A run that ends with its plan. An operator answers its questions while the link is up.

    Args:
        seeds: seeds of the answers.
        ends: receives the end of the plan.
    """

    def __init__(
        self,
        scenario: Scenario,
        lock: LockStep,
        record: Record,
        seeds: tuple[int, int],
        ends: list[_PlanEnd],
    ) -> None:
        super().__init__(scenario, lock, record)
        self._plan_id, self._seeds, self._ends = scenario.title, seeds, ends
        self._answers: dict[Question, _DrawnAnswer] = {}
        self._openings: Counter[str] = Counter()

    def run(self) -> None:
        """Run to the end, and note how the plan ended."""
        super().run()
        nodes_at_end = self._lock.executive.plan_nodes(self._plan_id)
        known = () if isinstance(nodes_at_end, Refusal) else tuple(nodes_at_end)
        self._ends.append((self._last, known))

    @property
    def _last(self) -> PlanUpdate:
        """The last update of the plan, also if it was sent while the link was down."""
        updates = reversed(self._lock.downlink_record.plans)
        none = PlanUpdate(
            self._plan_id, PlanStatus.SUBMITTED, self._record.start_utc_s, "", 0, 0, ""
        )
        return next((each for each in updates if each.plan_id == self._plan_id), none)

    @property
    def has_ended(self) -> bool:
        """Whether the plan has ended, or is suspended for good."""
        last = self._last
        if last.status is PlanStatus.SUBMITTED:
            return self._lock.time_s > BEGIN_S + REFUSED_S
        return self._lock.clock.utc_s() - last.utc_s > _AFTER_S.get(last.status, inf)

    def observe(self) -> None:
        """Draw answers to the questions opened in this tick, and send those that are due."""
        super().observe()
        now_s = self._lock.time_s
        opened = self._lock.executive.plan_questions.get(self._plan_id, ())
        self._answers = {each: self._answers.get(each) or self._draw(each) for each in opened}
        due = next((each for each in opened if self._answers[each].at_s <= now_s), None)
        if due is not None and self.in_contact:
            self._send_answer(due, self._answers.pop(due).option)

    def _draw(self, question: Question) -> _DrawnAnswer:
        """Return the answer to a question that has been opened.

        Each option is as likely as no answer before the deadline; without one there is an answer.
        """
        self._openings[question.key] += 1
        own = crc32(question.key.encode()), self._openings[question.key]
        random = np.random.default_rng([*self._seeds, *own])
        options, latest_s = [*question.options], MAX_ANSWER_S
        if question.until_utc_s is not None:
            options.append("")
            latest_s = max(0.0, question.until_utc_s - self._lock.clock.utc_s())
        option = options[int(random.integers(len(options)))]
        at_s = self._lock.time_s + float(random.uniform(0.0, latest_s))
        return _DrawnAnswer(option, at_s if option else inf)

    def _send_answer(self, question: Question, option: str) -> None:
        number = ANSWERS_FROM + len(self._record.sendings)
        identity = Identity(OPERATOR, number)
        request = AnswerQuestion(self._plan_id, question.key, option)
        utc_s = self._lock.clock.utc_s()
        sent = self.submit(Command(identity, request, RunMode.LOCK_STEP.link, utc_s))
        label = f"answer {number}"
        self._record.sendings.append(SentCommand(label, identity, self._lock.time_s, sent))

    def next_event_s(self) -> float:
        """Return the time of the next event; also of an answer."""
        return min((super().next_event_s(), *(each.at_s for each in self._answers.values())))


def _clearance_m(scenario: Scenario, record: Record) -> float | None:
    """Return the minimum distance between the rover's outline and an obstacle; None without one."""
    world, footprint = scenario.world, scenario.settings.footprint or Footprint(0.01, 0.01)
    half_m = np.array([footprint.length_m, footprint.width_m]) / 2
    poses = {(seen.pose.x_m, seen.pose.y_m, seen.pose.heading_rad): None for seen in record.poses}
    x_m, y_m, heading_rad = np.array(list(poses)).T
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    areas = [*(wall.area for wall in world.walls), *world.steps]
    points = [(each.x_m, each.y_m, each.radius_m) for each in world.all_rocks]
    points += [(corner.x_m, corner.y_m, 0.0) for each in areas for corner in each.corners]
    gaps_m = []
    for point_x_m, point_y_m, radius_m in points:
        dx_m, dy_m = point_x_m - x_m, point_y_m - y_m
        along_m, across_m = dx_m * cosine + dy_m * sine, dy_m * cosine - dx_m * sine
        gaps_m.append(_outside_m(along_m, across_m, half_m).min() - radius_m)
    for area in areas:
        own_m = np.array([area.length_m, area.width_m]) / 2
        for ahead, left in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            ahead_m, left_m = half_m * (ahead, left)
            corner_x_m = x_m + ahead_m * cosine - left_m * sine
            corner_y_m = y_m + ahead_m * sine + left_m * cosine
            gaps_m.append(_outside_m(*area.local(corner_x_m, corner_y_m), own_m).min())
    return max(0.0, float(min(gaps_m))) if gaps_m else None


def _outside_m(along_m: Floats, across_m: Floats, half_m: Floats) -> Floats:
    """Return the distances of positions from a rectangle about the origin; 0 within it."""
    along_m, across_m = abs(along_m) - half_m[0], abs(across_m) - half_m[1]
    return np.hypot(np.maximum(along_m, 0.0), np.maximum(across_m, 0.0))
