"""Executes each command once: validates it, and makes it a goal, a latch or a setting."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Final, assert_never

from executive.authority import Authority
from executive.checks import check_battery, check_pose, check_request, expected_pose
from executive.commands import (
    ABOARD_LINK,
    ActivatePlan,
    Arrival,
    CameraWork,
    Command,
    ConfirmPose,
    DeleteFile,
    ExecuteAction,
    FollowPath,
    InstantCommand,
    Mode,
    Motion,
    MoveFile,
    MoveTo,
    PlanRequest,
    Request,
    Resume,
    RotateTo,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    Setting,
    SetTravelSpeed,
    Stop,
    Waypoint,
)
from executive.commands.actions import action_of
from executive.commands.intake import (
    ABOARD_PREFIX,
    LONGEST_SOURCE,
    bad_identity,
    check_arguments,
    validate,
)
from executive.commands.lifecycle import Admitted, Life, Refused, Repeated, SubmitResult
from executive.faults import Clears, Then
from executive.geometry import Pose
from executive.goals import Context
from executive.motion import Arbiter
from executive.notifications import Notifications
from executive.plans import Planner, PlanNode
from executive.pose_keeper import PoseKeeper
from executive.preview import Predictions
from executive.reasons import Figure, Reason, Refusal
from executive.record import (
    PRUNED,
    UNWRITTEN_LEDGER,
    LatchedFault,
    Ledger,
    LedgerError,
    StopLatch,
    digest,
)
from executive.reports import Identity, Severity, Stage, printable
from executive.safety import HOLDING, Fault
from executive.settings import LinkLossAction, LocomotionKind
from executive.state import CommandEnded, Stopped, Telemetry, Uncertainty

SLOW_RATIO: Final = 0.3
"""Of the greatest speeds, what a fault leaves that slows the rover down."""
NOT_HELD: Final = Refusal(
    Reason.WRONG_MODE, "nothing holds the rover; a plan is resumed by resumePlan"
)
RETURN_SOURCE: Final = f"{ABOARD_PREFIX}return"
"""Of the command by which the rover returns to where the ground was last heard."""
AT_ONCE: Final = frozenset({"zone_ahead", "obstacle_ahead", "tick_late"})
"""Faults that begin when the rover must brake as it does on a stop, and not by its acceleration."""
_MOVING: Final = frozenset({Mode.MOVING, Mode.TELEOP, Mode.PLAN})
_ABSOLUTE: Final = (MoveTo, FollowPath, RotateTo)
OVERTAKEN: Final = Refusal(Reason.STOPPED, "a stop that was made after it has overtaken it")
UNWRITTEN: Final = Refusal(
    Reason.LEDGER_FAILED, "the ledger cannot be written, so nothing but a stop is executed"
)


class Dispatcher:
    """Accepts or refuses commands, and ends goals."""

    def __init__(
        self,
        context: Context,
        arbiter: Arbiter,
        ledger: Ledger,
        latch: StopLatch,
        notifications: Notifications,
        telemetry: Telemetry,
        planner: Planner,
        authority: Authority,
        predictions: Predictions,
        pose: PoseKeeper,
    ) -> None:
        self._pose = pose
        self._authority = authority
        self._predictions = predictions
        self._context = context
        self._arbiter = arbiter
        self._ledger = ledger
        self._latch = latch
        self._notifications = notifications
        self._telemetry = telemetry
        self._planner = planner
        self._return: Life | None = None
        self._ticked_s, self._late = inf, False

    def stop(self, by: Identity) -> None:
        """Make the rover stand until resumed, whoever asks; `submit` says what comes of it."""
        stopped_by = printable(f"{by.source[:LONGEST_SOURCE]}:{by.command_id}")
        if not self._context.latches.stopping:
            self._context.latches.stopped_from = self._arbiter.velocity
        self._arbiter.stop()
        self._context.latches.stopped_by = stopped_by
        try:
            self._latch.set(stopped_by)
        except OSError as error:
            text = f"a restart will not know of the stop: {error}"
            self._notifications.event(Severity.ALARM, text, Reason.LEDGER_FAILED)
        self.end_goals(Refusal(Reason.STOPPED, f"stopped by {stopped_by}"))

    def submit(self, command: Command, overtaken: bool = False) -> SubmitResult:
        """Accept or refuse a command.

        Args:
            command: who asks; if it is a stop, `stop` was called for it.
            overtaken: whether a stop has come since the command arrived here; it then finds the
                rover STOPPED, and only a resume need be refused for it.
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
                text = f"{command.identity} came again: the rover was stopped again"
                self._notifications.event(Severity.WARNING, text, Reason.DUPLICATE, foreign=True)
            return Repeated(last)
        if known is not None:
            return self._not_taken(command, _used(command.identity, known))
        life = Life(command, self._notifications.command)
        refusal = self._examine(command, overtaken)
        if refusal is not None:
            refusal = _as_told(refusal, command)
            life.reject(refusal)
            return Refused(refusal)
        life.accept()
        self._admit(life)
        return Admitted(life)

    def make_safe(self, danger: Refusal) -> None:
        """Stand, SAFE until resumed; nothing, where the same reason holds the rover already."""
        safety = self._context.safety
        if all(each.refusal.reason is not danger.reason for each in safety.active):
            self.begin_fault(safety.hold(danger, Then.SAFE))

    def check_lateness(self) -> None:
        """Report a tick later than the watchdog's bound, and pause motion; call it once a tick.

        Only the first of several late ticks is reported: writing the report may take the time.
        """
        context, safety = self._context, self._context.safety
        now_s, bound_s = context.clock.now_s(), context.settings.safety.watchdog_s
        late_s, self._ticked_s = now_s - self._ticked_s - context.settings.tick_s, now_s
        before, self._late = self._late, late_s > bound_s
        if not self._late:
            return
        text = f"the tick was {late_s:.1f} s late: the process was suspended or had no processor"
        why = Refusal(
            Reason.TICK_LATE, text, (Figure("late", late_s, "s"), Figure("bound", bound_s, "s"))
        )
        if context.mode in _MOVING:
            self.begin_fault(safety.hold(why, Then.PAUSE))
        elif not before:
            self._notifications.event(Severity.WARNING, text, why.reason, why.figures, foreign=True)

    def lose_link(
        self, action: LinkLossAction, why: Refusal, way_back: tuple[Waypoint, ...]
    ) -> None:
        """Report that nothing is heard of the ground, and do what is to be done then.

        Args:
            action: what is to be done.
            why: what is said of it.
            way_back: leads to where the ground was last heard.
        """
        safety = self._context.safety
        if action is LinkLossAction.STOP:
            self.begin_fault(safety.hold(why, Then.STOP))
            return
        self._notifications.event(Severity.WARNING, why.text, why.reason, why.figures)
        if action is LinkLossAction.RETURN:
            refusal = self._begin_return(why, way_back)
            if refusal is not None:
                text = f"the rover is stopped, as it cannot return: {refusal.text}"
                stopped = Refusal(Reason.LINK_LOST, text, refusal.figures)
                self.begin_fault(safety.hold(stopped, Then.STOP))

    def regain_link(self) -> None:
        """Report that the ground is heard again; a rover that returns stands."""
        self._notifications.event(Severity.INFORMATIONAL, "the ground is heard again")
        if self._return is not None:
            refusal = Refusal(Reason.STOPPED, "stopped, for the ground is heard again")
            self._context.goals.motion.cancel(self._return, refusal)
            self._return = None

    def follow_return(self) -> bool:
        """Return whether the rover is returning; report how that ended, once it has."""
        life = self._return
        if life is None or not life.stage.terminal:
            return life is not None
        self._return = None
        if life.refusal is None:
            text = "the rover is back where the ground was last heard"
            self._notifications.event(Severity.INFORMATIONAL, text)
        else:
            text = f"the rover did not return: {life.refusal.text}"
            self._notifications.event(Severity.ALARM, text, life.refusal.reason)
        return False

    def _begin_return(self, why: Refusal, way_back: tuple[Waypoint, ...]) -> Refusal | None:
        """End all motion and give the command to return; return why it was refused, or None."""
        self._planner.suspend(why)
        self._context.goals.motion.fail_all(why)
        stage_before = why.reason.name.lower()
        self._context.safety.drop(stage_before)
        self._ledger.unlatch(stage_before)
        self._obey_faults()
        identity = Identity(RETURN_SOURCE, self._ledger.last_sequence + 1)
        answer = self.submit(Command(identity, FollowPath(way_back), ABOARD_LINK))
        if isinstance(answer, Admitted):
            self._return = answer.life
        return answer.refusal if isinstance(answer, Refused) else None

    def begin_fault(self, fault: Fault) -> None:
        """Report a fault, and do what its row says."""
        why, row = fault.refusal, fault.row
        if row.then in {Then.STOP, Then.SAFE}:
            self._arbiter.stop()
        if row.then is Then.PAUSE and fault.name in AT_ONCE:
            self._arbiter.stand()
        self._notifications.event(fault.severity, why.text, why.reason, why.figures)
        if row.clears is Clears.ON_RESUME:
            self._ledger.latch(LatchedFault(fault.name, row.then, why, fault.begun_utc_s))
        self._obey_faults()
        if row.then in HOLDING:
            self._planner.suspend(why)
            motion = self._context.goals.motion
            if row.then is not Then.PAUSE:
                motion.fail_all(why)
            elif motion.active and not isinstance(motion.active.command.request, _ABSOLUTE):
                motion.fail(why)  # relative to where it began, it cannot go on

    def end_fault(self, fault: Fault) -> None:
        """Report that a fault is over, and undo what no other fault asks for."""
        self._notifications.event(
            Severity.INFORMATIONAL, f"{fault.name} is over", Reason.FAULT_OVER
        )
        if fault.row.clears is Clears.ON_RESUME:
            self._ledger.unlatch(fault.name)
        self._obey_faults()

    def _obey_faults(self) -> None:
        """Hold, pause and slow down the rover as the faults say that are not over."""
        latches, active = self._context.latches, self._context.safety.active
        first = {then: _first(active, then) for then in Then}
        latches.paused = first[Then.PAUSE]
        latches.hazard = first[Then.SAFE] or first[Then.STOP]
        latches.safe = first[Then.SAFE] is not None
        self._context.status.slow_ratio = SLOW_RATIO if first[Then.SLOW_DOWN] else 1.0
        if self._arbiter.latched and not latches.held:
            self._arbiter.release()

    def fail_active(self, refusal: Refusal) -> None:
        """Fail the goals and stops under way."""
        self._context.goals.fail_active(refusal)
        for life in self._context.latches.take_stopping():
            life.fail(refusal)

    def on_external_result(self, ended: CommandEnded) -> None:
        """End the goal of a command that the rover received over another link first."""
        for queue in (self._context.goals.motion, self._context.goals.camera):
            goal = queue.active
            if goal is None or goal.command.identity != ended.identity:
                continue
            text = f"it came by another way first: {ended.text}"
            if ended.executed:
                queue.execute(text)
            else:
                queue.fail(Refusal(Reason.MOTION_NOT_EXECUTED, text))

    def on_external_stop(self, stopped: Stopped) -> None:
        """Cancel goals after a stop over another link; later commands may move the rover."""
        refusal = Refusal(Reason.STOPPED, f"stopped by {stopped.by}, by another way")
        self._planner.suspend(refusal)
        self._context.goals.motion.cancel_all(refusal)
        self._context.goals.camera.cancel_all(refusal)

    def end_goals(self, refusal: Refusal) -> None:
        """Suspend the plan that executes, and cancel every goal and stop under way."""
        self._planner.suspend(refusal)
        self._context.goals.cancel_all(refusal)
        for life in self._context.latches.take_stopping():
            life.cancel(refusal)

    def take_over(self) -> None:
        """Recover what the ledger holds of the process before this one.

        Settings, a stop and faults that only a resume ends are in force again. Unfinished commands
        end as interrupted, and the rover stands, since one of them may still move it, or, by
        velocities, one that had ended while the rover still slowed down.
        """
        for setting in self._ledger.last_settings():
            self._restore(setting)
        for each in self._ledger.latched_faults():
            self._context.safety.restore(each.name, each.reaction, each.refusal, each.begun_utc_s)
        if self._latch.stopped_by != UNWRITTEN_LEDGER:
            self._context.latches.stopped_by = self._latch.stopped_by
        self._obey_faults()
        if self._context.latches.held:
            self._arbiter.stop()
        self._planner.take_over()
        if self._latch.stopped_by == UNWRITTEN_LEDGER:
            text = "the ledger could not be written before the restart"
            self.make_safe(Refusal(Reason.LEDGER_FAILED, text))
        refusal = Refusal(Reason.INTERRUPTED, "interrupted: the executive was restarted")
        left = self._ledger.unfinished()
        by_velocity = self._context.settings.locomotion is LocomotionKind.VELOCITY
        if left or (by_velocity and self._ledger.last_sequence):
            self._arbiter.stand()
        for command, stage in left:
            life = Life(command, self._notifications.command, stage)
            match stage:
                case Stage.RECEIVED:
                    life.reject(refusal)
                case Stage.ACCEPTED:
                    life.cancel(refusal)
                case _:
                    life.fail(refusal)

    def _not_taken(self, command: Command, refusal: Refusal) -> Refused:
        """Refuse a command whose number is not its own, so that no life can be told of it."""
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
        """Return why a motion may not begin where the rover then is expected to be, or None."""
        request, context = command.request, self._context
        if not isinstance(request, Motion):
            return None
        obstacles = context.status.obstacles
        return check_request(request, self._start_of(command), context.settings, obstacles)

    def _short(self, command: Command) -> Refusal | None:
        """Return that the battery cannot bring the rover back from a motion or plan, or None."""
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
        """Return where the rover is expected to be when a motion begins."""
        context, status = self._context, self._context.status
        pose, goals = status.pose, context.goals.motion
        if command.arrival is Arrival.REPLACE:
            return pose
        return expected_pose(goals, pose, context.clock, context.settings, status.obstacles)

    def _obstacle(self, request: Request) -> Refusal | None:
        """Return why the state aboard does not allow a request, or None."""
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

    def _admit(self, life: Life) -> None:
        request, context = life.command.request, self._context
        named = f"{life.command.identity} {life.command.name}"
        if isinstance(request, PlanRequest):
            life.start()
            life.execute(self._planner.grant(request, life.command.identity))
            return
        if isinstance(request, Motion | CameraWork | InstantCommand):
            if isinstance(request, Motion) and life.command.arrival is Arrival.REPLACE:
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
            self._resume()
            life.execute()
        else:
            assert_never(request)

    def _resume(self) -> None:
        """Let the rover move again, but for faults that end by themselves and are not over."""
        self._context.latches.clear()
        for fault in self._context.safety.resume():
            self.end_fault(fault)
        self._obey_faults()

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
        """Set again what was set before a restart, if it is still within the asset's bounds."""
        refusal = check_arguments(setting, self._context.settings, self._context.status.pose.point)
        if refusal is None:
            self._set(setting)
        else:
            self._notifications.event(
                Severity.WARNING, f"a setting no longer fits and is forgotten: {refusal.text}"
            )


def unwritten(command: Command) -> Refusal:
    """Return what is said of a command that the ledger did not take."""
    return _as_told(UNWRITTEN, command)


def _as_told(refusal: Refusal, command: Command) -> Refusal:
    """Return a refusal with what was done all the same: a stop acts, whatever is wrong with it."""
    if not isinstance(command.request, Stop):
        return refusal
    text = f"{refusal.text}; the rover was stopped all the same"
    return replace(refusal, text=text, argument=None)


def _first(faults: Sequence[Fault], then: Then) -> Refusal | None:
    return next((fault.refusal for fault in faults if fault.row.then is then), None)


def _used(identity: Identity, known: bytes) -> Refusal:
    what = "so long ago that it is not known for what" if known == PRUNED else "for another command"
    return Refusal(
        Reason.DUPLICATE,
        f"{identity} was used {what}: take a new number",
        (Figure("command", identity.command_id),),
        argument=0,
    )


def _refusal(found: object) -> Refusal | None:
    return found if isinstance(found, Refusal) else None
