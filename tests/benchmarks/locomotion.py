"""How long and how precisely a controller drives to poses, against the best known times."""

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import degrees, hypot, radians
from pathlib import Path
from time import process_time
from typing import Any, Final

from executive.commands.catalogue import Command, MoveTo, Waypoint
from executive.motion import SharedSolver, Trajectory, TrajectoryProblem, make_solver
from executive.motion.locomotion import Bounds
from executive.motion.velocity_control import VelocityDriver
from executive.settings import Controller as Choice
from executive.settings import Settings, SettingsError, structure
from executive.state import Status
from executive.values.clock import ManualClock
from executive.values.geometry import STANDING, Point, Pose, Velocity, wrap_rad
from executive.values.reports import Identity, Stage
from sim.rover import World
from sim.rover.jackal import SimulatedJackal
from sim.rover.lockstep import STEP_S, LockStep
from tests.benchmarks.competitors import COMPETITORS, OWN, Competitor, Seen, Task
from tests.benchmarks.lower_bound import lower_bound_s
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
        if getattr(goals.limits, name) <= 0:
            raise SettingsError(f"{path}: limits.{name} must be above 0")
    for goal in goals.goals:
        if goal.best_known_time_s <= 0:
            raise SettingsError(f"{path}: goal {goal.id}: best_known_time_s must be above 0")
    return goals


def _only_known(row: Any) -> Any:
    fields = DriveGoal.__slots__
    return {k: v for k, v in row.items() if k in fields} if isinstance(row, dict) else row


LIMIT_S = 120.0
REST_S = 0.5
WITHIN_M = 0.03
WITHIN_DEG = 2.0
SHOWN_STEPS: Final = 10
"""Steps of the simulation between the points of a path that are kept."""


class TimedSolver:
    """The solver of plans, with how long each answer took of the process's time.

    Attributes:
        first_s: of the first plans of runs.
        later_s: of all plans after those.
        missed: how many questions had no answer.
    """

    lead_ticks = 0
    busy = False

    def __init__(self, settings: Settings) -> None:
        self._solver = make_solver(settings)
        self.first_s: list[float] = []
        self.later_s: list[float] = []
        self.missed = 0

    def request(self, problem: TrajectoryProblem) -> None:
        """Solve a problem, and note how long it took."""
        began_s = process_time()
        self._solver.request(problem)
        took_s = process_time() - began_s
        (self.first_s if problem.guess is None else self.later_s).append(took_s)

    def take_result(self) -> Trajectory | None:
        """Return the answer to the last problem."""
        plan = self._solver.take_result()
        self.missed += plan is None
        return plan

    def fork(self, apart: bool = False) -> SharedSolver:
        """Return one that is not timed: for predictions."""
        return self._solver.fork(apart)


@dataclass(frozen=True, slots=True)
class Run:
    """One goal driven.

    Attributes:
        done: whether the command was EXECUTED, or a competitor stood there by its odometry.
        time_s: until then, with the process's time of the first plan, which simulated time lacks;
            `LIMIT_S` where it never was.
        bound_s: a time that no rover is faster in that moves as commanded.
        seen_error_m, seen_error_rad: from the goal, by odometry, standing.
        true_error_m, true_error_rad: from the goal, in truth, standing.
        energy_j: what it took of the battery.
        path: where it was in truth.
    """

    goal: DriveGoal
    done: bool
    time_s: float
    bound_s: float
    seen_error_m: float
    seen_error_rad: float
    true_error_m: float
    true_error_rad: float
    energy_j: float
    path: tuple[Point, ...]

    @property
    def reached(self) -> bool:
        """Whether it was done, and stayed there by its odometry."""
        near = self.seen_error_m <= WITHIN_M and degrees(self.seen_error_rad) <= WITHIN_DEG
        return self.done and near


@dataclass(frozen=True, slots=True)
class Measured:
    """What became of one controller's goals.

    Attributes:
        first_s, later_s: process time of its first decisions, or plans, and of all after those.
        missed: ticks without a plan; None where it makes none.
    """

    name: str
    runs: tuple[Run, ...]
    first_s: tuple[float, ...]
    later_s: tuple[float, ...]
    missed: int | None

    @property
    def sum_ratio(self) -> float:
        """The sum of times over that of the best known ones."""
        best_s = sum(run.goal.best_known_time_s for run in self.runs)
        return sum(run.time_s for run in self.runs) / best_s


