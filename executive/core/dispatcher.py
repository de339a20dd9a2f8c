"""`Dispatcher` accepts or rejects each command once; it becomes a goal, a latch or a setting."""

from dataclasses import replace
from typing import Final, assert_never

from executive.checks import check_battery, check_pose, check_request, expected_pose
from executive.commands import (
    ABOARD_LINK,
    ROS_LINK,
    ActivatePlan,
    CameraWork,
    Command,
    ConfirmPose,
    DeleteFile,
    ExecuteAction,
    InstantCommand,
    Motion,
    MoveFile,
    PlanRequest,
    PreemptionPolicy,
    Request,
    Resume,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    Setting,
    SetTravelSpeed,
    Stop,
)
from executive.commands.actions import parse_action
from executive.commands.intake import check_arguments, check_identity, localized, validate
from executive.commands.lifecycle import (
    Accepted,
    CommandLifecycle,
    Duplicate,
    Rejected,
    SubmitResult,
)
from executive.core.authority import Authority
from executive.core.pose_keeper import PoseKeeper
from executive.core.preconditions import Preconditions
from executive.core.reactions import Reactions
from executive.core.ros_clients import RosClients
from executive.goals import Context
from executive.plans import Planner, PlanNode
from executive.preview import Predictor
from executive.record import PRUNED, Ledger, LedgerError, Notifications, digest
from executive.state import Telemetry, Uncertainty
from executive.values.geometry import Pose
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, Severity

NOTHING_TO_RESUME: Final = Refusal(
    Reason.WRONG_MODE, "no stop or fault holds the rover: resume a plan by resumePlan"
)
OVERTAKEN: Final = Refusal(Reason.STOPPED, "overtaken by a stop that was created after it")
LEDGER_UNAVAILABLE: Final = Refusal(
    Reason.LEDGER_FAILED, "the ledger cannot be written: only a stop is executed"
)

MAX_SEARCH_TURNS: Final = 200
"""Maximum turns that a command waits: five searches to their ends, under half a second. A moving
rover that is to replace its motion repeats the search at each measurement."""
MAX_UNWRITTEN_BATCHES: Final = 200
"""Maximum commits of the ledger that wait for the disk; 10 s of reports in each tick at 20 Hz."""


