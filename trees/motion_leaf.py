"""`MotionLeaf`, base class of the leaves for motions: runs a motion, and verifies its end."""

from typing import Final

from py_trees.common import Status

from executive.checks import check_battery, check_pose
from executive.commands import ABOARD_LINK
from executive.commands import Motion as CommandedMotion
from executive.goals import Context
from executive.motion import WAIT_S, Motion, NavigatedMotion, Verified
from executive.obstacles.detour import Scene
from executive.state import join_sources
from executive.values.geometry import STANDING, Pose
from executive.values.reasons import Figure, Reason, Refusal
from trees.leaf import STOP_DEADLINE_S, GoalLeaf, beside_odometry, refusal, unconfirmed

MARGIN_S = 5.0
MAX_ATTEMPTS = 3
MAX_DETOURS = 20
"""Maximum detours to one target that a new obstacle may interrupt; chosen, not measured."""
MAX_START_AGE_RATIO = 0.5
"""Maximum odometry age at the start of a motion, as a ratio of the stale age; chosen."""
MAP_WAIT_S: Final = 3.0
"""Maximum wait of a navigated motion for the transform: the navigation needs it, too."""
WAITING_FOR_MAP: Final = "waiting for the transform from map to odom"
SLID_M, SLID_PER_M = 0.1, 0.05
"""Slide tolerance of a rover without second odometry, constant and per metre of its path."""


