"""Model predictive control: drives a curve to a target in minimum time, replanned each tick.

Without a usable plan in time, the rover follows the previous one. If that persists, the rover stops
and the motion is aborted. The model and its calibration are in docs/controllers.md.
"""

from enum import Enum, unique
from itertools import pairwise
from math import pi
from typing import Final

from executive.commands import Command, Waypoint, requested_controller
from executive.motion.locomotion import (
    Bounds,
    Leg,
    Motion,
    duration_s,
    turn_bounds,
)
from executive.motion.minimum_time import MinimumTimeSolver
from executive.motion.motion_model import (
    TIME_RESOLUTION_S,
    MotionModel,
    MotionObserver,
    MotionState,
)
from executive.motion.obstacle_constraints import ObstacleConstraints
from executive.motion.replanning import ActiveTrajectory, Replanning
from executive.motion.route import TOLERANCE_RATIO, Route, planning_tolerance_m
from executive.motion.trajectory import (
    ANY_HEADING_TOLERANCE_RAD,
    TrajectorySolver,
    TrajectoryTarget,
)
from executive.motion.velocity_control import VelocityDriver, VelocityLocomotion
from executive.settings import Controller, Settings
from executive.state import Status
from executive.values.clock import Clock
from executive.values.geometry import STANDING, Point, Pose, Velocity, wrap_rad
from executive.values.ports import MotionIntent

BRAKE_TOLERANCE_RATIO: Final = 2 / 3
BRAKING_HYSTERESIS_RATIO: Final = 0.93
"""Ratios to the tolerances: to begin to brake, and to continue. Chosen, not measured."""
ANY_HEADING_RAD: Final = 0.35
"""Maximum deviation from the heading of turn-then-drive, if no heading is requested."""
BRAKING_HORIZON_S: Final = 1.0
"""Maximum remaining time of the plan for braking to begin."""


@unique
class Phase(Enum):
    """The phases of a predictive law; it ends in ABANDONED, or within the tolerances."""

    PLANNING = "no plan has been received yet: the rover is stationary"
    FOLLOWING = "it follows the last usable plan"
    BRAKING = "it stops within the tolerances by braking alone"
    ABANDONED = "the rover is stationary and continues by another leg"


