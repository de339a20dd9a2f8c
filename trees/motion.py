"""Leaves for motions: plan a leg of a goal, turn, drive, hold a velocity, finish the leg."""

from dataclasses import replace
from functools import partial
from itertools import count
from typing import Final

from py_trees.common import Status

from executive.checks import (
    avoided_obstacles,
    check_request,
    check_target,
    check_turns,
    leg_detour,
    scanned_obstacle_ahead,
    turning_curves,
)
from executive.commands import (
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    RotateBy,
    RotateTo,
    Waypoint,
    is_absolute,
)
from executive.goals import Context, Goal
from executive.motion import (
    FUSED_TOLERANCE_M,
    TURN_TOLERANCE_M,
    WAIT_S,
    Locomotion,
    MotionVerification,
    Step,
    Verified,
    act_relatively,
    finish_relative,
    hold_extent,
    leg_errors,
    navigate_to,
    passes_within,
    plan_leg,
)
from executive.obstacles.detour import Scene
from executive.obstacles.zones import ClearanceViolation
from executive.settings import Controller
from executive.values.geometry import STANDING, Point, Pose, arc_end, wrap_rad
from executive.values.ports import PLANNER_WAIT_S
from executive.values.quantities import angle_text
from executive.values.reasons import Figure, Reason, Refusal
from trees.motion_leaf import MAX_ATTEMPTS, MAX_DETOURS, MotionLeaf
from trees.planner_path import PathPlanning

EXTERNAL_START_WINDOW_S = 0.5
"""Time for a rover to report that it already executes the command from another link."""


def _next_step(goal: Goal, locomotion: Locomotion) -> tuple[Step, tuple[Waypoint, ...]]:
    """Return the step with the next standstill at its end, and the waypoints to pass before it.

    A missed waypoint is retried on its own.
    """
    match goal.request:
        case MoveTo(target):
            return target, ()
        case FollowPath(waypoints):
            left, passed = waypoints[goal.progress.step :], 0
            passes = partial(locomotion.can_pass_through, goal.command)
            while not goal.progress.attempts and passed + 1 < len(left) and passes(left[passed]):
                passed += 1
            return left[passed], left[:passed]
        case MoveForward() | RotateTo() | RotateBy() as step:
            return step, ()
        case other:
            raise TypeError(f"{other} has no leg")


HEADING_TOLERANCE_RAD = 0.08
"""Heading tolerance at the end of a leg, or of a held velocity."""
HOLD_TRAVEL_TOLERANCE_M, HOLD_TRAVEL_TOLERANCE_PER_M = 0.08, 0.02
"""Distance tolerance of a held velocity, constant and per metre."""
HOLD_POSITION_TOLERANCE_M, HOLD_POSITION_TOLERANCE_PER_M = 0.12, 0.04
"""Position tolerance at the end of the arc of a held velocity, constant and per metre."""