class Dispatcher:
    """Accepts or rejects commands."""

    def __init__(
        self,
        context: Context,
        ledger: Ledger,
        notifications: Notifications,
        telemetry: Telemetry,
        planner: Planner,
        authority: Authority,
        predictions: Predictor,
        pose: PoseKeeper,
        reactions: Reactions,
    ) -> None:
        self._pose = pose
        self._reactions = reactions
        self._authority = authority
        self._predictions = predictions
        self._context = context
        self._ledger = ledger
        self._notifications = notifications
        self._telemetry = telemetry
        self._planner = planner
        self._preconditions = Preconditions(context, ledger)
        for queue in context.goals:
            queue.check_start = self._preconditions.check_start
        self._search_turns = 0
        self.ros_clients = RosClients(context, authority, notifications)

    def tick(self) -> None:
        """Update the authority once a tick."""
        self.ros_clients.tick()
        self._authority.tick()

    def submit(self, command: Command, overtaken: bool = False) -> SubmitResult:
        """Accept or reject a command.

        Args:
            command: the command; for a stop, `Reactions.stop` was called before.
            overtaken: whether a stop was served that arrived after the command. The rover is then
                STOPPED, so only a resume needs an extra check.
        """
        unusable = check_identity(command)
        if unusable is not None:
            return self._reject_unrecorded(command, unusable)
        if self._ledger.failing:
            return Rejected(ledger_refusal(command))
        behind = self._ledger.unwritten_batches
        if behind > MAX_UNWRITTEN_BATCHES and not isinstance(command.request, Stop):
            return Rejected(_backlog_refusal(behind, self._notifications.commit_wait_s))
        try:
            known = self._ledger.digest_of(command.identity)
            last = None if known is None else self._ledger.last_report(command.identity)
        except LedgerError:
            return Rejected(ledger_refusal(command))
        if last is not None and known == digest(command):
            self._notifications.resend(last)
            if isinstance(command.request, Stop):
                text = f"duplicate of {command.identity}: the rover was stopped again"
                self._notifications.report_event(
                    Severity.WARNING, text, Reason.DUPLICATE, foreign=True
                )
            return Duplicate(last)
        if known is not None:
            return self._reject_unrecorded(command, _duplicate_refusal(command.identity, known))
        lifecycle = CommandLifecycle(command, self._notifications.command)
        refusal = self._check(command, overtaken)
        if refusal is not None:
            refusal = _with_stop_note(refusal, command)
            lifecycle.reject(refusal)
            return Rejected(refusal)
        lifecycle.accept()
        self._accept(lifecycle)
        return Accepted(lifecycle)

    def awaits_detour(self, command: Command) -> bool:
        """Return whether a command is to be submitted in a later turn, when a search has ended.

        After `MAX_SEARCH_TURNS` it need not wait: the search ends when the motion begins.
        """
        detours, zones = self._context.detours, self._context.status.obstacles
        self._search_turns += 1
        searches = isinstance(command.request, Motion) and zones.not_empty
        if searches and self._search_turns <= MAX_SEARCH_TURNS:
            detours.undecided = False
            if self._check(command, overtaken=False) is None and detours.undecided:
                return True
        self._search_turns = 0
        return False

    def restore_settings(self) -> None:
        """Apply the settings again that the ledger holds."""
        for setting in self._ledger.last_settings():
            self._restore(setting)

    def _reject_unrecorded(self, command: Command, refusal: Refusal) -> Rejected:
        """Reject a command under the id of another: it has no life cycle reports."""
        refusal = _with_stop_note(refusal, command)
        self._notifications.report_event(
            Severity.WARNING, refusal.text, refusal.reason, refusal.figures, foreign=True
        )
        return Rejected(refusal)

    def _check(self, command: Command, overtaken: bool) -> Refusal | None:
        if not isinstance(command.request, Stop):
            if command.overtaken:
                return OVERTAKEN
            refusal = self.ros_clients.check(command) or self._authority.check_command(command)
            if refusal is not None:
                return refusal
        context = self._context
        if overtaken and isinstance(command.request, Resume):
            text = f"a later stop holds the rover: stopped by {context.latches.stopped_by}"
            return Refusal(Reason.CAUSE_PERSISTS, text, cause=context.latches.stop)
        if isinstance(command.request, Motion):
            found = localized(command.request, context.status, context.settings)
            if isinstance(found, Refusal):
                return found
            command = replace(command, request=found)
        refusal = validate(
            command,
            settings=context.settings,
            status=context.status,
            mode=context.mode_for(command),
            queued=len(context.goals),
            utc_s=context.clock.utc_s(),
        )
        if refusal is not None:
            return refusal
        start = self._expected_start_pose(command)
        return (
            self._preconditions.check_arrival(command, start)
            or check_pose(command.request, start, context.status.uncertainty, context.settings)
            or self._check_path(command)
            or self._check_state(command.request)
            or self._check_battery(command)
        )

    def _check_path(self, command: Command) -> Refusal | None:
        """Return a refusal if a motion is blocked at its expected start pose, or None."""
        request, context = command.request, self._context
        if not isinstance(request, Motion):
            return None
        pose = self._expected_start_pose(command)
        return check_request(request, pose, context.settings, *context.scene)

    def _check_battery(self, command: Command) -> Refusal | None:
        """Return a refusal if the battery lacks energy for a motion or plan with the return."""
        request, context = command.request, self._context
        what: Motion | PlanNode | None = None
        if isinstance(request, Motion) and command.link != ABOARD_LINK:
            what = request
        elif isinstance(request, ActivatePlan):
            what = self._planner.root(request.plan_id)
        if what is None or context.settings.battery is None:
            return None
        pose = self._expected_start_pose(command)
        return check_battery(what, pose, context.status, context.settings, context.scene)

    def _expected_start_pose(self, command: Command) -> Pose:
        """Return the expected pose of the rover when a motion begins."""
        context, status = self._context, self._context.status
        pose, goals = status.pose, context.goals.motion
        beside_others = command.link == ROS_LINK and self.ros_clients.has_other_motion
        if command.preemption is PreemptionPolicy.REPLACE and not beside_others:
            return pose
        return expected_pose(goals, pose, context.clock, context.settings, context.scene)

    def _check_state(self, request: Request) -> Refusal | None:
        """Return a refusal if the present state does not permit a request, or None."""
        if isinstance(request, PlanRequest):
            return self._planner.check_request(request)
        files = self._context.files
        match request:
            case Resume():
                return self._check_resume()
            case DeleteFile(path):
                return _refusal(files.find(path))
            case MoveFile(path, target):
                return _refusal(files.find(path)) or _refusal(files.target(target))
            case ExecuteAction(action):
                return _refusal(parse_action(action, self._context.video))
            case _:
                return None

    def _check_resume(self) -> Refusal | None:
        latches, safety = self._context.latches, self._context.safety
        by_fault = latches.hazard is not None or latches.paused is not None
        if not by_fault and latches.stopped_by is None:
            return NOTHING_TO_RESUME
        safety.history.reset_reference()
        danger = safety.unresolved_cause() if by_fault else None
        if danger is None:
            return None
        return Refusal(Reason.CAUSE_PERSISTS, f"not yet: {danger.text}", danger.figures)

    def _accept(self, lifecycle: CommandLifecycle) -> None:
        request, context = lifecycle.command.request, self._context
        if lifecycle.command.link == ROS_LINK and not isinstance(request, Stop):
            self.ros_clients.hold_authority()
        named = f"{lifecycle.command.identity} {lifecycle.command.name}"
        if isinstance(request, PlanRequest):
            lifecycle.start()
            lifecycle.execute(self._planner.apply(request, lifecycle.command.identity))
            return
        if isinstance(request, Motion | CameraWork | InstantCommand):
            if (
                isinstance(request, Motion)
                and lifecycle.command.preemption is PreemptionPolicy.REPLACE
            ):
                self._replace_motion(lifecycle.command)
            start = self._expected_start_pose(lifecycle.command)
            goal = context.goals.add(request, lifecycle, self._ledger.last_batch)
            goal.after = self._preconditions.pending(lifecycle.command)
            goal.localize(context.status, context.settings)
            if isinstance(request, Motion):
                self._predictions.predict_motion(goal, request, start)
        elif isinstance(request, Setting):
            lifecycle.start()
            self._apply_setting(request)
            if isinstance(request, SetPositionCompensation):
                self._pose.confirm(
                    Uncertainty(cause=named, confirmed_by=lifecycle.command.identity)
                )
            lifecycle.execute()
        elif isinstance(request, ConfirmPose):
            lifecycle.start()
            left = Uncertainty(
                request.position_m, request.heading_rad, named, lifecycle.command.identity
            )
            self._pose.confirm(left)
            lifecycle.execute()
        elif isinstance(request, Stop):
            lifecycle.start()
            context.latches.stopping.append(lifecycle)
        elif isinstance(request, Resume):
            lifecycle.start()
            self._reactions.resume()
            lifecycle.execute()
        else:
            assert_never(request)

    def _replace_motion(self, command: Command) -> None:
        """Cancel the motions that a command replaces: all, or those of ROS clients for theirs."""
        cause = command.identity
        refusal = Refusal(Reason.REPLACED, f"replaced by {cause}", cause=cause)
        if command.link == ROS_LINK:
            self.ros_clients.replace_motion(refusal)
        else:
            self._context.goals.motion.cancel_all(refusal)

    def _apply_setting(self, setting: Setting) -> None:
        status = self._context.status
        match setting:
            case SetTravelSpeed(speed_mps):
                status.travel_speed_mps = speed_mps
            case SetRotateSpeed(speed_radps):
                status.rotate_speed_radps = speed_radps
            case SetPositionCompensation(x_m, y_m, z_m, heading_rad):
                status.compensation = Pose(x_m, y_m, z_m, heading_rad)
                status.clear_local_map()
            case SetCameraRotateSpeed(speed_radps):
                status.camera_speed_radps = speed_radps
            case SetStatusInterval(interval_s):
                self._telemetry.set_interval(interval_s)
            case _:
                assert_never(setting)

    def _restore(self, setting: Setting) -> None:
        """Restore a setting from before a restart, if it is still within the asset's bounds."""
        refusal = check_arguments(setting, self._context.settings, self._context.status.pose.point)
        if refusal is None:
            self._apply_setting(setting)
        else:
            self._notifications.report_event(
                Severity.WARNING, f"stored setting is out of range and was dropped: {refusal.text}"
            )