def tune(goals: Goals, name: str, settings: Settings) -> Settings:
    """Return the settings with the limits of the goals and what drives."""
    own = OWN.get(name, OWN["turn-drive"])
    limits = goals.limits
    return replace(
        settings,
        controller=own.choice,
        drive=replace(
            settings.drive,
            travel_speed_mps=limits.travel_speed_mps,
            rotate_speed_radps=limits.rotate_speed_radps,
            travel_acceleration_mps2=limits.travel_acceleration_mps2,
            rotate_acceleration_radps2=limits.rotate_acceleration_radps2,
        ),
        turn_drive=replace(settings.turn_drive, profile=own.profile),
    )


class _Course:
    """Watches a rover on its way to a goal, and makes up the run."""

    def __init__(self, goal: DriveGoal, rover: SimulatedJackal, settings: Settings) -> None:
        self._goal, self._rover, self._settings = goal, rover, settings
        self._begun_j = rover.energy_j
        self._path: list[Point] = []

    def watch(self) -> None:
        """Note where the rover is, in each step of the simulation."""
        self._path.append(self._rover.true_pose.point)

    def made_up(self, done: bool, time_s: float, energy_j: float, seen: Pose) -> Run:
        """Return the run; the rover stands, `energy_j` was read when it was done."""
        goal, true, drive = self._goal, self._rover.true_pose, self._settings.drive
        ahead_m = self._settings.turn_drive.control_point_m
        bound_s = lower_bound_s(
            _control(Pose(), ahead_m),
            _control(_pose(goal), ahead_m),
            Bounds(drive.travel_speed_mps, drive.travel_acceleration_mps2),
            Bounds(drive.rotate_speed_radps, drive.rotate_acceleration_radps2),
            WITHIN_M,
            radians(WITHIN_DEG),
        )
        return Run(
            goal,
            done,
            time_s,
            bound_s,
            hypot(seen.x_m - goal.x_m, seen.y_m - goal.y_m),
            abs(wrap_rad(seen.heading_rad - goal.heading_rad)),
            hypot(true.x_m - goal.x_m, true.y_m - goal.y_m),
            abs(wrap_rad(true.heading_rad - goal.heading_rad)),
            energy_j - self._begun_j,
            tuple(self._path[::SHOWN_STEPS]),
        )


def _pose(goal: DriveGoal) -> Pose:
    return Pose(goal.x_m, goal.y_m, heading_rad=goal.heading_rad)


def _control(pose: Pose, ahead_m: float) -> Pose:
    """Return the pose of the control point of a rover."""
    point = pose.ahead(ahead_m)
    return replace(pose, x_m=point.x_m, y_m=point.y_m)


def _drive_own(goals: Goals, settings: Settings) -> Iterator[tuple[Run, TimedSolver | None]]:
    """Drive each goal from the origin on flat ground, in lock step with the executive."""
    solver = TimedSolver(settings) if settings.controller is Choice.MPC else None
    for seed, goal in enumerate(goals.goals):
        with tempfile.TemporaryDirectory() as folder:
            before_s = 0.0 if solver is None else sum(solver.first_s)
            run = _drive_one(goal, LockStep(settings, World(), Path(folder), seed, solver=solver))
            planned_s = 0.0 if solver is None else sum(solver.first_s) - before_s
            yield replace(run, time_s=run.time_s + planned_s), solver


def _drive_one(goal: DriveGoal, lockstep: LockStep) -> Run:
    lockstep.run(REST_S)
    rover, began_s = lockstep.rover, lockstep.time_s
    if not isinstance(rover, SimulatedJackal):
        raise TypeError(f"{rover} takes no velocities")
    course = _Course(goal, rover, lockstep.settings)

    def ended() -> bool:
        course.watch()
        return _stage(lockstep).terminal

    target = Waypoint(goal.x_m, goal.y_m, goal.heading_rad)
    lockstep.submit(Command(Identity("bench", 1), MoveTo(target), "direct"))
    lockstep.run_until(ended, LIMIT_S)
    time_s, energy_j = lockstep.time_s - began_s, rover.energy_j
    done = _stage(lockstep) is Stage.EXECUTED
    lockstep.run(REST_S)
    seen = lockstep.executive.status.pose
    lockstep.executive.simulate_crash()
    return course.made_up(done, time_s, energy_j, seen)