class PredictiveLaw(Motion):
    """Drives the control point to the end of a leg in minimum time, through its waypoints.

    After a missed waypoint, or without a usable plan, the rover stops and the motion is aborted.
    """

    def __init__(
        self,
        leg: Leg,
        settings: Settings,
        status: Status,
        observer: MotionObserver,
        model: MotionModel,
        solver: TrajectorySolver,
    ) -> None:
        if leg.target is None or leg.toward_rad is None:
            raise TypeError(f"{leg} has no line to a target")
        self._leg, self._target = leg, leg.target
        self._settings, self._status = settings, status
        self._lead_ticks = solver.lead_ticks
        self._observer, self._model = observer, model
        self._near_m = leg.tolerance_m
        self._near_rad = settings.turn_drive.heading_tolerance_rad
        self._heading_rad = leg.toward_rad if leg.heading_rad is None else leg.heading_rad
        aim_rad = TOLERANCE_RATIO * self._near_rad
        if leg.heading_rad is None:
            self._near_rad = ANY_HEADING_TOLERANCE_RAD if leg.free else ANY_HEADING_RAD
            aim_rad = (
                ANY_HEADING_TOLERANCE_RAD if leg.free else BRAKE_TOLERANCE_RATIO * ANY_HEADING_RAD
            )
        self._behind_m = observer.ahead_m if leg.free else 0.0
        x_m, y_m, aim = self._target.x_m, self._target.y_m, planning_tolerance_m(self._near_m)
        self._route = Route(
            leg.via_points,
            settings.turn_drive.position_tolerance_m,
            observer.ahead_m,
            TrajectoryTarget(x_m, y_m, self._heading_rad, aim, aim_rad, self._behind_m),
        )
        self._replanning = Replanning(solver, self._route, status)
        self._phase = Phase.PLANNING
        self._obstacles: ObstacleConstraints | None = None
        self._known = self._present_obstacles
        self._limits = self._present_limits
        self.progress_note: str | None = None
        self.expected_s = self._expected_s()

    @property
    def avoids_obstacles(self) -> bool:
        """True: each plan considers the present obstacles."""
        return True

    @property
    def aborted(self) -> bool:
        """Whether the rover is stationary and continues by another leg."""
        return self._phase is Phase.ABANDONED and self._status.standing

    @property
    def retry_as_curve(self) -> bool:
        """Whether it has via points, or a newly detected obstacle leaves no usable plan."""
        seen = self._replanning.misses_all and self._present_obstacles is not self._known
        return bool(self._leg.via_points) or seen

    @property
    def done(self) -> bool:
        """Whether the rover is stationary at the end of the leg, and has passed its waypoints."""
        if self._phase is Phase.ABANDONED or self.waypoints_passed < self._route.end:
            return False
        return self._status.standing and self._within(*self._measured_error, 1.0)

    @property
    def remaining_text(self) -> str:
        """The remaining distance, and the remaining duration of the plan."""
        left_m, _ = self._measured_error
        course = self._replanning.course
        if course is None:
            return f"{left_m:.3f} m remaining"
        return f"{left_m:.3f} m and {course.plan.duration_s:.1f} s remaining"

    def update_limits(self, _: float) -> bool:
        """Estimate the duration again if the speed limit changed."""
        if self._present_limits == self._limits:
            return False
        self._limits = self._present_limits
        self.expected_s = self._expected_s()
        return True

    def intent(self, now_s: float) -> MotionIntent:
        """Return the velocity to command."""
        missed = self._route.observe(self._status.pose.point, now_s)
        self.waypoints_passed = self._route.passed
        if self._phase is Phase.ABANDONED:
            return STANDING
        if missed:
            self._abort("a waypoint was missed")
            return STANDING
        state, effect_s = self._observer.observe(now_s), self._observer.command_effective_s
        takes_effect_s = now_s + self._settings.mpc.command_delay_s
        if self._lead_ticks == 0:
            self._request_plan(state, effect_s, now_s)
        self._replanning.receive(state, effect_s, now_s, self._observer.late_s)
        if reason := self._replanning.failure(now_s):
            self._abort(reason)
            return STANDING
        command, course = STANDING, self._replanning.course
        if course is not None:
            self._phase = (
                Phase.BRAKING if self._stops_within_tolerance(course, state) else Phase.FOLLOWING
            )
            if self._phase is Phase.FOLLOWING:
                command = course.plan.velocity(takes_effect_s - course.from_s)
        if self._lead_ticks:
            step_s = max(takes_effect_s - effect_s, TIME_RESOLUTION_S)
            planned = self._model.state_after(state, command, step_s)
            self._request_plan(planned, takes_effect_s, now_s)
        return command

    def _request_plan(self, state: MotionState, from_s: float, now_s: float) -> None:
        obstacles = self._present_obstacles
        self._replanning.request(state, from_s, now_s, obstacles, self._leg.detour_points)

    @property
    def _present_limits(self) -> tuple[float, float]:
        return self._status.travel_limit_mps, self._status.rotate_limit_radps

    @property
    def _present_obstacles(self) -> ObstacleConstraints | None:
        """The obstacles to avoid now; the same object until they change."""
        zones, footprint = self._status.obstacles, self._settings.footprint
        if not zones.not_empty or footprint is None:
            return None
        if self._obstacles is None or self._obstacles.zones is not zones:
            self._obstacles = ObstacleConstraints(zones, footprint.radius_m)
        return self._obstacles

    def _expected_s(self) -> float:
        """Return the maximum duration, that of turn-then-drive."""
        pose, rotate = self._status.pose, turn_bounds(self._settings, self._status)
        travel = Bounds(self._limits[0], self._settings.drive.travel_acceleration_mps2)
        takes_s, point, heading_rad = 0.0, pose.ahead(self._observer.ahead_m), pose.heading_rad
        *through, end = *self._leg.detour_points, *self._route.remaining
        towards = [before.bearing_rad(after) for before, after in pairwise((point, *through))]
        for after, toward_rad in zip(
            (*through, end), (*towards, self._leg.toward_rad or 0.0), strict=True
        ):
            takes_s += duration_s(wrap_rad(toward_rad - heading_rad), rotate)
            takes_s += duration_s(point.distance_m(after), travel)
            point, heading_rad = after, toward_rad
        if (radius_m := self._settings.drive.min_turning_radius_m) is not None:
            takes_s += (len(through) + 1) * duration_s(2 * pi * radius_m, travel)
        return takes_s + duration_s(wrap_rad(self._heading_rad - heading_rad), rotate)

    def _target_error(self, control: Point, heading_rad: float) -> tuple[float, float]:
        """Return the error of a control point position from the end, in metres and radians."""
        there = Pose(control.x_m, control.y_m, heading_rad=heading_rad).ahead(-self._behind_m)
        return there.distance_m(self._target), abs(wrap_rad(heading_rad - self._heading_rad))

    @property
    def _measured_error(self) -> tuple[float, float]:
        """The measured error from the end, in metres and radians."""
        pose = self._status.pose
        return self._target_error(pose.ahead(self._observer.ahead_m), pose.heading_rad)

    def _within(self, off_m: float, off_rad: float, share: float) -> bool:
        return off_m <= share * self._near_m and off_rad <= share * self._near_rad

    def _stops_within_tolerance(self, course: ActiveTrajectory, state: MotionState) -> bool:
        """Return whether braking from now on stops the rover within the tolerances."""
        plan, last = course.plan, course.request.end == self._route.end
        if plan.via_times_s or not last or plan.duration_s > BRAKING_HORIZON_S:
            return False
        drive, tick_s = self._settings.drive, self._settings.tick_s
        while state.travel_mps or state.rotate_radps:
            velocity = Velocity(
                _toward_zero(state.travel_mps, drive.travel_acceleration_mps2 * tick_s),
                _toward_zero(state.rotate_radps, drive.rotate_acceleration_radps2 * tick_s),
            )
            state = self._model.state_after(state, velocity, tick_s)
        for _ in range(2):
            state = self._model.state_after(state, STANDING, tick_s)
        off_m, off_rad = self._target_error(Point(state.x_m, state.y_m), state.heading_rad)
        share = BRAKING_HYSTERESIS_RATIO if self._phase is Phase.BRAKING else BRAKE_TOLERANCE_RATIO
        return self._within(off_m, off_rad, share)

    def _abort(self, reason: str) -> None:
        continuation = "turn-then-drive takes over"
        if self._leg.via_points:
            continuation = "the rover stops, then drives to the next waypoint alone"
        elif self._settings.drive.min_turning_radius_m is not None:
            continuation = "the rover stops, then plans again"
        elif self.retry_as_curve:
            continuation = "the rover stops and searches for a detour"
        self.progress_note = f"mpc: {reason}; {continuation}"
        self._phase = Phase.ABANDONED


