"""`Predictor` computes a prediction of each accepted motion and each started plan, in parallel.

They are computed on the core's thread, in slices, after the work of a turn or tick. Neither the
reply to a command nor a tick waits for one. A slice is two ticks of the copy, or one with a slice
of a search, fixed amounts, so that in lock step each repeats bit for bit.
"""

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from math import degrees
from typing import Final

from executive.checks import check_battery, expected_pose, is_navigated
from executive.commands import (
    PLAN_LINK,
    Command,
    DriveFor,
    Motion,
    PlanDefinition,
    PreemptionPolicy,
)
from executive.commands.intake import check_localized
from executive.goals import Context, Goal
from executive.motion import SharedSolver
from executive.plans import PlanNode, check_plan
from executive.preview.preview import (
    Preview,
    PreviewRun,
    PreviewStart,
    TickableTree,
    uses_mpc,
)
from executive.record import Notifications
from executive.state import MotionStatistics
from executive.values.facts import PlannedPath
from executive.values.geometry import Pose
from executive.values.ports import NavigationRover, PathRequest
from executive.values.reasons import PREDICTED, Figure, Refusal

_LOG = logging.getLogger(__name__)

NOT_REQUESTED: Final = "the path of a later leg is not known yet"
SLICE_TICKS: Final = 2
"""Ticks of the copy in one slice."""


@dataclass(slots=True)
class _PredictionJob:
    """A prediction to be computed.

    Attributes:
        name: human-readable name of its subject.
        start: start pose.
        command: command of the motion; None for a plan.
        is_wanted: returns whether the prediction is still needed.
        since_s: time of the request.
        goal: goal of a motion until its first leg is planned, for the path of that.
        run: the preview run, once started.
    """

    name: str
    subject: Motion | PlanNode
    start: Pose
    statistics: MotionStatistics
    command: Command | None
    is_wanted: Callable[[], bool]
    since_s: float
    goal: Goal | None = None
    run: PreviewRun | None = None


