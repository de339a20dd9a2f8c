"""Stand-ins for the rover in a preview: simple bases, and a solver that reuses trajectories."""

from collections import deque
from dataclasses import replace
from math import inf
from typing import Final

from executive.motion import (
    MotionState,
    Trajectory,
    TrajectoryProblem,
    TrajectorySolver,
    model_of,
    profile_of,
)
from executive.settings import Settings
from executive.values.clock import ManualClock
from executive.values.facts import Fact, MotionEnded, Odometry
from executive.values.geometry import STANDING, Pose, Velocity, arc_end, wrap_rad
from executive.values.ports import CameraIntent, DelegatedMotion, VelocityHold

TIME_RESOLUTION_S: Final = 1e-9
TRAJECTORY_REUSE_S: Final = 0.5
"""Reuse time of a trajectory: between its states the model deviates by centimetres."""


class StationaryBase:
    """Base that only moves; this one is stationary.

    Attributes:
        pose: pose of base_link, by exact odometry.
        velocity: present velocity.
    """

    def __init__(self, clock: ManualClock, settings: Settings, pose: Pose) -> None:
        self._clock = clock
        self._settings = settings
        self._at_s = clock.now_s()
        self.pose = pose
        self.velocity = STANDING

    def advance(self) -> None:
        """Advance to the clock's time."""

    def facts(self) -> tuple[Fact, ...]:
        """Return the facts that it reports now."""
        return (Odometry(self._clock.now_s(), self.pose, self.velocity),)

    def emergency_stop(self) -> None:
        """Do nothing: a preview has no stops."""

    def lock(self, held: bool) -> None:
        """Do nothing: a copy has no other publishers."""

    def point_camera(self, wanted: CameraIntent) -> None:
        """Do nothing: a preview has no camera."""

    def request_frame(self) -> None:
        """Do nothing: a preview has no camera."""


class KinematicBase(StationaryBase):
    """Base that reaches each velocity after the latency, and turns about its control point."""

    def __init__(self, clock: ManualClock, settings: Settings, pose: Pose) -> None:
        super().__init__(clock, settings, pose)
        seen_late_s = settings.tick_s / 2  # odometry is read at ticks only
        self._latency_s = max(0.0, settings.turn_drive.latency_s - seen_late_s)
        self._control_m = settings.turn_drive.control_point_m
        self._pending: deque[tuple[float, Velocity]] = deque()

    def drive(self, velocity: Velocity) -> None:
        """Apply a velocity command."""
        self._pending.append((self._clock.now_s() + self._latency_s, velocity))

    def advance(self) -> None:
        """Advance to the clock's time."""
        now_s = self._clock.now_s()
        while self._pending and self._pending[0][0] <= now_s:
            due_s, velocity = self._pending.popleft()
            self._move(due_s)
            self.velocity = velocity
        self._move(now_s)

    def _move(self, until_s: float) -> None:
        passed_s, self._at_s = until_s - self._at_s, until_s
        if self.velocity == STANDING:
            return
        control = self.pose.ahead(self._control_m)
        moved = arc_end(
            replace(self.pose, x_m=control.x_m, y_m=control.y_m),
            self.velocity.travel_mps * passed_s,
            self.velocity.rotate_radps * passed_s,
        )
        point = moved.ahead(-self._control_m)
        self.pose = replace(moved, x_m=point.x_m, y_m=point.y_m)


class DelegatedMotionBase(StationaryBase):
    """Base that executes whole motions one after the other, uniformly and exactly.

    Each motion starts with a speed and a motion message, or a velocity to hold, and ends with a
    message. Each of these messages takes half of the latency.
    """

    def __init__(self, clock: ManualClock, settings: Settings, pose: Pose) -> None:
        super().__init__(clock, settings, pose)
        self._message_s = settings.turn_drive.latency_s / 2
        self._motion: DelegatedMotion | None = None
        self._from = pose
        self._begins_s = 0.0
        self._ended: MotionEnded | None = None

    def execute_motion(self, motion: DelegatedMotion) -> None:
        """Start a motion."""
        self._motion, self._from = motion, self.pose
        messages = 1 if isinstance(motion.primitive, VelocityHold) else 2
        self._begins_s = self._clock.now_s() + messages * self._message_s

    def halt(self) -> None:
        """Stop immediately."""
        self._motion, self.velocity = None, STANDING

    def advance(self) -> None:
        """Advance to the clock's time."""
        if self._motion is None:
            return
        profile = profile_of(self._motion.primitive, self._settings.drive)
        since_s = self._clock.now_s() - self._begins_s
        held_s, whole = profile.held_s(since_s), profile.velocity
        self.pose = arc_end(self._from, whole.travel_mps * held_s, whole.rotate_radps * held_s)
        self.velocity = whole if 0.0 < since_s < profile.duration_s else STANDING
        if since_s >= profile.duration_s + self._message_s:
            self._ended = MotionEnded(self._motion.number, executed=True)
            self._motion = None

    def facts(self) -> tuple[Fact, ...]:
        """Return the facts that it reports now, and the end of a motion once."""
        ended, self._ended = self._ended, None
        return super().facts() if ended is None else (ended, *super().facts())