def _toward_zero(figure: float, step: float) -> float:
    return max(figure - step, 0.0) if figure > 0.0 else min(figure + step, 0.0)


class PredictiveLocomotion(VelocityLocomotion):
    """Drives to targets by `PredictiveLaw` if the command, or else the asset, selects it.

    Turn-then-drive executes all other motions, and targets with a finer tolerance than the asset's:
    odometry measures turns on the spot and straight lines better than fast curves. A base that
    cannot turn on the spot drives curves to these, too.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        status: Status,
        mover: VelocityDriver,
        solver: TrajectorySolver,
    ) -> None:
        super().__init__(clock, settings, status)
        self._mover = mover
        self._solver = solver
        self._model = model_of(settings)

    def supports_curve(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether a waypoint requests no finer tolerance than the asset's."""
        return not self._fine(waypoint.tolerance_m) and self._drives(command)

    def can_pass_through(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether a waypoint has no heading, and no finer tolerance than the asset's."""
        return waypoint.heading_rad is None and self.supports_curve(command, waypoint)

    def make_turn(self, command: Command, leg: Leg, final: bool) -> Motion | None:
        """Return the last turn of a leg; the first is part of its curve."""
        if not final and self._uses_curve(command, leg):
            return None
        return super().make_turn(command, leg, final)

    def make_line(self, command: Command, leg: Leg) -> Motion | None:
        """Return the curve of a leg, or its straight line."""
        if not self._uses_curve(command, leg):
            return super().make_line(command, leg)
        return PredictiveLaw(
            leg,
            self._settings,
            self._status,
            MotionObserver(self._settings, self._status, self._model, self._mover),
            self._model,
            self._solver,
        )

    def _drives(self, command: Command) -> bool:
        return requested_controller(command.request, self._settings.controller) is Controller.MPC

    def _uses_curve(self, command: Command, leg: Leg) -> bool:
        """Return whether a leg is driven as a curve."""
        leads = (
            leg.target is not None and leg.toward_rad is not None and not leg.force_turn_then_drive
        )
        usual = bool(leg.via_points) or not self._fine(leg.tolerance_m)
        return leads and usual and self._drives(command)

    def _fine(self, tolerance_m: float | None) -> bool:
        """Return whether a tolerance is finer than the asset's, for turns and lines."""
        if self._settings.drive.min_turning_radius_m is not None:
            return False
        usual_m = self._settings.turn_drive.position_tolerance_m
        return (tolerance_m or usual_m) < usual_m


def model_of(settings: Settings) -> MotionModel:
    """Return the motion model of an asset."""
    ahead_m = settings.turn_drive.control_point_m
    return MotionModel(settings.mpc.yaw, settings.mpc.slip, ahead_m)


def make_solver(settings: Settings) -> MinimumTimeSolver:
    """Return the trajectory solver of an asset, which solves within the call.

    Raises:
        SettingsError: casadi is not installed.
    """
    drive = settings.drive
    return MinimumTimeSolver(
        model_of(settings),
        drive.travel_acceleration_mps2,
        drive.rotate_acceleration_radps2,
        settings.mpc.steps,
        settings.zones.not_empty or settings.sensors.laser is not None,
        drive.min_turning_radius_m,
    )