class PlanLeg(MotionLeaf):
    """Waits for standstill, then plans the leg from there."""

    def __init__(self, name: str, context: Context) -> None:
        super().__init__(name, context)
        self._path_numbers = count(1)

    def begin(self) -> float:
        """Allow the time of a stop from full speed, and of the wait for a second odometry."""
        context, goal = self.context, self.goal
        self._begun_s = context.clock.now_s()
        self._scene: tuple[Step, tuple[Waypoint, ...], Pose, Scene] | None = None
        self._planning: PathPlanning | None = None
        if goal.progress.new:
            goal.verification = MotionVerification.begin(context.settings, context.status)
            goal.slid_m = self._slid_m
        return self._deadline_for(0.0 if goal.verification is None else WAIT_S)

    def act(self) -> Status:
        """Hold, unless this command already moves the rover; then plan."""
        now_s = self.context.clock.now_s()
        if self._executed_by_relay:
            self.set_deadline(self._deadline_for(0.0))
            self.feedback_message = "executed over the relay link"
            return Status.RUNNING
        if self._odometry_late or not self.context.status.standing:
            if now_s - self._begun_s >= EXTERNAL_START_WINDOW_S:
                self.context.intents.motion = STANDING
            return Status.RUNNING
        verification = self.goal.verification
        if verification is not None and not verification.ready(now_s - self._begun_s):
            self.feedback_message = "waiting for a second-odometry frame"
            return Status.RUNNING
        if self._hold_for_map():
            return Status.RUNNING
        goal, status, settings = self.goal, self.context.status, self.context.settings
        if goal.progress.finishing and (left := finish_relative(goal.leg, settings, status)):
            goal.leg = left
            return Status.SUCCESS
        if self._scene is None:  # a search continues from its first scene
            goal.localize(status, settings)
            self._count_passed_waypoints()
            self._limit_finish()
            step, through = _next_step(goal, self.context.locomotion)
            self._scene = step, through, status.pose, self.context.scene
            if isinstance(step, Waypoint) and self._navigates:
                self._planning = PathPlanning(
                    self.context, goal, (*through, step), self._path_numbers
                )
                self.set_deadline(self._deadline_for(PLANNER_WAIT_S))
        step, through, pose, scene = self._scene
        self.context.detours.undecided = False
        planned = None if self._planning is None else self._planning.path()
        if self._planning is not None and planned is None:
            self.feedback_message = "waiting for the planner's path"
            self.context.intents.motion = STANDING
            return Status.RUNNING
        detour: tuple[Waypoint, ...] | Refusal
        if planned is None:
            path = goal.request, goal.progress.left_path, step, through
            detour = leg_detour(*path, pose, settings, scene)
        else:
            detour = planned.check(self.context) or ()
        refusal = self._check_begin(pose, scene, 0.0 if planned is None else planned.longer_m)
        if self.context.detours.undecided:
            self.feedback_message = "searching for a detour"
            self.context.intents.motion = STANDING
            return Status.RUNNING
        if isinstance(detour, Refusal):
            return self.fail(detour)
        if refusal is not None:
            return self.fail(refusal)
        progress, supported = goal.progress, self.context.locomotion.supports_curve
        one_curve = isinstance(step, Waypoint) and supported(goal.command, step)
        in_one = planned is None and one_curve and not progress.turn_then_drive
        if isinstance(step, Waypoint) and not in_one and planned is None:
            rest = FollowPath((*detour, step), Controller.TURN_DRIVE)
            tight = check_turns(rest, status.pose, settings, status.obstacles)
            if tight is not None:
                return self.fail(tight)
        self._report_detour(detour, in_one)
        if progress.at_detour:
            leg = plan_leg(detour[0], settings, status)
        else:
            around = tuple(Point(each.x_m, each.y_m) for each in detour)
            leg = plan_leg(step, settings, status, through, around, planned is not None)
        if planned is not None and isinstance(step, Waypoint) and leg.target is not None:
            leg = navigate_to(leg, step, status.pose, *goal.target_frame(status))
        curves = turning_curves(step, status.pose, settings, status.obstacles.known)
        leg = act_relatively(replace(leg, curves=curves), step, settings, status)
        goal.leg = replace(
            leg,
            force_turn_then_drive=progress.turn_then_drive or progress.at_detour,
            path=() if planned is None else planned.points,
        )
        if planned is not None:
            goal.lifecycle.advance(progress.step, goal.step_count, str(planned))
        goal.start_pose = status.pose
        if progress.untried:
            goal.origin = status.pose
            goal.navigation_report, goal.navigation_figures = "", ()
        return Status.SUCCESS

    def _count_passed_waypoints(self) -> None:
        """Count the waypoints that the rover passed without a motion: while braking for a pause."""
        goal, progress, now = self.goal, self.goal.progress, self.context.status.pose.point
        before, progress.last_driven = progress.last_driven, None
        drive, law = self.context.settings.drive, self.context.settings.turn_drive
        braking_m = drive.travel_speed_mps**2 / drive.travel_acceleration_mps2
        if before is None or progress.attempts or before.distance_m(now) > braking_m:
            return
        _, through = _next_step(goal, self.context.locomotion)
        for each in through:
            near_m = each.tolerance_m or law.position_tolerance_m
            if not passes_within(Point(each.x_m, each.y_m), near_m, before, now):
                return
            self._advance()

    def _limit_finish(self) -> None:
        """Let the navigation drive again if the rover is no longer near its target."""
        goal, navigation = self.goal, self.context.settings.navigation
        step, _ = _next_step(goal, self.context.locomotion)
        if navigation is not None and goal.progress.finishing and isinstance(step, Waypoint):
            off_m = self.context.status.pose.point.distance_m(step.point)
            goal.progress.finishing = off_m <= navigation.finish_within_m

    def _report_detour(self, path: tuple[Waypoint, ...], in_one: bool) -> None:
        """Report a detour once, and again after a new obstacle.

        A detour in one curve has no stops.
        """
        goal, progress = self.goal, self.goal.progress
        blocking = progress.blocking
        progress.begin_leg(bool(path), in_one)
        if path and (blocking is not None or progress.untried):
            what = "obstacles" if blocking is None else blocking.obstacle.label
            listing = ", ".join(f"({each.x_m:.2f}, {each.y_m:.2f})" for each in path)
            goal.lifecycle.advance(
                progress.step, goal.step_count, f"detour around {what} by {listing}"
            )


