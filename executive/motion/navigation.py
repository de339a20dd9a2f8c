"""A navigation below: `NavigationLocomotion` makes its motions, `NavigationDriver` has its gate.

The navigation drives the first attempt of a leg; from its end the executive drives the rest itself.
Its reports are neither needed nor sufficient for the success of a motion: the leg ends where
odometry shows the rover. At each end the gate is shut first, then all goals are cancelled; nothing
waits for an answer to that.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from math import inf, pi
from typing import Final

from executive.commands import Command, DriveFor, Waypoint, requested_controller
from executive.motion.locomotion import (
    Bounds,
    Leg,
    Locomotion,
    Motion,
    duration_s,
    leg_errors,
    turn_bounds,
)
from executive.motion.relative_actions import remaining_action
from executive.motion.route import passes_within
from executive.motion.velocity_control import VelocityDriver, VelocityLocomotion
from executive.settings import Controller, NavigationGate, NavigationSettings, Settings
from executive.state import NavigationTrack, Status
from executive.values.clock import Clock
from executive.values.facts import NavigationState, NavigationStatus
from executive.values.geometry import (
    STANDING,
    Point,
    Pose,
    TargetFrame,
    Velocity,
    path_length_m,
)
from executive.values.ports import MotionIntent, NavigateTo, NavigationGoal, NavigationRover
from executive.values.quantities import angle_text
from executive.values.reasons import Figure, Reason, Refusal

REPEAT_S: Final = 1.0
"""Time without an answer after which a goal is requested again: DDS lost 3 of 6 requests that were
sent 0.45 s after the start of their server, for good."""
ANSWER_S: Final = 4.9
"""Time without any answer after which a motion fails."""
SILENCE_S: Final = 3.0
"""Maximum time without feedback: it arrives at 10 to 100 Hz."""
MOVING_SILENCE_S: Final = 1.0
"""The same while the navigation commands a velocity: its smoother repeats the last one for 1 s."""
STANDING_S: Final = 2.0
"""Time at standstill within reach of the target until the executive drives the rest."""
PREEMPTION_S: Final = 0.3
"""Time from an end without an error code until the goal of another client must be seen."""
SETTLE_S: Final = 0.3
"""Time from a cancellation of all goals to the next request, which it must not reach."""
RELAYED_S: Final = 0.2
"""Maximum age of a velocity of the navigation that is relayed."""
TURN_REACH_RAD: Final = 0.25
"""Maximum angle of a turn at standstill from its heading, to count as ended: Nav2's tolerance."""
BRAKING_S: Final = 0.6
"""Time from the shut gate to standstill: the velocity is not known."""
UNKNOWN: Final = Velocity(-inf, -inf), Velocity(inf, inf)
"""The expected velocity while the navigation drives through a mux."""