class DynamicModelBase(StationaryBase):
    """Base that responds to velocities by the dynamic model of mpc."""

    def __init__(self, clock: ManualClock, settings: Settings, pose: Pose) -> None:
        super().__init__(clock, settings, pose)
        self._model = model_of(settings)
        self._delay_s = settings.mpc.command_delay_s
        control = pose.ahead(self._model.ahead_m)
        self._state = MotionState(control.x_m, control.y_m, pose.heading_rad)
        self._pending: deque[tuple[float, Velocity]] = deque()
        self._last_s = -inf

    def drive(self, velocity: Velocity) -> None:
        """Apply a velocity command, which takes effect in a ramp as long as a tick."""
        due_s = self._clock.now_s() + self._delay_s
        begins_s = due_s - self._settings.tick_s
        if begins_s > self._last_s + TIME_RESOLUTION_S:
            last = self._pending[-1][1] if self._pending else self._commanded
            self._pending.append((begins_s, last))
        self._pending.append((due_s, velocity))
        self._last_s = due_s

    def advance(self) -> None:
        """Advance to the clock's time."""
        now_s = self._clock.now_s()
        while self._pending and self._pending[0][0] <= now_s:
            due_s, velocity = self._pending.popleft()
            self._move(due_s, velocity)
        if self._pending:
            due_s, velocity = self._pending[0]
            part = (now_s - self._at_s) / (due_s - self._at_s)
            self._move(now_s, self._commanded.interpolate(velocity, part))
        else:
            self._move(now_s, self._commanded)
        state, model = self._state, self._model
        heading_rad = wrap_rad(state.heading_rad)
        control = Pose(state.x_m, state.y_m, heading_rad=heading_rad)
        point = control.ahead(-model.ahead_m)
        self.pose = replace(self.pose, x_m=point.x_m, y_m=point.y_m, heading_rad=heading_rad)
        turning_radps = model.true_rotation(state.rotate_radps, state.lag_radps)
        self.velocity = Velocity(state.travel_mps, turning_radps)

    @property
    def _commanded(self) -> Velocity:
        return Velocity(self._state.travel_mps, self._state.rotate_radps)

    def _move(self, until_s: float, velocity: Velocity) -> None:
        """Advance to a time, with a command in effect."""
        step_s, self._at_s = until_s - self._at_s, max(until_s, self._at_s)
        if step_s > TIME_RESOLUTION_S:
            self._state = self._model.state_after(self._state, velocity, step_s)


class CachedTrajectorySolver:
    """A `TrajectorySolver` for a copy, which follows its trajectories exactly; it rarely solves."""

    def __init__(self, solver: TrajectorySolver) -> None:
        self._solver = solver
        self.lead_ticks = solver.lead_ticks
        self._plan: Trajectory | None = None
        self._rest: Trajectory | None = None

    @property
    def busy(self) -> bool:
        """Whether a trajectory is still being computed."""
        return self._rest is None and self._solver.busy

    def request(self, problem: TrajectoryProblem) -> None:
        """Reuse the remainder of the last trajectory, or have the problem solved."""
        self._rest = self._remainder(problem)
        if self._rest is None:
            self._solver.request(problem)

    def _remainder(self, problem: TrajectoryProblem) -> Trajectory | None:
        """Return the remainder of the last trajectory; None if it is outdated, or no solution."""
        plan, guess = self._plan, problem.guess
        if plan is None or guess is None or len(guess.via_times_s) < len(problem.via_points):
            return None
        driven_s = plan.duration_s - guess.duration_s
        return (
            plan.remainder(driven_s, len(guess.via_times_s))
            if driven_s < TRAJECTORY_REUSE_S
            else None
        )

    def take_result(self) -> Trajectory | None:
        """Return the result of the last request, once."""
        if self._rest is not None:
            rest, self._rest = self._rest, None
            return rest
        plan = self._solver.take_result()
        if plan is not None:
            self._plan = plan
        return plan