class Predictor:
    """Predicts each accepted motion, and each plan that starts.

    Motions longer than a preview may be are not predicted. Nor are velocities that replace another,
    as from a joystick, single steps of a plan, and commands without progress reports.

    Args:
        context: context of the asset; its values are copied.
        build_tree: builds the tree of a copy.
        solver: trajectory solver for mpc, if the asset offers it.
        planner: answers requests of paths for previews, unrecorded as these are; None without one.
    """

    def __init__(
        self,
        context: Context,
        notifications: Notifications,
        build_tree: Callable[[Context], TickableTree],
        solver: SharedSolver | None = None,
        planner: NavigationRover | None = None,
    ) -> None:
        self._context = context
        self._planner = planner
        self._path_numbers = count(1)
        self._notifications = notifications
        self._build_tree = build_tree
        self._solver = solver
        self._waiting: deque[_PredictionJob] = deque()

    @property
    def pending(self) -> bool:
        """Whether a job can be advanced now."""
        return bool(self._waiting) and self._ready(self._waiting[0])

    def preview(self, request: Motion | PlanDefinition) -> PreviewRun | Refusal:
        """See `Executive.preview`."""
        context = self._context
        settings, status = context.settings, context.status
        what = check_plan(request, settings) if isinstance(request, PlanDefinition) else request
        if isinstance(what, Refusal):
            return what
        if (refusal := check_localized(status, settings)) is not None:
            return refusal
        scene = status.obstacles, context.detours.copy()  # as queries are not recorded
        pose = expected_pose(context.goals.motion, status.pose, context.clock, settings, scene)
        refusal = check_battery(what, pose, status, settings, scene)
        return refusal or self.run(what, pose, apart=True)

    def request_path(self, request: PathRequest) -> PathRequest | None:
        """Request a path for a preview; return the request as numbered, or None.

        The planner serves one request at a time: while a navigated motion is active it serves that.
        """
        active = self._context.goals.motion.active
        if self._planner is None:
            return None
        if active is not None and is_navigated(active.request, self._context.settings):
            return None
        request = replace(request, number=-next(self._path_numbers))
        self._planner.plan_path(request)
        return request

    def run(self, what: Motion | PlanNode, pose: Pose, apart: bool = False) -> PreviewRun:
        """Return a preview run of a motion or a plan from a pose.

        Args:
            what: the motion or plan.
            pose: start pose.
            apart: whether the run is independent of the core, and may run on another thread.
        """
        context = self._context
        settings, status = context.settings, context.status
        speeds = (status.travel_speed_mps, status.rotate_speed_radps, status.speed_limit_ratio)
        solver = None if self._solver is None else self._solver.fork(apart)
        origin = status.map_origin
        start = PreviewStart(
            *(pose, *speeds, context.files, status.obstacles, status.uncertainty),
            map_origin=None if isinstance(origin, Refusal) else origin,
            detours=context.detours.copy(),
            odom_origin=status.odom_origin,
            battery=status.battery,
        )
        return PreviewRun(what, start, settings, self._build_tree, solver)

    def predict_motion(self, goal: Goal, motion: Motion, start: Pose) -> None:
        """Queue the prediction of a motion from a start pose, and start its statistics."""
        statistics = goal.statistics = self._start_statistics()
        command = goal.command
        replaces = isinstance(motion, DriveFor) and command.preemption is PreemptionPolicy.REPLACE
        if replaces or command.link == PLAN_LINK or not command.report_progress:
            return
        name, lifecycle = f"{command.identity} {command.name}", goal.lifecycle
        self._waiting.append(
            _PredictionJob(
                name,
                motion,
                start,
                statistics,
                command,
                lambda: not lifecycle.stage.terminal,
                self._context.clock.now_s(),
                goal,
            )
        )

    def predict_plan(
        self, plan_id: str, root: PlanNode, wanted: Callable[[], bool]
    ) -> MotionStatistics:
        """Queue the prediction of a plan that starts here; return its statistics."""
        statistics, start = self._start_statistics(), self._context.status.pose
        statistics.begin()
        now_s = self._context.clock.now_s()
        self._waiting.append(
            _PredictionJob(f"plan {plan_id}", root, start, statistics, None, wanted, now_s)
        )
        return statistics

    def _start_statistics(self) -> MotionStatistics:
        battery = self._context.settings.battery
        capacity_j = None if battery is None else battery.capacity_j
        return MotionStatistics(self._context.clock, self._context.status, capacity_j)

    def advance(self) -> bool:
        """Compute one slice; return whether a prediction was published."""
        while self._waiting and not self._waiting[0].is_wanted():
            self._waiting.popleft()
        if not self.pending:
            return False
        work = self._waiting[0]
        try:
            result = self._next_slice(work)
        except Exception:
            _LOG.exception("%s: its prediction raised", work.name)
            self._waiting.popleft()
            return False
        if result is None:
            return False
        self._waiting.popleft()
        if isinstance(result, Refusal):
            _LOG.info("%s is not predicted: %s", work.name, result.text)
            return False
        work.statistics.predicted = prediction_figures(result)
        self._notifications.prediction(
            f"{work.name} predicted: {describe(result)}", work.statistics.predicted, work.command
        )
        return True

    def _ready(self, work: _PredictionJob) -> bool:
        """Whether a slice can be computed.

        The first request to the solver waits for a tick, so that the motion itself requests first.
        A navigated motion is predicted along the path of its leg, once that is planned.
        """
        if work.run is not None and work.run.path_request is not None:
            return work.goal is None or bool(work.goal.leg.path)
        if work.run is not None:
            return not work.run.waiting_for_solver
        settings, clock = self._context.settings, self._context.clock
        waited = clock.now_s() >= work.since_s + settings.tick_s
        return waited or not uses_mpc(work.subject, settings)

    def _next_slice(self, work: _PredictionJob) -> Preview | Refusal | None:
        if work.run is None:
            work.run = self.run(work.subject, work.start)
            work.run.set_up()
        elif (request := work.run.path_request) is not None:
            goal, work.goal = work.goal, None
            if goal is None or goal.leg.via_points:
                work.run.provide_path(PlannedPath(request.number, (), NOT_REQUESTED))
            else:
                work.run.provide_leg(goal.leg.path)
        else:
            work.run.advance(SLICE_TICKS)
        return work.run.result


def prediction_figures(preview: Preview) -> tuple[Figure, ...]:
    """Return the figures of a prediction, for comparison with the measured result."""
    end, energy_j, clearance = preview.end, preview.energy_j, preview.clearance
    return (
        Figure(PREDICTED + "duration", preview.duration_s, "s"),
        Figure(PREDICTED + "length", preview.length_m, "m"),
        Figure(PREDICTED + "x", end.x_m, "m"),
        Figure(PREDICTED + "y", end.y_m, "m"),
        Figure(PREDICTED + "heading", end.heading_rad, "rad"),
        Figure(PREDICTED + "within", preview.within_m, "m"),
        Figure(PREDICTED + "heading within", preview.within_rad, "rad"),
        *(() if energy_j is None else (Figure(PREDICTED + "energy", energy_j, "J"),)),
        *(() if clearance is None else (Figure(PREDICTED + "clearance", clearance.least_m, "m"),)),
    )


def describe(preview: Preview) -> str:
    """Return a summary of a prediction."""
    end, energy_j = preview.end, preview.energy_j
    energy = "" if energy_j is None else f" {energy_j:.0f} J,"
    position_text = f"({end.x_m:.2f}, {end.y_m:.2f}, {degrees(end.heading_rad):.0f}°)"
    took = f"{preview.duration_s:.1f} s, {preview.length_m:.1f} m"
    note = preview.note and f", {preview.note}"
    return f"{took},{energy} end {position_text} ± {preview.within_m:.2f} m{note}"
