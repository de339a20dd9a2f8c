"""Executes each command at most once: validates it; makes it a goal, a latch or a setting."""

from dataclasses import replace
from typing import Final, assert_never

from executive.checks import check_battery, check_pose, check_request, expected_pose
from executive.commands import (
    ABOARD_LINK,
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
from executive.commands.actions import action_of
from executive.commands.intake import bad_identity, check_arguments, validate
from executive.commands.lifecycle import Admitted, CommandLifecycle, Refused, Repeated, SubmitResult
from executive.core.authority import Authority
from executive.core.pose_keeper import PoseKeeper
from executive.core.reactions import Reactions
from executive.goals import Context
from executive.plans import Planner, PlanNode
from executive.preview import Predictor
from executive.record import PRUNED, Ledger, LedgerError, Notifications, digest
from executive.state import Telemetry, Uncertainty
from executive.values.geometry import Pose
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, Severity

NOT_HELD: Final = Refusal(
    Reason.WRONG_MODE, "no stop or fault holds the rover: resume a plan by resumePlan"
)
OVERTAKEN: Final = Refusal(Reason.STOPPED, "overtaken by a stop that was created after it")
UNWRITTEN: Final = Refusal(
    Reason.LEDGER_FAILED, "the ledger cannot be written: only a stop is executed"
)


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

    def submit(self, command: Command, overtaken: bool = False) -> SubmitResult:
        """Accept or reject a command.

        Args:
            command: the command; for a stop, `Reactions.stop` was called before.
            overtaken: whether a stop was served that arrived after the command. The rover is then
                STOPPED, so only a resume needs an extra check.
        """
        unusable = bad_identity(command)
        if unusable is not None:
            return self._not_taken(command, unusable)
        try:
            if self._ledger.failing:
                self._ledger.commit()
            known = self._ledger.digest_of(command.identity)
            last = None if known is None else self._ledger.last_report(command.identity)
        except LedgerError:
            return Refused(unwritten(command))
        if last is not None and known == digest(command):
            self._notifications.again(last)
            if isinstance(command.request, Stop):
                text = f"duplicate of {command.identity}: the rover was stopped again"
                self._notifications.event(Severity.WARNING, text, Reason.DUPLICATE, foreign=True)
            return Repeated(last)
        if known is not None:
            return self._not_taken(command, _used(command.identity, known))
        life = CommandLifecycle(command, self._notifications.command)
        refusal = self._examine(command, overtaken)
        if refusal is not None:
            refusal = _as_told(refusal, command)
            life.reject(refusal)
            return Refused(refusal)
        life.accept()
        self._admit(life)
        return Admitted(life)

    def restore_settings(self) -> None:
        """Apply the settings again that the ledger holds."""
        for setting in self._ledger.last_settings():
            self._restore(setting)

    def _not_taken(self, command: Command, refusal: Refusal) -> Refused:
        """Reject a command under the id of another: it has no life cycle reports."""
        refusal = _as_told(refusal, command)
        self._notifications.event(
            Severity.WARNING, refusal.text, refusal.reason, refusal.figures, foreign=True
        )
        return Refused(refusal)

    def _examine(self, command: Command, overtaken: bool) -> Refusal | None:
        if not isinstance(command.request, Stop):
            if command.overtaken:
                return OVERTAKEN
            refusal = self._authority.judge(command)
            if refusal is not None:
                return refusal
        context = self._context
        if overtaken and isinstance(command.request, Resume):
            text = f"a later stop holds the rover: stopped by {context.latches.stopped_by}"
            return Refusal(Reason.CAUSE_PERSISTS, text)
        refusal = validate(
            command,
            settings=context.settings,
            status=context.status,
            mode=context.mode_for(command),
            queued=len(context.goals),
            utc_s=context.clock.utc_s(),
        )
        return (
            refusal
            or check_pose(
                command.request,
                self._start_of(command),
                context.status.uncertainty,
                context.settings,
            )
            or self._blocked(command)
            or self._obstacle(command.request)
            or self._short(command)
        )

    def _blocked(self, command: Command) -> Refusal | None:
        """Return a refusal if a motion is blocked at its expected start pose, or None."""
        request, context = command.request, self._context
        if not isinstance(request, Motion):
            return None
        obstacles = context.status.obstacles
        return check_request(request, self._start_of(command), context.settings, obstacles)

    def _short(self, command: Command) -> Refusal | None:
        """Return a refusal if the battery lacks energy for a motion or plan with the return."""
        request, context = command.request, self._context
        what: Motion | PlanNode | None = None
        if isinstance(request, Motion) and command.link != ABOARD_LINK:
            what = request
        elif isinstance(request, ActivatePlan):
            what = self._planner.root(request.plan_id)
        if what is None or context.settings.battery is None:
            return None
        return check_battery(what, self._start_of(command), context.status, context.settings)

    def _start_of(self, command: Command) -> Pose:
        """Return the expected pose of the rover when a motion begins."""
        context, status = self._context, self._context.status
        pose, goals = status.pose, context.goals.motion
        if command.arrival is PreemptionPolicy.REPLACE:
            return pose
        return expected_pose(goals, pose, context.clock, context.settings, status.obstacles)

    def _obstacle(self, request: Request) -> Refusal | None:
        """Return a refusal if the present state does not permit a request, or None."""
        if isinstance(request, PlanRequest):
            return self._planner.obstacle(request)
        files = self._context.files
        match request:
            case Resume():
                return self._hazard_left()
            case DeleteFile(path):
                return _refusal(files.find(path))
            case MoveFile(path, target):
                return _refusal(files.find(path)) or _refusal(files.target(target))
            case ExecuteAction(action):
                return _refusal(action_of(action, self._context.video))
            case _:
                return None

    def _hazard_left(self) -> Refusal | None:
        latches, safety = self._context.latches, self._context.safety
        by_fault = latches.hazard is not None or latches.paused is not None
        if not by_fault and latches.stopped_by is None:
            return NOT_HELD
        safety.history.accept()
        danger = safety.cause_left() if by_fault else None
        if danger is None:
            return None
        return Refusal(Reason.CAUSE_PERSISTS, f"not yet: {danger.text}", danger.figures)

    def _admit(self, life: CommandLifecycle) -> None:
        request, context = life.command.request, self._context
        named = f"{life.command.identity} {life.command.name}"
        if isinstance(request, PlanRequest):
            life.start()
            life.execute(self._planner.grant(request, life.command.identity))
            return
        if isinstance(request, Motion | CameraWork | InstantCommand):
            if isinstance(request, Motion) and life.command.arrival is PreemptionPolicy.REPLACE:
                context.goals.motion.cancel_all(
                    Refusal(Reason.REPLACED, f"replaced by {life.command.identity}")
                )
            start = self._start_of(life.command)
            goal = context.goals.add(request, life)
            if isinstance(request, Motion):
                self._predictions.of_motion(goal, request, start)
        elif isinstance(request, Setting):
            life.start()
            self._set(request)
            if isinstance(request, SetPositionCompensation):
                self._pose.confirm(Uncertainty(cause=named))
            life.execute()
        elif isinstance(request, ConfirmPose):
            life.start()
            left = Uncertainty(request.position_m, request.heading_rad, named)
            self._pose.confirm(left)
            life.execute()
        elif isinstance(request, Stop):
            life.start()
            context.latches.stopping.append(life)
        elif isinstance(request, Resume):
            life.start()
            self._reactions.resume()
            life.execute()
        else:
            assert_never(request)

    def _set(self, setting: Setting) -> None:
        status = self._context.status
        match setting:
            case SetTravelSpeed(speed_mps):
                status.travel_speed_mps = speed_mps
            case SetRotateSpeed(speed_radps):
                status.rotate_speed_radps = speed_radps
            case SetPositionCompensation(x_m, y_m, z_m, heading_rad):
                status.compensation = Pose(x_m, y_m, z_m, heading_rad)
                status.forget_seen()
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
            self._set(setting)
        else:
            self._notifications.event(
                Severity.WARNING, f"stored setting is out of range and was dropped: {refusal.text}"
            )


def unwritten(command: Command) -> Refusal:
    """Return the refusal of a command that the ledger failed to record."""
    return _as_told(UNWRITTEN, command)


def _as_told(refusal: Refusal, command: Command) -> Refusal:
    """Add to a refusal that the stop was executed nevertheless, if the command is one."""
    if not isinstance(command.request, Stop):
        return refusal
    text = f"{refusal.text}; the rover was stopped nevertheless"
    return replace(refusal, text=text, argument=None)


def _used(identity: Identity, known: bytes) -> Refusal:
    what = "and its command is no longer stored" if known == PRUNED else "by another command"
    return Refusal(
        Reason.DUPLICATE,
        f"{identity} is used {what}: choose a new number",
        (Figure("command", identity.command_id),),
        argument=0,
    )


def _refusal(found: object) -> Refusal | None:
    return found if isinstance(found, Refusal) else None