class Turn(MotionLeaf):
    """Turns on the spot: towards the target, or to the final heading."""

    timeout_reason = Reason.TURN_DEADLINE

    def __init__(self, name: str, context: Context, final: bool) -> None:
        super().__init__(name, context)
        self._final = final

    def begin(self) -> float:
        """Start the turn, if the leg has one."""
        return self._begin(
            self.context.locomotion.make_turn(self.goal.command, self.goal.leg, self._final)
        )

    def act(self) -> Status:
        """Continue until the heading is reached; a final turn ends at standstill."""
        return self._run_motion(standing=self._final)


class Drive(MotionLeaf):
    """Drives a line, until a new obstacle blocks it."""

    def begin(self) -> float:
        """Start the line, if the leg has one."""
        return self._begin(self.context.locomotion.make_line(self.goal.command, self.goal.leg))

    def act(self) -> Status:
        """Continue until the target is reached; end at standstill if no turn follows."""
        met = self._blocking_obstacle()
        if met is None:
            return self._run_motion(standing=self.goal.leg.heading_rad is None)
        progress = self.goal.progress
        progress.stop_before(met)
        if progress.obstacle_stops > MAX_DETOURS:
            text = f"path blocked by {met.obstacle.label} after {MAX_DETOURS} detours"
            figures = Figure("way", met.distance_m, "m"), Figure("gap", met.gap_m, "m")
            return self.fail(Refusal(Reason.PATH_BLOCKED, text, figures))
        return Status.FAILURE

    def _blocking_obstacle(self) -> ClearanceViolation | None:
        """Return the scanned obstacle that blocks the rest of a line to a target, or None."""
        goal, settings, status = self.goal, self.context.settings, self.context.status
        leg, motion = goal.leg, self._motion
        if leg.target is None or leg.toward_rad is None or self._executed_by_relay:
            return None
        if motion is None or motion.avoids_obstacles:
            return None
        end = Pose(leg.target.x_m, leg.target.y_m, heading_rad=leg.toward_rad)
        point = end.ahead(-settings.turn_drive.control_point_m)
        obstacles = avoided_obstacles(settings, status.obstacles)
        return scanned_obstacle_ahead(status.pose.point, point, settings, obstacles)