class NavigationLocomotion(Locomotion):
    """Makes motions of the navigation, and all others by the rover's own locomotion.

    Args:
        own: drives everything that is not navigated.
    """

    excludes_camera = False

    def __init__(
        self, clock: Clock, settings: Settings, status: Status, own: VelocityLocomotion
    ) -> None:
        assert settings.navigation is not None
        self._clock = clock
        self._settings = settings
        self._navigation = settings.navigation
        self._status = status
        self._own = own
        self._numbers = count(1)

    def navigates(self, command: Command) -> bool:
        """Return whether the navigation drives the legs of a command."""
        chosen = requested_controller(command.request, self._settings.controller)
        return chosen is Controller.NAVIGATION

    def supports_curve(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether the rover's own locomotion drives to a waypoint in one curve."""
        return self._own.supports_curve(command, waypoint)

    def can_pass_through(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether a waypoint is passed: the navigation passes within `passing_m`."""
        if not self.navigates(command):
            return self._own.can_pass_through(command, waypoint)
        wide = (waypoint.tolerance_m or 0.0) >= self._navigation.passing_m
        return wide and waypoint.heading_rad is None

    def make_turn(self, command: Command, leg: Leg, final: bool) -> Motion | None:
        """Return the turn of a leg; the navigation makes those of its legs itself."""
        return None if leg.navigation is not None else self._own.make_turn(command, leg, final)

    def make_line(self, command: Command, leg: Leg) -> Motion | None:
        """Return the motion of a navigated leg, or the line of another one."""
        if leg.navigation is None:
            return self._own.make_line(command, leg)
        return NavigatedMotion(
            leg, command, self._numbers, self._clock, self._settings, self._status
        )

    def make_velocity_hold(self, command: Command, request: DriveFor) -> Motion:
        """Return a velocity hold."""
        return self._own.make_velocity_hold(command, request)


def navigate_to(leg: Leg, end: Waypoint, start: Pose, origin: Pose, frame: TargetFrame) -> Leg:
    """Return a leg that the navigation drives.

    A pose cannot express that any heading will do: it has the direction from the pose before.

    Args:
        leg: the leg as planned.
        end: its end.
        start: present pose.
        origin: origin of the frame, in the frame of `start`.
        frame: the frame of the poses that are sent.
    """
    into, poses, before = origin.inverse, [], start.point
    for each in (*leg.via_points, end):
        point = Point(each.x_m, each.y_m)
        heading_rad = before.bearing_rad(point) if each.heading_rad is None else each.heading_rad
        poses.append(into.compose(Pose(point.x_m, point.y_m, heading_rad=heading_rad)))
        before = point
    return replace(leg, navigation=NavigateTo(tuple(poses), frame))


class NavigatedMotion(Motion):
    """One goal of the navigation, until the rover is stationary at its end, by odometry.

    The goal is requested again under a new number while there is no answer. Success is a hint to
    compare; so is standstill within reach of the target.

    Attributes:
        report: report of the navigation at the end, and distance there; empty before.
    """

    def __init__(
        self,
        leg: Leg,
        command: Command,
        numbers: Iterator[int],
        clock: Clock,
        settings: Settings,
        status: Status,
    ) -> None:
        assert leg.navigation is not None
        assert status.navigation is not None
        assert settings.navigation is not None
        self._leg = self._end_leg = leg
        self._task = leg.navigation
        self._command, self._numbers = command, numbers
        self._clock, self._settings, self._status = clock, settings, status
        self._navigation: NavigationSettings = settings.navigation
        self._track: NavigationTrack = status.navigation
        self._begun_s = clock.now_s()
        self._goal = self._next_goal()
        self._sent = self._accepted = self._ended = False
        self._standing_s: float | None = None
        self._last_point = status.pose.point
        self._map_to_odom = status.map_to_odom
        self._failure: Refusal | None = None
        self.report = ""
        self.extra_s = self._navigation.recovery_s
        speed_mps = min(status.travel_limit_mps, self._navigation.speed_mps)
        bounds = Bounds(speed_mps, settings.drive.travel_acceleration_mps2)
        here = status.pose.point
        length_m = path_length_m(leg.path or (here, leg.target or here))
        turns_s = 2 * duration_s(pi, turn_bounds(settings, status))
        self.expected_s = duration_s(length_m, bounds) + turns_s

    def _next_goal(self) -> NavigationGoal:
        task = self._task
        if not isinstance(task, NavigateTo):
            task = remaining_action(self._leg, self._settings, self._status)
        return NavigationGoal(next(self._numbers), task, self._command.identity)

    @property
    def done(self) -> bool:
        """Whether it has ended near its target, and the rover is stationary."""
        return self._at_rest and not self._missed

    @property
    def aborted(self) -> bool:
        """Whether it has ended, but the rover has not passed all waypoints."""
        return self._at_rest and self._missed

    @property
    def _at_rest(self) -> bool:
        return self._ended and self._status.standing and self.failure is None

    @property
    def _reach_m(self) -> float:
        """Maximum distance from the target at the end of the navigation."""
        return max(self._navigation.finish_within_m, self._leg.tolerance_m)

    @property
    def _missed(self) -> bool:
        return self.waypoints_passed < len(self._leg.via_points)

    @property
    def failure(self) -> Refusal | None:
        """Why it failed: by the navigation's reports, or as it ended too far from the target."""
        if self._failure is not None or not self._ended:
            return self._failure
        # A leg that moves with the map after the end is compared once the rover is stationary.
        reach_m = self._reach_m
        off_m, off_rad = leg_errors(self._end_leg, self._settings, self._status)
        if not self._status.standing:
            travel_mps = self._status.velocity.travel_mps
            reach_m += travel_mps**2 / (2 * self._settings.drive.braking_mps2)
            reach_m += abs(travel_mps) * self._settings.turn_drive.latency_s
        if off_m <= reach_m:
            return None
        figures = (
            Figure("position error", off_m, "m"),
            Figure("bound", self._reach_m, "m"),
            Figure("heading error", off_rad, "rad"),
            *self.figures,
        )
        return Refusal(Reason.OFF_TARGET, self.report, figures)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Number of recoveries, and how far the odometry frame moved in the map."""
        found, feedback = [], self._track.feedback
        if feedback is not None and feedback.recoveries:
            found.append(Figure("recoveries", feedback.recoveries))
        then, now, at = self._map_to_odom, self._status.map_to_odom, self._status.odometry
        if then is not None and now is not None and at is not None:
            moved_m = then.compose(at.pose).point.distance_m(now.compose(at.pose).point)
            found.append(Figure("map moved", moved_m, "m"))
        return tuple(found)

    @property
    def avoids_obstacles(self) -> bool:
        """True: the navigation plans around them."""
        return True

    @property
    def remaining_text(self) -> str:
        """The goal, its state and its remaining path, as the server reports them."""
        return self.report or self._track.text or f"navigation goal {self._goal.number} waits"

    @property
    def _errors(self) -> tuple[float, float]:
        return leg_errors(self._leg, self._settings, self._status)

    def intent(self, _: float) -> MotionIntent:
        """Return the goal, or standstill once it has ended."""
        return STANDING if self._ended or self._failure is not None else self._goal

    def observe(self, leg: Leg) -> None:
        """Compare the rover with the leg, and obey the reports of the navigation."""
        self._leg = leg
        self._count_passed()
        if self._ended or self._failure is not None:
            return
        track, now_s = self._track, self._clock.now_s()
        if track.goal != self._goal:
            if self._sent:  # a stop ended it, and the motion continues
                self._goal, self._begun_s = self._next_goal(), now_s
                self._sent = self._accepted = False
            elif now_s - self._begun_s > ANSWER_S:
                text = "the navigation still commands a velocity, its goals are cancelled"
                self._fail(Reason.NAVIGATION_UNCOMMANDED_MOTION, text)
            return
        self._sent, answer = True, track.answer
        if answer is None or not (track.answered or self._accepted):
            self._await_answer(answer, now_s)
        elif answer.state is NavigationState.ACCEPTED:
            self._accepted = True
            self._check_active(now_s)
        else:
            self._obey_end(answer, now_s)

    def _count_passed(self) -> None:
        before, point = self._last_point, self._status.pose.point
        self._last_point = point
        while self._missed:
            via = self._leg.via_points[self.waypoints_passed]
            assert via.tolerance_m is not None
            if not passes_within(Point(via.x_m, via.y_m), via.tolerance_m, before, point):
                return
            self.waypoints_passed += 1

    def _await_answer(self, answer: NavigationStatus | None, now_s: float) -> None:
        """Request the goal again, or fail after too long without an answer."""
        waited_s = now_s - self._begun_s
        if waited_s > ANSWER_S:
            reason, what = Reason.NAVIGATION_TIMEOUT, "has not answered a goal"
            if answer is not None:
                reason, what = Reason.NAVIGATION_UNAVAILABLE, "is not available"
            text = f"the navigation {what} for {waited_s:.1f} s{_detail(answer)}"
            self._fail(reason, text, Figure("waited", waited_s, "s"))
        elif now_s - self._track.sent_s >= REPEAT_S - 1e-9 and not self._track.moves:
            # A navigation that drives has the goal, and its answer is late.
            self._goal, self._sent = self._next_goal(), False

    def _check_active(self, now_s: float) -> None:
        """Fail a goal without feedback; end one if the rover is stationary within reach."""
        silent_s = now_s - self._track.contact_s
        # A navigation that planned in silence has as long for its first feedback in motion.
        moving_s = now_s - max(self._track.contact_s, self._track.moving_since_s)
        is_silent_moving = self._track.moves and moving_s > MOVING_SILENCE_S
        bound_s = MOVING_SILENCE_S if is_silent_moving else SILENCE_S
        if silent_s > bound_s:
            text = f"the navigation accepted the goal, then reported nothing for {silent_s:.1f} s"
            figures = Figure("silent", silent_s, "s"), Figure("bound", bound_s, "s")
            self._fail(Reason.NAVIGATION_TIMEOUT, text, *figures)
            return
        off_m, off_rad = self._errors
        within = off_m <= self._reach_m and not self._missed
        if self._leg.target is None:
            within = off_rad <= TURN_REACH_RAD
        if not (within and self._status.standing):
            self._standing_s = None
        elif self._standing_s is None:
            self._standing_s = now_s
        elif now_s - self._standing_s >= STANDING_S:
            self._end(f"the navigation reported no end for {STANDING_S:g} s at standstill")

    def _obey_end(self, answer: NavigationStatus, now_s: float) -> None:
        """End or fail the motion by a terminal state."""
        track, state, off = self._track, answer.state, self._errors
        preempted = track.preempted_s >= track.sent_s and not answer.code
        if state is NavigationState.SUCCEEDED:
            self._end("the navigation reported success")
        elif state is NavigationState.ABORTED and self._is_reached(*off):
            self._end(f"the navigation reported a failure{_detail(answer)}")
        elif state is NavigationState.ABORTED and preempted:
            self._fail(*_FAILURES[NavigationState.PREEMPTED])
        elif state is not NavigationState.ABORTED or (
            answer.code or now_s - track.answer_s >= PREEMPTION_S  # the gate is shut already
        ):
            reason, text = _FAILURES[state]
            text = f"{text} {off[0]:.2f} m from the target{_detail(answer)}"
            self._fail(reason, text, Figure("code", answer.code))

    def _is_reached(self, off_m: float, off_rad: float) -> bool:
        near_rad = self._settings.turn_drive.heading_tolerance_rad
        within = off_m <= self._leg.tolerance_m and off_rad <= near_rad
        return within and self._status.standing and not self._missed

    def _end(self, text: str) -> None:
        self._ended, self._end_leg, (off_m, off_rad) = True, self._leg, self._errors
        off = f"{off_m:.2f} m" if self._leg.target is not None else angle_text(off_rad)
        self.report = f"{text} {off} from the target"

    def _fail(self, reason: Reason, text: str, *figures: Figure) -> None:
        off = Figure("position error", self._errors[0], "m")
        self._failure = Refusal(reason, text, (*figures, off, *self.figures))


_FAILURES: Final = {
    NavigationState.REJECTED: (Reason.NAVIGATION_REJECTED, "the navigation rejected the goal"),
    NavigationState.ABORTED: (Reason.NAVIGATION_FAILED, "the navigation aborted"),
    NavigationState.CANCELLED: (
        Reason.NAVIGATION_PREEMPTED,
        "another client cancelled the goal of the navigation",
    ),
    NavigationState.PREEMPTED: (
        Reason.NAVIGATION_PREEMPTED,
        "another client's goal replaced that of the executive",
    ),
    NavigationState.LOST: (Reason.NAVIGATION_TIMEOUT, "the navigation has lost the goal"),
    NavigationState.UNAVAILABLE: (Reason.NAVIGATION_TIMEOUT, "the navigation has ended"),
}


def _detail(answer: NavigationStatus | None) -> str:
    """Return code, its name and the message of a state, as the end of a sentence."""
    if answer is None:
        return ""
    code = f"{answer.code_name or 'code'} {answer.code}" if answer.code else ""
    parts = [each for each in (code, answer.text) if each]
    return f": {', '.join(parts)}" if parts else ""


class NavigationDriver:
    """Sends goals, and opens the gate while an accepted one is wanted; else `own` drives.

    Behind the lock of a mux the executive is silent while the gate is open. As a relay it sends the
    navigation's velocities within the rover's limits.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        status: Status,
        rover: NavigationRover,
        own: VelocityDriver,
    ) -> None:
        assert settings.navigation is not None
        assert status.navigation is not None
        self._clock = clock
        self._status = status
        self._rover = rover
        self._own = own
        self._track = status.navigation
        self._locks = settings.navigation.gate is NavigationGate.LOCK
        self._begun = 0
        self._cancelled_s = self._open_s = -inf

    @property
    def velocity(self) -> Velocity:
        """The velocity that is commanded now: as measured while the navigation drives."""
        driven = self._locks and self._track.is_open
        return self._status.velocity if driven else self._own.velocity

    @property
    def expected(self) -> tuple[Velocity, Velocity]:
        """The bounds of the expected velocity; infinite if the navigation drives by itself."""
        recent = self._clock.now_s() - self._open_s <= BRAKING_S
        if self._locks and recent and self._own.velocity == STANDING:
            return UNKNOWN
        return self._own.expected

    def shut(self) -> None:
        """Shut the gate and send zero; the goal continues with the next tick."""
        self._set_gate(False)
        self._own.stop()

    def stop(self) -> None:
        """Shut the gate, send zero, cancel all goals."""
        self.shut()
        if self._track.goal is not None:
            self._cancel()

    def hold(self) -> None:
        """Hold the gate shut, and zero velocity."""
        self.shut()
        self._cancel_remaining()

    def commit(self, wanted: MotionIntent | None, now_s: float, step_s: float) -> None:
        """Command the intent of this tick."""
        if not isinstance(wanted, NavigationGoal):
            if self._track.goal is not None:
                self.stop()
                wanted = wanted or STANDING
            self._set_gate(False)
            self._cancel_remaining()
            self._own.commit(wanted, now_s, step_s)
            return
        if wanted.number > self._begun and self._is_ready(now_s):
            self._begun = wanted.number
            self._track.begin(wanted)
            self._rover.navigate(wanted)
        is_open = self._track.goal == wanted and self._track.accepted
        is_open = is_open and self._status.odometry_fresh
        if self._locks and self._own.velocity != STANDING:
            is_open = False
        self._set_gate(is_open)
        self._cancel_remaining()
        if not (self._locks and is_open):
            self._own.commit(self._own_velocity(now_s), now_s, step_s)

    def _own_velocity(self, now_s: float) -> Velocity | None:
        """Return the velocity to send: that of the navigation, or zero; None before the answer."""
        track, recent = self._track, now_s - self._track.velocity_s <= RELAYED_S
        if track.is_open and recent:
            return track.velocity
        return STANDING if track.answered else None

    def _is_ready(self, now_s: float) -> bool:
        """Return whether a goal may be requested: the navigation must have ended all others."""
        return now_s - self._cancelled_s >= SETTLE_S and not self._track.moves

    def _cancel_remaining(self) -> None:
        """Cancel goals of before the start, and again while the navigation commands a velocity."""
        if self._cancelled_s == -inf:
            self._cancel()
            return
        waited_s = self._clock.now_s() - self._cancelled_s
        if self._track.goal is None and self._track.moves and waited_s >= REPEAT_S:
            self._cancel()

    def _cancel(self) -> None:
        self._cancelled_s = self._clock.now_s()
        self._track.end()
        self._rover.cancel_navigation()

    def _set_gate(self, is_open: bool) -> None:
        self._track.is_open = is_open
        self._rover.open_gate(is_open)
        if is_open:
            self._open_s = self._clock.now_s()