def _stage(lockstep: LockStep) -> Stage:
    stages = [
        report.stage for report in lockstep.downlink_record.reports if report.stage is not None
    ]
    return stages[-1] if stages else Stage.RECEIVED


class _Race:
    """A competitor's rover: the simulation, odometry and limits that the executive has.

    Attributes:
        took_s: process time of each decision.
    """

    def __init__(self, settings: Settings, seed: int) -> None:
        self._settings = settings
        self._clock = ManualClock()
        self.rover = SimulatedJackal(World(), seed, sensors=settings.sensors, mux=settings.mux)
        self.status = Status(self._clock, settings)
        self._mover = VelocityDriver(self._clock, settings, self.status, self.rover)
        self._steps = 0
        self.took_s: list[float] = []

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self._clock.now_s()

    def step(self, competitor: Competitor | None) -> None:
        """Let a step pass; without a competitor the rover is to stand."""
        self.rover.advance(STEP_S)
        self._steps += 1
        self._clock.set(self._steps * STEP_S)
        for fact in self.rover.facts():
            self.status.observe(fact)
        if self._steps % round(self._settings.tick_s / STEP_S) == 0:
            wanted = STANDING if competitor is None else self._request(competitor)
            self._mover.commit(wanted, self.time_s, self._settings.tick_s)

    def _request(self, competitor: Competitor) -> Velocity:
        ahead_m = self._settings.turn_drive.control_point_m
        pose = _control(self.status.pose, ahead_m)
        began_s = process_time()
        wanted = competitor.command(Seen(pose, self.status.velocity, self._mover.velocity))
        self.took_s.append(process_time() - began_s)
        return wanted


def _race_one(
    goal: DriveGoal, enter: Callable[[Task], Competitor], settings: Settings, seed: int
) -> tuple[Run, list[float]]:
    race, drive = _Race(settings, seed), settings.drive
    for _ in range(round(REST_S / STEP_S)):
        race.step(None)
    task = Task(
        _control(_pose(goal), settings.turn_drive.control_point_m),
        drive.travel_speed_mps,
        drive.rotate_speed_radps,
        drive.travel_acceleration_mps2,
        drive.rotate_acceleration_radps2,
        settings.tick_s,
        settings.turn_drive.latency_s,
        WITHIN_M,
        radians(WITHIN_DEG),
    )
    competitor, course, began_s = enter(task), _Course(goal, race.rover, settings), race.time_s
    done = False
    while not done and race.time_s - began_s < LIMIT_S:
        race.step(competitor)
        course.watch()
        pose = race.status.pose
        near = hypot(pose.x_m - goal.x_m, pose.y_m - goal.y_m) <= WITHIN_M
        turned = abs(wrap_rad(pose.heading_rad - goal.heading_rad)) <= radians(WITHIN_DEG)
        done = near and turned and race.status.standing
    time_s, energy_j = race.time_s - began_s, race.rover.energy_j
    for _ in range(round(REST_S / STEP_S)):
        race.step(None)
    run = course.made_up(done, time_s + race.took_s[0], energy_j, race.status.pose)
    return run, race.took_s