class FinishLeg(MotionLeaf):
    """Advances the goal to its next step, or ends it successfully.

    A missed waypoint is retried from the rover's present pose, up to `MAX_ATTEMPTS` times. A goal
    off its target never succeeds. A second odometry must agree with the whole goal.
    """

    def begin(self) -> float:
        """Allow the time of a second-odometry frame."""
        self._note_motion_end()
        return self._deadline_for(WAIT_S)

    def act(self) -> Status:
        """Complete the step, unless the rover ended off its target."""
        goal, progress = self.goal, self.goal.progress
        request, settings = goal.command.request, self.context.settings
        if self._hold_for_map():
            return Status.RUNNING
        verified: Verified | Refusal | None = Verified(())
        if progress.step + 1 == goal.step_count and not progress.at_detour:
            verified = self._verify()
            navigation = self.context.status.navigation
            if goal.navigation_report and navigation is not None and navigation.moves:
                self.feedback_message = "the navigation still commands a velocity"
                self.context.intents.motion = STANDING
                return Status.RUNNING
        if verified is None:
            return Status.RUNNING
        if isinstance(verified, Refusal):
            return self.fail(verified)
        goal.localize(self.context.status, settings)
        position_error_m, near_m, heading_rad = self._errors()
        if position_error_m > near_m or heading_rad > HEADING_TOLERANCE_RAD:
            progress.attempts += 1
            max_attempts = MAX_ATTEMPTS
            if not isinstance(request, MoveTo | FollowPath):
                max_attempts = 2 if progress.finishing else 1
            if progress.attempts < max_attempts:
                return Status.FAILURE
            text = f"off target by {position_error_m:.3f} m and {angle_text(heading_rad)}"
            figures = (
                Figure("position error", position_error_m, "m"),
                Figure("bound", near_m, "m"),
                Figure("heading error", heading_rad, "rad"),
                Figure("heading bound", HEADING_TOLERANCE_RAD, "rad"),
            )
            return self.fail(Refusal(Reason.OFF_TARGET, text, figures))
        if progress.at_detour:
            progress.end_detour()
            return Status.SUCCESS
        uncertain = self._uncertain()
        if uncertain is not None:
            return self.fail(uncertain)
        self._advance()
        if progress.step < goal.step_count:
            return Status.SUCCESS
        took_s = self.context.clock.now_s() - goal.started_s
        known_by = f"{self._evidence_sources}{self._from_where(goal.origin)}"
        known_by += f"; {goal.navigation_report}" if goal.navigation_report else ""
        self.queue.complete_active(
            f"{goal.command.name} done in {took_s:.2f} s, {known_by}",
            (
                Figure("duration", took_s, "s"),
                Figure("position error", position_error_m, "m"),
                Figure("heading error", heading_rad, "rad"),
                *self.context.status.pose_figures,
                *goal.map_figures(self.context.status),
                *goal.navigation_figures,
                *verified.figures,
            ),
        )
        return Status.SUCCESS

    def _uncertain(self) -> Refusal | None:
        """Return a refusal if the pose has become too uncertain for the step's target, or None."""
        status, goal, request = self.context.status, self.goal, self.goal.command.request
        if not is_absolute(request):
            return None
        distance_m = goal.origin.point.distance_m(status.pose.point)
        position_m = 0.0 if isinstance(request, RotateTo) else status.uncertainty.position_m
        return check_target(distance_m, position_m, status.uncertainty, self.context.settings)

    def _errors(self) -> tuple[float, float, float]:
        """Return the distance from the target, its tolerance, and the heading error.

        If the pose is corrected, a turn on the spot must end at its start position.
        """
        context, goal, leg = self.context, self.goal, self.goal.leg
        position_error_m, heading_rad = leg_errors(leg, context.settings, context.status)
        if isinstance(goal.command.request, MoveForward):
            turned_rad = context.status.pose.heading_rad - goal.start_pose.heading_rad
            heading_rad = abs(wrap_rad(turned_rad))
        near_m, fusion, pose = leg.tolerance_m, context.status.fusion, context.status.pose
        if fusion is not None and fusion.fused:
            near_m = max(near_m, FUSED_TOLERANCE_M)
            if leg.target is None and isinstance(goal.command.request, RotateTo | RotateBy):
                position_error_m, near_m = (
                    goal.start_pose.point.distance_m(pose.point),
                    TURN_TOLERANCE_M,
                )
            elif leg.target is None:
                ahead_m = context.settings.turn_drive.control_point_m
                position_error_m = goal.start_pose.ahead(ahead_m).distance_m(pose.ahead(ahead_m))
        return position_error_m, near_m, heading_rad


