"""Model predictive control: drives a curve to a place in the least time, planned anew each tick.

Where there is no plan in time, or none that leads there, the next sample of the plan before is
commanded; where that lasts, the rover stands, and the motion is abandoned.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import hypot
from typing import Final

from executive.commands import Command, Waypoint, controller_of
from executive.motion.locomotion import (
    Bounds,
    Leg,
    Motion,
    duration_s,
    turn_bounds,
)
from executive.motion.minimum_time import MinimumTime
from executive.motion.motion_model import MotionModel, MotionState
from executive.motion.motion_observer import FINEST_S, MotionObserver
from executive.motion.obstacles import Obstacles
from executive.motion.plan import ANY_RAD, Plan, PlanSolver, Problem, Target
from executive.motion.route import AIM_SHARE, Route, aim_within_m
from executive.motion.velocity_control import VelocityLocomotion, VelocityMover
from executive.settings import Controller, Settings
from executive.state import Status
from executive.values.clock import Clock
from executive.values.geometry import STANDING, Point, Pose, Velocity, wrap_rad
from executive.values.ports import Wanted

BRAKE_SHARE: Final = 2 / 3
KEEP_BRAKING_SHARE: Final = 0.93
"""Of the tolerances: the rover brakes where it comes to rest within, and goes on braking."""
ANY_HEADING_RAD: Final = 0.35
"""Off the direction of turn-then-drive at most, where no heading is asked for."""
OVER_S: Final = 0.15
"""Left of a plan, at the end of which the rover stands."""
AT_REST: Final = 0.01
"""Below so many metres and radians per second a command is none: plans are exact to less."""
SOON_S: Final = 1.0
"""To the end of the plan, from where on it may brake."""
MISSES: Final = 5
"""Ticks without a usable plan after which turn-then-drive takes over."""
LATEST_S: Final = 1.0
"""For a plan to come: the one before is driven on meanwhile, then turn-then-drive takes over."""
STANDS: Final = 3
"""How often a plan may be made from rest before turn-then-drive takes over."""
OFF_M: Final = 0.1
OFF_RAD: Final = 0.2
"""From where the plan had it now: beyond it the odometry jumped, or something moved the rover."""
MISSED: Final = 0.05
"""Metres and radians beyond its aim by which a plan does not lead there."""


@dataclass(frozen=True, slots=True)
class _Question:
    """What the solver was asked last.

    Attributes:
        asked_s: when it was asked.
        from_s: from when on the plan is to lead.
        end: which place of the route it is to end at.
        waits: whether the rover stands, so that the plan leads from when it is there.
    """

    asked_s: float
    from_s: float
    end: int
    waits: bool


@dataclass(frozen=True, slots=True)
class _Course:
    """The plan that is driven, and the question that it answers.

    Attributes:
        from_s: from when on it leads.
    """

    plan: Plan
    from_s: float
    question: _Question


class PredictiveLaw(Motion):
    """Drives the control point to where a leg ends, in the least time, through its waypoints.

    Where a waypoint is missed, or no plan leads on, the rover stands, and the motion is abandoned.
    """

    def __init__(
        self,
        leg: Leg,
        settings: Settings,
        status: Status,
        observer: MotionObserver,
        model: MotionModel,
        solver: PlanSolver,
    ) -> None:
        if leg.target is None or leg.toward_rad is None:
            raise TypeError(f"{leg} has no line to a place")
        self._leg, self._place = leg, leg.target
        self._settings, self._status = settings, status
        self._solver, self._observer, self._model = solver, observer, model
        self._near_m = leg.tolerance_m
        self._near_rad = settings.turn_drive.heading_tolerance_rad
        self._heading_rad = leg.toward_rad if leg.heading_rad is None else leg.heading_rad
        aim_rad = AIM_SHARE * self._near_rad
        if leg.heading_rad is None:
            self._near_rad = ANY_RAD if leg.free else ANY_HEADING_RAD
            aim_rad = ANY_RAD if leg.free else BRAKE_SHARE * ANY_HEADING_RAD
        self._behind_m = observer.ahead_m if leg.free else 0.0
        x_m, y_m, aim = self._place.x_m, self._place.y_m, aim_within_m(self._near_m)
        self._route = Route(
            leg.through,
            settings.turn_drive.position_tolerance_m,
            observer.ahead_m,
            Target(x_m, y_m, self._heading_rad, aim, aim_rad, self._behind_m),
        )
        self._question: _Question | None = None
        self._course: _Course | None = None
        self._abandons = False
        self._heard_s: float | None = None  # when the solver last was free
        self._misses = 0
        self._starts = 0
        self._braking = False
        self._obstacles: Obstacles | None = None
        self._known = self._present_obstacles
        self._limits = self._present_limits
        self.notice: str | None = None
        self.expected_s = self._expected_s()

    @property
    def evades(self) -> bool:
        """True: what it keeps away from is looked up for each plan."""
        return True

    @property
    def abandoned(self) -> bool:
        """Whether the rover stands, and is to go on by another leg."""
        return self._abandons and self._status.standing

    @property
    def again(self) -> bool:
        """Whether it passes waypoints, or something came into view so that no plan leads on."""
        seen = self._misses > MISSES and self._present_obstacles is not self._known
        return bool(self._leg.through) or seen

    @property
    def done(self) -> bool:
        """Whether the rover stands where the leg ends, and has passed what is before."""
        if self._abandons or self.passed < self._route.end:
            return False
        return self._status.standing and self._within(*self._seen_off, 1.0)

    @property
    def left(self) -> str:
        """The distance left, and for how long by the plan."""
        left_m, _ = self._seen_off
        if self._course is None:
            return f"{left_m:.3f} m left"
        return f"{left_m:.3f} m and {self._course.plan.duration_s:.1f} s left"

    def renew(self, _: float) -> bool:
        """Reckon anew how long it takes, if another greatest speed was set."""
        if self._present_limits == self._limits:
            return False
        self._limits = self._present_limits
        self.expected_s = self._expected_s()
        return True

    def want(self, now_s: float) -> Wanted:
        """Return the velocity to command."""
        missed = self._route.observe(self._status.pose.point, now_s)
        self.passed = self._route.passed
        if self._abandons:
            return STANDING
        if missed:
            self._abandon("a waypoint was missed")
            return STANDING
        state, effect_s = self._observer.observe(now_s), self._observer.effect_s
        takes_effect_s = now_s + self._settings.mpc.command_delay_s
        if self._solver.lead_ticks == 0:
            self._ask(state, effect_s, now_s)
        self._take_answer(state, effect_s, now_s)
        if reason := self._hopeless(now_s):
            self._abandon(reason)
            return STANDING
        command = STANDING
        if self._course is not None and not self._lands(self._course, state):
            command = self._course.plan.velocity(takes_effect_s - self._course.from_s)
        if self._solver.lead_ticks:
            step_s = max(takes_effect_s - effect_s, FINEST_S)
            self._ask(self._model.moved(state, command, step_s), takes_effect_s, now_s)
        return command

    @property
    def _present_limits(self) -> tuple[float, float]:
        return self._status.travel_limit_mps, self._status.rotate_limit_radps

    @property
    def _present_obstacles(self) -> Obstacles | None:
        """What is kept away from now; the same until that changes."""
        zones, footprint = self._status.obstacles, self._settings.footprint
        if not zones.any or footprint is None:
            return None
        if self._obstacles is None or self._obstacles.zones is not zones:
            self._obstacles = Obstacles(zones, footprint.radius_m)
        return self._obstacles

    def _expected_s(self) -> float:
        """Return what turn-then-drive takes, at most."""
        pose, rotate = self._status.pose, turn_bounds(self._settings, self._status)
        travel = Bounds(self._limits[0], self._settings.drive.travel_acceleration_mps2)
        takes_s, place, heading_rad = 0.0, pose.ahead(self._observer.ahead_m), pose.heading_rad
        *through, end = *self._leg.around, *self._route.left
        towards = [before.bearing_rad(after) for before, after in pairwise((place, *through))]
        for after, toward_rad in zip(
            (*through, end), (*towards, self._leg.toward_rad or 0.0), strict=True
        ):
            takes_s += duration_s(wrap_rad(toward_rad - heading_rad), rotate)
            takes_s += duration_s(place.distance_m(after), travel)
            place, heading_rad = after, toward_rad
        return takes_s + duration_s(wrap_rad(self._heading_rad - heading_rad), rotate)

    def _off(self, control: Point, heading_rad: float) -> tuple[float, float]:
        """Return how far a place of the control point is from the end, in metres and radians."""
        there = Pose(control.x_m, control.y_m, heading_rad=heading_rad).ahead(-self._behind_m)
        return there.distance_m(self._place), abs(wrap_rad(heading_rad - self._heading_rad))

    @property
    def _seen_off(self) -> tuple[float, float]:
        """How far the rover is from the end by its odometry, in metres and radians."""
        pose = self._status.pose
        return self._off(pose.ahead(self._observer.ahead_m), pose.heading_rad)

    def _within(self, off_m: float, off_rad: float, share: float) -> bool:
        return off_m <= share * self._near_m and off_rad <= share * self._near_rad

    def _ask(self, state: MotionState, from_s: float, now_s: float) -> None:
        """Have a plan made from a state, with the rest of the plan before as a guess.

        Where the rover stands at the end of that, polylines are tried anew.
        """
        if self._solver.busy:
            return
        course, route, guess = self._course, self._route, None
        at_rest = max(abs(state.travel_mps), abs(state.rotate_radps)) < AT_REST
        if course is not None:
            ahead = course.question.end - route.passed
            rest = course.plan.after(from_s - course.from_s, max(ahead, 0))
            over = at_rest and self._status.standing and rest.duration_s < OVER_S
            if not over and ahead >= 0:
                guess = rest
                near_rad = guess.states[0].heading_rad
                heading_rad = near_rad + wrap_rad(state.heading_rad - near_rad)
                state = replace(state, heading_rad=heading_rad)
        if course is None or guess is None:
            self._starts += 1
            first = route.passed
        else:
            first = course.question.end - len(guess.passes_s)
        *through, target = route.plan_from(first, now_s)
        waits = guess is None and at_rest
        limits = self._present_limits
        around = self._leg.around if self._question is None else ()
        self._question = _Question(now_s, from_s, first + len(through), waits)
        problem = Problem(
            state, target, *limits, guess, tuple(through), self._present_obstacles, around
        )
        self._solver.ask(problem)

    def _take_answer(self, state: MotionState, effect_s: float, now_s: float) -> None:
        """Go on with the answer to the last question, if there is one that leads there."""
        if self._heard_s is None or not self._solver.busy:
            self._heard_s = now_s
        course, question = self._course, self._question
        if course is not None and self._jumped(course, state, effect_s):
            self._misses += 1
            return
        if self._solver.busy or question is None:
            return
        plan = self._solver.answer()
        if plan is None or plan.miss > MISSED:
            self._misses += 1
            return
        self._misses = 0
        from_s = effect_s if question.waits else question.from_s
        self._course = _Course(plan, from_s, question)

    def _hopeless(self, now_s: float) -> str | None:
        """Return why turn-then-drive is to take over, if it is."""
        if self._misses > MISSES:
            return "no plan leads there"
        if self._starts > STANDS:
            return "it stands beside its target"
        if self._heard_s is not None and now_s - self._heard_s > LATEST_S:
            return "no plan comes in time"
        return None

    def _jumped(self, course: _Course, state: MotionState, effect_s: float) -> bool:
        """Return whether the rover is elsewhere, though it was led since the plan was asked for."""
        if self._observer.late_s > course.question.asked_s:
            return False
        planned = course.plan.at(effect_s - course.from_s)
        off_m = hypot(state.x_m - planned.x_m, state.y_m - planned.y_m)
        return off_m > OFF_M or abs(wrap_rad(state.heading_rad - planned.heading_rad)) > OFF_RAD

    def _lands(self, course: _Course, state: MotionState) -> bool:
        """Return whether braking now, or on, brings the rover to rest within the tolerances."""
        plan, last = course.plan, course.question.end == self._route.end
        if plan.passes_s or not last or plan.duration_s > SOON_S:
            self._braking = False
            return False
        drive, tick_s = self._settings.drive, self._settings.tick_s
        while state.travel_mps or state.rotate_radps:
            velocity = Velocity(
                _toward_zero(state.travel_mps, drive.travel_acceleration_mps2 * tick_s),
                _toward_zero(state.rotate_radps, drive.rotate_acceleration_radps2 * tick_s),
            )
            state = self._model.moved(state, velocity, tick_s)
        for _ in range(2):
            state = self._model.moved(state, STANDING, tick_s)
        off_m, off_rad = self._off(Point(state.x_m, state.y_m), state.heading_rad)
        share = KEEP_BRAKING_SHARE if self._braking else BRAKE_SHARE
        self._braking = self._within(off_m, off_rad, share)
        return self._braking

    def _abandon(self, reason: str) -> None:
        goes_on = "turn-then-drive takes over"
        if self._leg.through:
            goes_on = "the rover stands, and drives to the next waypoint alone"
        elif self.again:
            goes_on = "the rover stands, and looks for another way"
        self.notice = f"mpc: {reason}; {goes_on}"
        self._abandons = True


def _toward_zero(figure: float, step: float) -> float:
    return max(figure - step, 0.0) if figure > 0.0 else min(figure + step, 0.0)


class PredictiveLocomotion(VelocityLocomotion):
    """Drives to places by `PredictiveLaw` where the command, or else the asset, says so.

    All else is turn-then-drive, and so is a place for which more precision is asked than usual:
    odometry knows turns on the spot and straight lines better than fast curves.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        status: Status,
        mover: VelocityMover,
        solver: PlanSolver,
    ) -> None:
        super().__init__(clock, settings, status)
        self._mover = mover
        self._solver = solver
        self._model = model_of(settings)

    def curves(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether a waypoint asks for no more precision than usual."""
        return not self._fine(waypoint.tolerance_m) and self._drives(command)

    def passes(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether a waypoint asks for no heading, and for no more precision than usual."""
        return waypoint.heading_rad is None and self.curves(command, waypoint)

    def turn(self, command: Command, leg: Leg, final: bool) -> Motion | None:
        """Return the last turn of a leg; the first is part of its curve."""
        if not final and self._leads(command, leg):
            return None
        return super().turn(command, leg, final)

    def line(self, command: Command, leg: Leg) -> Motion | None:
        """Return the curve of a leg that leads to a place, or its straight line."""
        if not self._leads(command, leg):
            return super().line(command, leg)
        return PredictiveLaw(
            leg,
            self._settings,
            self._status,
            MotionObserver(self._settings, self._status, self._model, self._mover),
            self._model,
            self._solver,
        )

    def _drives(self, command: Command) -> bool:
        return controller_of(command.request, self._settings.controller) is Controller.MPC

    def _leads(self, command: Command, leg: Leg) -> bool:
        """Return whether a leg leads to a place by a curve."""
        leads = leg.target is not None and leg.toward_rad is not None and not leg.straight
        usual = bool(leg.through) or not self._fine(leg.tolerance_m)
        return leads and usual and self._drives(command)

    def _fine(self, tolerance_m: float | None) -> bool:
        """Return whether a tolerance asks for more precision than usual."""
        usual_m = self._settings.turn_drive.position_tolerance_m
        return (tolerance_m or usual_m) < usual_m


def model_of(settings: Settings) -> MotionModel:
    """Return how the rover of an asset moves, by its settings."""
    ahead_m = settings.turn_drive.control_point_m
    return MotionModel(settings.mpc.yaw, settings.mpc.slip, ahead_m)


def make_solver(settings: Settings) -> MinimumTime:
    """Return what solves the plans of an asset, in the call that asks.

    Raises:
        SettingsError: casadi is not installed.
    """
    drive = settings.drive
    return MinimumTime(
        model_of(settings),
        drive.travel_acceleration_mps2,
        drive.rotate_acceleration_radps2,
        settings.mpc.steps,
        settings.zones.any or settings.sensors.laser is not None,
    )
