"""How long and how precisely a controller drives to poses, against the best known times."""

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from math import degrees, hypot, inf, isfinite
from pathlib import Path
from time import process_time
from typing import Any, Final

from executive.commands.catalogue import Command, MoveTo, Waypoint
from executive.geometry import wrap_rad
from executive.motion import Plan, Problem, make_solver
from executive.reports import Identity, Stage
from executive.settings import Controller as Choice
from executive.settings import Profile, Settings
from executive.settings_files import SettingsError, structure
from sim.rover import World
from sim.rover.lockstep import LockStep
from tests.support.figures import Figure, Goal, quantile

OWN_GOALS: Final = Path(__file__).with_name("goals.json")


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """The limits under which the best known times were found."""

    travel_speed_mps: float
    rotate_speed_radps: float
    travel_acceleration_mps2: float
    rotate_acceleration_radps2: float


@dataclass(frozen=True, slots=True)
class DriveGoal:
    """A pose to reach from the origin, from rest to rest."""

    id: str
    x_m: float
    y_m: float
    heading_rad: float
    best_known_time_s: float


@dataclass(frozen=True, slots=True)
class Goals:
    """What a goals file holds."""

    limits: MotionLimits
    goals: tuple[DriveGoal, ...]


def read_goals(path: Path) -> Goals:
    """Return the goals of a file.

    Raises:
        SettingsError: the file cannot be read, is no JSON, or lacks a goal's figures.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise SettingsError(f"{path}: is not JSON ({error})") from error
    if not isinstance(raw, dict):
        raise SettingsError(f"{path}: must be an object with limits and goals")
    rows = raw.get("goals")
    if not isinstance(rows, list) or not rows:
        raise SettingsError(f"{path}: goals must be a list of one goal at least")
    known = {"limits": raw.get("limits"), "goals": [_only_known(row) for row in rows]}
    goals = structure(known, Goals, str(path))
    for name in MotionLimits.__slots__:
        if not 0.0 < getattr(goals.limits, name) < inf:
            raise SettingsError(f"{path}: limits.{name} must be above 0")
    for goal in goals.goals:
        figures = (goal.x_m, goal.y_m, goal.heading_rad, goal.best_known_time_s)
        if not all(isfinite(figure) for figure in figures) or goal.best_known_time_s <= 0:
            raise SettingsError(f"{path}: goal {goal.id} has a figure that cannot be")
    return goals


def _only_known(row: Any) -> Any:
    fields = DriveGoal.__slots__
    return {k: v for k, v in row.items() if k in fields} if isinstance(row, dict) else row


LIMIT_S = 120.0
REST_S = 0.5
WITHIN_M = 0.03
WITHIN_DEG = 2.0


class Controller(Enum):
    """The controllers that can be measured."""

    TURN_DRIVE = "turn-drive"
    TURN_DRIVE_TRAPEZOID = "turn-drive-trapezoid"
    MPC = "mpc"


_CHOSEN = {
    Controller.TURN_DRIVE: (Choice.TURN_DRIVE, Profile.SQUARE_ROOT),
    Controller.TURN_DRIVE_TRAPEZOID: (Choice.TURN_DRIVE, Profile.TRAPEZOID),
    Controller.MPC: (Choice.MPC, Profile.SQUARE_ROOT),
}

_TRUE_CM = {
    Controller.TURN_DRIVE: 2.0,
    Controller.TURN_DRIVE_TRAPEZOID: 2.0,
    Controller.MPC: 6.0,
}
"""Goals of the true error, p95: the side slip of fast curves is not in the odometry."""


class TimedSolver:
    """The solver of plans, with how long each answer took of the process's time.

    Attributes:
        first_s: of the first plans of runs.
        later_s: of all plans after those.
    """

    lead_ticks = 0
    busy = False

    def __init__(self, settings: Settings) -> None:
        self._solver = make_solver(settings)
        self.first_s: list[float] = []
        self.later_s: list[float] = []

    def ask(self, problem: Problem) -> None:
        """Solve a problem, and note how long it took."""
        began_s = process_time()
        self._solver.ask(problem)
        took_s = process_time() - began_s
        (self.first_s if problem.guess is None else self.later_s).append(took_s)

    def answer(self) -> Plan | None:
        """Return the answer to the last problem."""
        return self._solver.answer()


@dataclass(frozen=True, slots=True)
class Run:
    """One goal driven.

    Attributes:
        done: whether the command was EXECUTED.
        time_s: until then, with the process's time of the first plan, which simulated time lacks.
        seen_error_m, seen_error_rad: from the goal, by odometry, standing.
        true_error_m, true_error_rad: from the goal, in truth, standing.
    """

    goal: DriveGoal
    done: bool
    time_s: float
    seen_error_m: float
    seen_error_rad: float
    true_error_m: float
    true_error_rad: float


def tune(goals: Goals, controller: Controller, settings: Settings) -> Settings:
    """Return the settings with the limits of the goals and what drives."""
    choice, profile = _CHOSEN[controller]
    return replace(
        settings,
        controller=choice,
        drive=replace(
            settings.drive,
            travel_speed_mps=goals.limits.travel_speed_mps,
            rotate_speed_radps=goals.limits.rotate_speed_radps,
            travel_acceleration_mps2=goals.limits.travel_acceleration_mps2,
            rotate_acceleration_radps2=goals.limits.rotate_acceleration_radps2,
        ),
        turn_drive=replace(settings.turn_drive, profile=profile),
    )


def drive(goals: Goals, settings: Settings, solver: TimedSolver | None = None) -> Iterator[Run]:
    """Drive each goal from the origin on flat ground, in lock step."""
    for seed, goal in enumerate(goals.goals):
        with tempfile.TemporaryDirectory() as folder:
            before_s = 0.0 if solver is None else sum(solver.first_s)
            run = _drive_one(goal, LockStep(settings, World(), Path(folder), seed, solver=solver))
            planned_s = 0.0 if solver is None else sum(solver.first_s) - before_s
            yield replace(run, time_s=run.time_s + planned_s)


def _drive_one(goal: DriveGoal, lockstep: LockStep) -> Run:
    lockstep.run(REST_S)
    began_s = lockstep.time_s
    target = Waypoint(goal.x_m, goal.y_m, goal.heading_rad)
    lockstep.submit(Command(Identity("bench", 1), MoveTo(target), "direct"))
    lockstep.run_until(lambda: _stage(lockstep).terminal, LIMIT_S)
    time_s = lockstep.time_s - began_s
    done = _stage(lockstep) is Stage.EXECUTED
    lockstep.run(REST_S)
    seen, true = lockstep.executive.status.pose, lockstep.rover.true_pose
    lockstep.executive.abandon()
    return Run(
        goal,
        done,
        time_s,
        hypot(seen.x_m - goal.x_m, seen.y_m - goal.y_m),
        abs(wrap_rad(seen.heading_rad - goal.heading_rad)),
        hypot(true.x_m - goal.x_m, true.y_m - goal.y_m),
        abs(wrap_rad(true.heading_rad - goal.heading_rad)),
    )


def _stage(lockstep: LockStep) -> Stage:
    stages = [report.stage for report in lockstep.heard.reports if report.stage is not None]
    return stages[-1] if stages else Stage.RECEIVED


def measure(
    goals: Goals,
    controller: Controller,
    settings: Settings,
    ratio_goal: float,
    tell: Callable[[str], None],
) -> list[Figure]:
    """Return the figures of a controller over goals.

    Args:
        goals: what to drive to, under which limits.
        controller: what drives.
        settings: the asset.
        ratio_goal: greatest sum of times over the sum of best known times.
        tell: called with a line after each goal.
    """
    runs = []
    tuned = tune(goals, controller, settings)
    solver = TimedSolver(tuned) if controller is Controller.MPC else None
    for run in drive(goals, tuned, solver):
        runs.append(run)
        tell(
            f"{run.goal.id}: {'done' if run.done else 'NOT DONE'} in {run.time_s:.2f} s (best known"
            f" {run.goal.best_known_time_s:.2f} s), true error {100 * run.true_error_m:.2f} cm"
        )
    reached = [
        run
        for run in runs
        if run.done and run.seen_error_m <= WITHIN_M and degrees(run.seen_error_rad) <= WITHIN_DEG
    ]
    ratios = [run.time_s / run.goal.best_known_time_s for run in runs]
    sum_ratio = sum(run.time_s for run in runs) / sum(r.goal.best_known_time_s for r in runs)
    best = "best known times"
    truth = "the simulated truth"
    true_m = [run.true_error_m for run in runs]
    true_deg = [degrees(run.true_error_rad) for run in runs]
    name = controller.value
    count = len(runs)
    driven = [
        Figure(f"{name}: goals done, to 3 cm and 2°", len(reached), "goals", f"{count} goals",
               Goal(count, at_least=True)),
        Figure(f"{name}: sum of times", sum_ratio, "ratio", best, Goal(ratio_goal)),
        Figure(f"{name}: time, median", quantile(ratios, 0.5), "ratio", best),
        Figure(f"{name}: time, worst", max(ratios), "ratio", best),
        Figure(f"{name}: true error, median", 100 * quantile(true_m, 0.5), "cm", truth),
        Figure(f"{name}: true error, p95", 100 * quantile(true_m, 0.95), "cm", truth,
               Goal(_TRUE_CM[controller])),
        Figure(f"{name}: true error, worst", 100 * max(true_m), "cm", truth),
        Figure(f"{name}: true heading error, p95", quantile(true_deg, 0.95), "deg", truth),
    ]  # fmt: skip
    return driven if solver is None else [*driven, *_planning(name, solver)]


def _planning(name: str, solver: TimedSolver) -> list[Figure]:
    """Return how much of the process's time the plans took."""
    first_ms = [1000 * each for each in solver.first_s]
    later_ms = [1000 * each for each in solver.later_s]
    cpu = "process time"
    return [
        Figure(f"{name}: first plan, median", quantile(first_ms, 0.5), "ms", cpu),
        Figure(f"{name}: first plan, worst", max(first_ms), "ms", cpu),
        Figure(f"{name}: plan of a tick, median", quantile(later_ms, 0.5), "ms", cpu),
        Figure(f"{name}: plan of a tick, p99", quantile(later_ms, 0.99), "ms", cpu, Goal(20.0)),
        Figure(f"{name}: plan of a tick, worst", max(later_ms), "ms", cpu, Goal(35.0)),
    ]