class HoldVelocity(MotionLeaf):
    """Holds a velocity for its time, then stops."""

    def begin(self) -> float:
        """Allow the time of the wait for odometry, and of the search of the path home."""
        self._begun = self._held = False
        self._scene: tuple[Pose, Scene] | None = None
        return self._deadline_for(0.0)

    def _hold(self, refusal: Refusal | None) -> None:
        command, request = self.goal.command, self.goal.command.request
        assert isinstance(request, DriveFor)
        status, settings = self.context.status, self.context.settings
        pose = status.pose
        self._blocked = refusal or check_request(request, pose, settings, *self.context.scene)
        self.goal.verification = MotionVerification.begin(settings, status)
        self.goal.slid_m = self._slid_m
        self._begun, self._wanted = True, hold_extent(request, status, settings)
        self._start, self._from = pose, self.context.safety.history.total_motion
        self.set_deadline(self._begin(self.context.locomotion.make_velocity_hold(command, request)))

    def act(self) -> Status:
        """Continue until its time is over and the rover is stationary."""
        if not self._begun:
            if self._odometry_late:
                return Status.RUNNING
            self._scene = self._scene or (self.context.status.pose, self.context.scene)
            self.context.detours.undecided = False
            refusal = self._check_begin(*self._scene)
            if self.context.detours.undecided:
                self.feedback_message = "searching for a detour"
                self.context.intents.motion = STANDING
                return Status.RUNNING
            self._hold(refusal)
        if self._blocked is not None:
            return self.fail(self._blocked)
        if not self._held:
            status = self._run_motion(standing=True)
            if status is not Status.SUCCESS:
                return status
            short = self._shortfall()
            if short is not None:
                return self.fail(short)
            self._held = True
            self._note_motion_end()
            self.set_deadline(self._deadline_for(WAIT_S))
        verified = self._verify()
        if verified is None:
            return Status.RUNNING
        if isinstance(verified, Refusal):
            return self.fail(verified)
        figures = (*self.context.status.pose_figures, *verified.figures)
        text = (
            f"velocity held for its time, {self._evidence_sources}{self._from_where(self._start)}"
        )
        self.queue.complete_active(text, figures)
        return Status.SUCCESS

    def _shortfall(self) -> Refusal | None:
        """Return a refusal if the motion by odometry deviates from the velocity, or None."""
        if self._wanted is None:
            return None
        (wanted_m, wanted_rad), (way0_m, turn0_rad) = self._wanted, self._from
        way1_m, turn1_rad = self.context.safety.history.total_motion
        distance_m, turn_rad = way1_m - way0_m, turn1_rad - turn0_rad
        end = arc_end(self._start, wanted_m, wanted_rad).point
        off_m = end.distance_m(self.context.status.pose.point)
        bound_m = HOLD_TRAVEL_TOLERANCE_M + HOLD_TRAVEL_TOLERANCE_PER_M * abs(wanted_m)
        off_bound_m = HOLD_POSITION_TOLERANCE_M + HOLD_POSITION_TOLERANCE_PER_M * abs(wanted_m)
        turned = abs(turn_rad - wanted_rad) <= HEADING_TOLERANCE_RAD
        if abs(distance_m - wanted_m) <= bound_m and turned and off_m <= off_bound_m:
            return None
        # Nothing here distinguishes a deviating rover from deviating odometry.
        self.context.status.grow_uncertainty(
            max(off_m, abs(distance_m - wanted_m)),
            abs(turn_rad - wanted_rad),
            "a drive that ended off its target",
        )
        return Refusal(
            Reason.OFF_TARGET,
            f"moved {distance_m:.2f} m and turned {angle_text(turn_rad)},"
            f" commanded {wanted_m:.2f} m and {angle_text(wanted_rad)};"
            f" {off_m:.2f} m from the end of the arc",
            (
                Figure("commanded", wanted_m, "m"),
                Figure("odometry", distance_m, "m"),
                Figure("bound", bound_m, "m"),
                Figure("turn commanded", wanted_rad, "rad"),
                Figure("turn", turn_rad, "rad"),
                Figure("turn bound", HEADING_TOLERANCE_RAD, "rad"),
                Figure("position error", off_m, "m"),
                Figure("position bound", off_bound_m, "m"),
            ),
        )


WHOLE_MOTIONS: Final[tuple[tuple[str, type, str, type[MotionLeaf]], ...]] = (
    ("velocity", DriveFor, "hold velocity", HoldVelocity),
)
"""Motions of one leaf, without legs: name, request, name of the leaf, leaf."""