def measure(goals: Goals, name: str, settings: Settings, log: Callable[[str], None]) -> Measured:
    """Drive to goals with one controller.

    Args:
        goals: what to drive to, under which limits.
        name: what drives, of `OWN` or `COMPETITORS`.
        settings: the asset.
        log: called with a line after each goal.
    """
    runs: list[Run] = []
    first_s: list[float] = []
    later_s: list[float] = []
    missed: int | None = None
    tuned = tune(goals, name, settings)

    def add(run: Run) -> None:
        runs.append(run)
        best_s, true_cm = run.goal.best_known_time_s, 100 * run.true_error_m
        log(
            f"{name} {run.goal.id}: {'done' if run.done else 'NOT DONE'} in {run.time_s:.2f} s"
            f" (best known {best_s:.2f} s), true error {true_cm:.2f} cm"
        )

    if name in OWN:
        for run, solver in _drive_own(goals, tuned):
            add(run)
            if solver is not None:
                first_s, later_s, missed = solver.first_s, solver.later_s, solver.missed
    else:
        for seed, goal in enumerate(goals.goals):
            run, took_s = _race_one(goal, COMPETITORS[name], tuned, seed)
            add(run)
            first_s.append(took_s[0])
            later_s += took_s[1:]
    return Measured(name, tuple(runs), tuple(first_s), tuple(later_s), missed)


def figures(measured: Measured, ratio_goal: float) -> list[Figure]:
    """Return the figures of a controller; those of the product have goals.

    Args:
        measured: what became of its goals.
        ratio_goal: greatest sum of times over the sum of best known times.
    """
    runs, name, own = measured.runs, measured.name, OWN.get(measured.name)
    ratios = [run.time_s / run.goal.best_known_time_s for run in runs]
    bound_ratio = sum(run.time_s for run in runs) / sum(run.bound_s for run in runs)
    best, bound = "best known times", "the certified lower bound"
    truth = "the simulated truth"
    true_m = [run.true_error_m for run in runs]
    true_deg = [degrees(run.true_error_rad) for run in runs]
    count, reached = len(runs), sum(run.reached for run in runs)
    driven = [
        Figure(f"{name}: goals done, to 3 cm and 2°", reached, "goals", f"{count} goals",
               Goal(count, at_least=True) if own else None),
        Figure(f"{name}: sum of times", measured.sum_ratio, "ratio", best,
               Goal(ratio_goal) if own else None),
        Figure(f"{name}: sum of times over bound", bound_ratio, "ratio", bound),
        Figure(f"{name}: time, median", quantile(ratios, 0.5), "ratio", best),
        Figure(f"{name}: time, worst", max(ratios), "ratio", best),
        Figure(f"{name}: true error, median", 100 * quantile(true_m, 0.5), "cm", truth),
        Figure(f"{name}: true error, p95", 100 * quantile(true_m, 0.95), "cm", truth,
               Goal(own.true_cm) if own else None),
        Figure(f"{name}: true error, worst", 100 * max(true_m), "cm", truth),
        Figure(f"{name}: true heading error, p95", quantile(true_deg, 0.95), "deg", truth),
        Figure(f"{name}: energy, median", quantile([run.energy_j for run in runs], 0.5), "J",
               "the simulated battery"),
    ]  # fmt: skip
    return [*driven, *_planning(measured)]


def _planning(measured: Measured) -> list[Figure]:
    """Return how much of the process's time plans and decisions took."""
    name, planned, cpu = measured.name, measured.missed is not None, "process time"
    if not measured.later_s:
        return []
    first_ms = [1000 * each for each in measured.first_s]
    later_ms = [1000 * each for each in measured.later_s]
    rows = [
        Figure(f"{name}: first plan, median", quantile(first_ms, 0.5), "ms", cpu),
        Figure(f"{name}: first plan, worst", max(first_ms), "ms", cpu),
        Figure(f"{name}: plan of a tick, median", quantile(later_ms, 0.5), "ms", cpu),
        Figure(f"{name}: plan of a tick, p99", quantile(later_ms, 0.99), "ms", cpu,
               Goal(20.0) if planned else None),
        Figure(f"{name}: plan of a tick, worst", max(later_ms), "ms", cpu,
               Goal(35.0) if planned else None),
    ]  # fmt: skip
    if measured.missed is not None:
        rows.append(Figure(f"{name}: ticks without a plan", measured.missed, "ticks"))
    return rows


def side_by_side(rows: Sequence[Sequence[Figure]]) -> list[Figure]:
    """Return the figures of several controllers, alike ones beneath each other."""

    def kind(figure: Figure) -> str:
        return figure.name.partition(": ")[2]

    kinds = list(dict.fromkeys(kind(figure) for row in rows for figure in row))
    return sorted((each for row in rows for each in row), key=lambda each: kinds.index(kind(each)))