class MotionLeaf(GoalLeaf):
    """A leaf that executes a part of a motion goal."""

    timeout_reason = Reason.DRIVE_DEADLINE

    def __init__(self, name: str, context: Context) -> None:
        super().__init__(name, context, context.goals.motion)
        self.timeout_text = f"{name}: not done"

    def on_timeout(self) -> Status:
        """Fail the goal on timeout, with the reason of the map if that is lost."""
        lost = self.context.lost_map
        if self.goal.leg.navigation is not None:
            self.timeout_text = f"{self.name}: not done ({self.feedback_message})"
        return super().on_timeout() if lost is None else self.fail(lost)

    def _hold_for_map(self) -> bool:
        """Hold while the map is lost, as long as for a second-odometry frame; report it once."""
        goal = self.goal
        before, goal.waits_for_map = goal.waits_for_map, self.context.lost_map is not None
        if before is not goal.waits_for_map:
            short = goal.waits_for_map and self.context.locomotion.navigates(goal.command)
            self.set_deadline(MAP_WAIT_S if short else self._deadline_for(WAIT_S))
        if goal.waits_for_map:
            self.feedback_message = WAITING_FOR_MAP
            self.context.intents.motion = STANDING
            if not before:
                goal.lifecycle.advance(goal.progress.step, goal.step_count, WAITING_FOR_MAP)
        return goal.waits_for_map

    @property
    def _navigates(self) -> bool:
        """Whether the navigation drives the next leg."""
        return (
            self.context.locomotion.navigates(self.goal.command)
            and not self.goal.progress.finishing
        )

    @property
    def _executed_by_relay(self) -> bool:
        """Whether the rover received the command over another link, and executes it."""
        return self.context.status.executed_by_relay == self.goal.command.identity

    @property
    def _evidence_sources(self) -> str:
        """Return the pose sources that confirm the motion."""
        second = [] if self.context.status.fusion is None else ["second odometry"]
        return join_sources(["odometry", *second])

    def _from_where(self, start: Pose) -> str:
        """Return the start pose of a motion as text if the pose is uncertain; otherwise empty."""
        uncertainty = self.context.status.uncertainty
        text = f", from ({start.x_m:.2f}, {start.y_m:.2f}), uncertain by {uncertainty}"
        return text if uncertainty else ""

    def _check_begin(self, pose: Pose, scene: Scene, longer_m: float = 0.0) -> Refusal | None:
        """Return a refusal if a goal may not start here, by pose or battery, or None.

        Args:
            pose: start pose.
            scene: the obstacles, and the detours around them.
            longer_m: by how much a planner's path exceeds the straight lines.
        """
        context, goal, status = self.context, self.goal, self.context.status
        request = goal.request
        if not goal.progress.new:
            return None
        assert isinstance(request, CommandedMotion)
        uncertain = check_pose(request, pose, status.uncertainty, context.settings)
        if uncertain is not None or goal.command.link == ABOARD_LINK:
            return uncertain
        return check_battery(request, pose, status, context.settings, scene, longer_m)

    @property
    def _odometry_late(self) -> bool:
        """Return whether odometry is too old to start a motion."""
        bound_s = self.context.settings.faults.odometry_stale.bound
        return self.context.status.odometry_age_s > MAX_START_AGE_RATIO * bound_s

    @property
    def _slid_m(self) -> float:
        """Distance slid since the start, less the tolerance for its path."""
        over_ground = self.context.safety.history.over_ground
        slid_m = 0.0 if over_ground is None else over_ground.slid_m
        return slid_m - SLID_PER_M * self.context.status.travelled_m

    def _note_motion_end(self) -> None:
        """Note the end of the motion, before its verification."""
        self._ended_s = self.context.clock.now_s()

    def _verify(self) -> Verified | Refusal | None:
        """Hold, and return the result of the pose sources; None while one is awaited."""
        context, verification = self.context, self.goal.verification
        waited_s = context.clock.now_s() - self._ended_s
        over_ground = context.safety.history.over_ground
        if verification is not None and over_ground is not None and over_ground.apart_s:
            verification.on_slide()
        found = beside_odometry(context)
        outcome: Verified | Refusal | None = Verified(())
        if left := unconfirmed(context, found):
            self.feedback_message = left
            late = waited_s >= STOP_DEADLINE_S
            outcome = refusal(context, found, STOP_DEADLINE_S) if late else None
        elif verification is not None:
            self.feedback_message = "waiting for a second-odometry frame"
            outcome = verification.result(waited_s)
        elif (slid_m := self._slid_m - self.goal.slid_m) > SLID_M:
            text = f"the rover slid {slid_m:.2f} m by its accelerometer, not measured by its wheels"
            figures = Figure("slid", slid_m, "m"), Figure("bound", SLID_M, "m")
            outcome = Refusal(Reason.SLIDE_AT_REST, text, figures)
            context.status.grow_uncertainty(slid_m, 0.0, text)
        if outcome is None:
            context.intents.motion = STANDING
        return outcome

    def _deadline_for(self, expected_s: float) -> float:
        return 2.0 * expected_s + MARGIN_S

    def _begin(self, motion: Motion | None) -> float:
        self._motion, self._noticed, self._passed = motion, False, 0
        return self._deadline_for(0.0) if motion is None else self._allowed_s(motion)

    def _allowed_s(self, motion: Motion) -> float:
        return self._deadline_for(motion.expected_s) + motion.extra_s

    def _run_motion(self, standing: bool) -> Status:
        """Set the intents of a motion until it has ended, or the next may start."""
        motion, goal = self._motion, self.goal
        if motion is not None:
            if goal.leg.navigation is not None:
                goal.localize(self.context.status, self.context.settings)
                motion.observe(goal.leg)
            for _ in range(motion.waypoints_passed - self._passed):
                self._advance()
            self._passed = motion.waypoints_passed
            if motion.aborted:
                self._on_abort(motion)
                return Status.FAILURE
        if motion is None or (motion.done if standing else motion.handover_allowed):
            if isinstance(motion, NavigatedMotion):
                goal.end_navigation(motion.report, motion.figures)
            return Status.SUCCESS
        if motion.failure is not None:
            return self.fail(motion.failure)
        now_s = self.context.clock.now_s()
        goal.progress.last_driven = self.context.status.pose.point
        if self.context.lost_map is not None and not self._executed_by_relay:
            return Status.FAILURE  # PlanLeg holds until the map returns
        if motion.update_limits(now_s) or self._executed_by_relay:
            self.set_deadline(self._allowed_s(motion))
        self.context.intents.motion = motion.intent(now_s)
        self.feedback_message = motion.remaining_text
        if motion.progress_note is not None and not self._noticed:
            self._noticed = True
            goal.lifecycle.advance(goal.progress.step, goal.step_count, motion.progress_note)
        return Status.RUNNING

    def _on_abort(self, motion: Motion) -> None:
        """Select how the goal continues after an abandoned motion."""
        progress, through = self.goal.progress, bool(self.goal.leg.via_points)
        progress.left_path = True
        if motion.retry_as_curve and not through and progress.obstacle_stops < MAX_DETOURS:
            progress.stop_before(progress.blocking)
        else:
            radius_m = self.context.settings.drive.min_turning_radius_m
            again = radius_m is not None and progress.attempts < MAX_ATTEMPTS
            progress.abandon_curve(through or again)

    def _advance(self) -> None:
        """Count a step of the goal, and report it unless it is the last."""
        goal, progress = self.goal, self.goal.progress
        progress.end_step()
        if progress.step < goal.step_count:
            text = f"waypoint {progress.step} of {goal.step_count} reached"
            goal.lifecycle.advance(progress.step, goal.step_count, text)