def ledger_refusal(command: Command) -> Refusal:
    """Return the refusal of a command that the ledger failed to record."""
    return _with_stop_note(LEDGER_UNAVAILABLE, command)


def _backlog_refusal(behind: int, wait_s: float) -> Refusal:
    text = (
        f"{behind} commits of the ledger wait for the disk, more than {MAX_UNWRITTEN_BATCHES}, the"
        f" first for {wait_s:.1f} s: only a stop is executed; try again later"
    )
    figures = (Figure("waiting", behind), Figure("bound", MAX_UNWRITTEN_BATCHES))
    return Refusal(Reason.LEDGER_FAILED, text, (*figures, Figure("wait", wait_s, "s")))


def _with_stop_note(refusal: Refusal, command: Command) -> Refusal:
    """Add to a refusal that the stop was executed nevertheless, if the command is one."""
    if not isinstance(command.request, Stop):
        return refusal
    text = f"{refusal.text}; the rover was stopped nevertheless"
    return replace(refusal, text=text, argument=None)


def _duplicate_refusal(identity: Identity, known: bytes) -> Refusal:
    what = "and its command is no longer stored" if known == PRUNED else "by another command"
    return Refusal(
        Reason.DUPLICATE,
        f"{identity} is used {what}: choose a new number",
        (Figure("command", identity.command_id),),
        argument=0,
    )


def _refusal(found: object) -> Refusal | None:
    return found if isinstance(found, Refusal) else None
