"""`Reactions` stops, pauses or releases the rover after stops, faults and link loss; ends goals."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from typing import Final

from executive.checks import is_navigated
from executive.commands import ABOARD_LINK, ROS_SOURCE, Command, FollowPath, Mode, is_absolute
from executive.commands.intake import ABOARD_PREFIX, MAX_SOURCE_LENGTH
from executive.commands.lifecycle import Accepted, CommandLifecycle, Rejected, SubmitResult
from executive.core.link_loss import GroundMonitor
from executive.core.pose_keeper import PoseKeeper
from executive.faults import ClearPolicy, Reaction
from executive.goals import Context
from executive.motion import Arbiter
from executive.plans import Planner
from executive.record import (
    UNWRITTEN_LEDGER,
    LatchedFault,
    Ledger,
    LedgerError,
    Notifications,
    StopLatch,
)
from executive.safety import HOLDING_REACTIONS, Fault, OdometryWindow
from executive.settings import Controller, LinkLossAction, LocomotionKind, TargetFrame
from executive.values.facts import ExternalCommandEnded, ExternalStop
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, Severity, Stage, printable

SLOW_RATIO: Final = 0.3
"""Ratio of the speed limits that remains under SLOW_DOWN; chosen, not measured."""
RETURN_SOURCE: Final = f"{ABOARD_PREFIX}return"
"""Source of the command that returns the rover to the position of the last ground contact."""
HARD_STOP_FAULTS: Final = frozenset({"zone_ahead", "obstacle_ahead", "tick_late"})
"""Faults that brake as a stop does: with normal deceleration the rover ran into the obstacle."""
_MOVING: Final = frozenset({Mode.MOVING, Mode.TELEOP, Mode.PLAN})
_LINK_LOST: Final = Reason.LINK_LOST.name.lower()
_LINK_LOSS_TEXT: Final = {
    LinkLossAction.CONTINUE: "the rover continues",
    LinkLossAction.HOLD: "the rover holds at the end of the step",
    LinkLossAction.STOP: "the rover is stopped",
    LinkLossAction.RETURN: "the rover returns to the position of the last contact",
}


class Reactions:
    """Stops, pauses, slows and releases the rover, and ends goals accordingly."""

    def __init__(
        self,
        context: Context,
        arbiter: Arbiter,
        ledger: Ledger,
        latch: StopLatch,
        notifications: Notifications,
        planner: Planner,
        pose: PoseKeeper,
        ground: GroundMonitor,
    ) -> None:
        self._context = context
        context.safety.history.navigation = context.status.navigation
        self._arbiter = arbiter
        self._ledger = ledger
        self._latch = latch
        self._notifications = notifications
        self._planner = planner
        self._pose = pose
        self._ground = ground
        self._return: CommandLifecycle | None = None
        self._ticked_s, self._late = inf, False

    def recover(self) -> None:
        """Recover the stop, the faults and the plans of the previous process.

        A stop, and faults that only a resume ends, are in force again. Unfinished commands end as
        interrupted. The rover is commanded to zero velocity: an unfinished command may still move
        it, or, with velocity commands, one that ended while the rover was still braking.
        """
        for each in self._ledger.latched_faults():
            self._context.safety.restore(each.name, each.reaction, each.refusal, each.begun_utc_s)
        if self._latch.stopped_by != UNWRITTEN_LEDGER:
            self._context.latches.stopped_by = self._latch.stopped_by
        self._obey_faults()
        if self._context.latches.held:
            self._arbiter.stop()
        self._planner.recover()
        if self._latch.stopped_by == UNWRITTEN_LEDGER:
            text = "the ledger could not be written before the restart"
            self.enter_safe_mode(Refusal(Reason.LEDGER_FAILED, text))
        refusal = Refusal(Reason.INTERRUPTED, "interrupted: the executive was restarted")
        left = self._ledger.unfinished()
        by_velocity = self._context.settings.locomotion is LocomotionKind.VELOCITY
        if left or (by_velocity and self._ledger.last_sequence):
            self._arbiter.zero_velocity()
        for command, stage in left:
            lifecycle = CommandLifecycle(command, self._notifications.command, stage)
            match stage:
                case Stage.RECEIVED:
                    lifecycle.reject(refusal)
                case Stage.ACCEPTED:
                    lifecycle.cancel(refusal)
                case _:
                    lifecycle.fail(refusal)

    def stop(self, by: Identity) -> None:
        """Stop the rover until resumed, for any command; `Dispatcher.submit` validates it."""
        cause = Identity(by.source[:MAX_SOURCE_LENGTH], by.command_id)
        stopped_by = printable(str(cause))
        if not self._context.latches.stopping:
            self._context.latches.stopped_from = self._arbiter.velocity
        self._arbiter.stop()
        standing = self._context.latches.stop
        if standing is None or standing.source == ROS_SOURCE or cause.source != ROS_SOURCE:
            self._context.latches.stopped_by = stopped_by  # else the operator's stop remains
            self._latch.set(stopped_by)
        self.end_goals(Refusal(Reason.STOPPED, f"stopped by {stopped_by}", cause=cause))

    def enter_safe_mode(self, danger: Refusal) -> None:
        """Enter SAFE until resumed; without effect if the same reason is already active."""
        safety = self._context.safety
        if all(each.refusal.reason is not danger.reason for each in safety.active):
            self._begin_fault(safety.hold(danger, Reaction.SAFE))

    def check_lateness(self) -> None:
        """Report a tick later than the watchdog's bound, and pause motion; call it once a tick.

        Only the first of several late ticks is reported: writing the report may cause the delay.
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
            self._begin_fault(safety.hold(why, Reaction.PAUSE))
        elif not before:
            self._notifications.report_event(
                Severity.WARNING, text, why.reason, why.figures, foreign=True
            )

    def check_ground_link(self, submit: Callable[[Command], SubmitResult]) -> None:
        """Take the action of a newly reached stage of link loss, and end it on recovery."""
        ground, lost, status = self._ground, self._ground.stage, self._context.status
        motion = self._context.goals.motion
        pose = status.pose if status.odometry_fresh else None
        reached = ground.update(self._context.mode, pose, self._update_return())
        if reached is not None:
            action, silent_s = reached.stage.then, reached.silent_s
            done = _LINK_LOSS_TEXT[action]
            text = f"no contact with the ground for {silent_s:.1f} s: {done}"
            figures = (Figure("silent", silent_s, "s"),)
            why = Refusal(Reason.LINK_LOST, text, figures, fault=_LINK_LOST)
            self._on_link_lost(action, why, submit)
            motion.blocked_by = why if action is LinkLossAction.HOLD else None
        elif lost is not None and ground.stage is None:
            self._on_link_recovered()
            motion.blocked_by = None

    def _on_link_lost(
        self, action: LinkLossAction, why: Refusal, submit: Callable[[Command], SubmitResult]
    ) -> None:
        """Report a stage of link loss, and take its action."""
        safety = self._context.safety
        if action is LinkLossAction.STOP:
            self._begin_fault(safety.hold(why, Reaction.STOP))
            return
        self._notifications.report_event(
            Severity.WARNING, why.text, why.reason, why.figures, fault=why.fault
        )
        if action is LinkLossAction.RETURN:
            refusal = self._start_return(why, submit)
            if refusal is not None:
                text = f"the rover is stopped because it cannot return: {refusal.text}"
                stopped = Refusal(Reason.LINK_LOST, text, refusal.figures)
                self._begin_fault(safety.hold(stopped, Reaction.STOP))

    def _on_link_recovered(self) -> None:
        """Report that the ground link has recovered, and end a return."""
        self._notifications.report_event(Severity.INFORMATIONAL, "ground link recovered")
        if self._return is not None:
            refusal = Refusal(Reason.STOPPED, "stopped because the ground link recovered")
            self._context.goals.motion.cancel(self._return, refusal)
            self._return = None

    def _update_return(self) -> bool:
        """Return whether the rover is returning; report the end of the return."""
        lifecycle = self._return
        if lifecycle is None or not lifecycle.stage.terminal:
            return lifecycle is not None
        self._return = None
        if lifecycle.refusal is None:
            text = "the rover is back at the position of the last ground contact"
            self._notifications.report_event(Severity.INFORMATIONAL, text)
        else:
            text = f"the rover did not return: {lifecycle.refusal.text}"
            self._notifications.report_event(Severity.ALARM, text, lifecycle.refusal.reason)
        return False

    def _start_return(
        self, why: Refusal, submit: Callable[[Command], SubmitResult]
    ) -> Refusal | None:
        """End all motion and submit the command to return; return its refusal, if any."""
        self._planner.suspend(why)
        self._context.goals.motion.fail_all(why)
        self._context.safety.drop(_LINK_LOST)
        self._ledger.unlatch(_LINK_LOST)
        self._obey_faults()
        identity = Identity(RETURN_SOURCE, self._ledger.last_sequence + 1)
        path_back = FollowPath(self._ground.trail.path_back, frame=TargetFrame.ODOM)
        if is_navigated(path_back, self._context.settings):
            # Without the navigation, which may be lost as well.
            path_back = replace(path_back, controller=Controller.TURN_DRIVE)
        answer = submit(Command(identity, path_back, ABOARD_LINK))
        if isinstance(answer, Accepted):
            self._return = answer.lifecycle
        return answer.refusal if isinstance(answer, Rejected) else None

    def _begin_fault(self, fault: Fault) -> None:
        """Report a fault, and take the reaction of its row."""
        why, row = fault.refusal, fault.row
        if row.reaction in {Reaction.STOP, Reaction.SAFE}:
            self._arbiter.stop()
        if row.reaction is Reaction.PAUSE and fault.name in HARD_STOP_FAULTS:
            self._arbiter.zero_velocity()
        self._notifications.report_event(
            fault.severity, why.text, why.reason, why.figures, fault=fault.name
        )
        if row.clears is ClearPolicy.ON_RESUME:
            self._ledger.latch(LatchedFault(fault.name, row.reaction, why, fault.begun_utc_s))
        self._obey_faults()
        if row.reaction in HOLDING_REACTIONS:
            pauses = row.reaction is Reaction.PAUSE
            if not pauses or row.clears is ClearPolicy.ON_RESUME:
                self._planner.suspend(why)  # else it waits, as any motion to a target does
            motion = self._context.goals.motion
            if not pauses:
                motion.fail_all(why)
            elif motion.active and not is_absolute(motion.active.command.request):
                motion.fail_active(why)  # a motion relative to its start cannot continue

    def _end_fault(self, fault: Fault) -> None:
        """Report the end of a fault, and release what no other fault requires."""
        text = f"{fault.name} cleared"
        self._notifications.report_event(
            Severity.INFORMATIONAL, text, Reason.FAULT_CLEARED, fault=fault.name
        )
        if fault.row.clears is ClearPolicy.ON_RESUME:
            self._ledger.unlatch(fault.name)
        self._obey_faults()

    def _obey_faults(self) -> None:
        """Stop, pause and slow down the rover as the active faults require."""
        latches, active = self._context.latches, self._context.safety.active
        first = {then: _first(active, then) for then in Reaction}
        latches.paused = first[Reaction.PAUSE]
        latches.hazard = first[Reaction.SAFE] or first[Reaction.STOP]
        latches.safe = first[Reaction.SAFE] is not None
        self._context.status.speed_limit_ratio = SLOW_RATIO if first[Reaction.SLOW_DOWN] else 1.0
        if self._arbiter.latched and not latches.held:
            self._arbiter.release()

    def fail_active(self, refusal: Refusal) -> None:
        """Fail the active goals and stops."""
        self._context.goals.fail_active(refusal)
        for lifecycle in self._context.latches.take_stopping():
            lifecycle.fail(refusal)

    def on_external_result(self, ended: ExternalCommandEnded) -> None:
        """End the goal of a command that the rover received over another link first."""
        for queue in (self._context.goals.motion, self._context.goals.camera):
            goal = queue.active
            if goal is None or goal.command.identity != ended.identity:
                continue
            text = f"received over another link first: {ended.text}"
            if ended.executed:
                queue.complete_active(text)
            else:
                queue.fail_active(Refusal(Reason.MOTION_NOT_EXECUTED, text))

    def on_external_stop(self, stopped: ExternalStop) -> None:
        """Cancel goals after a stop over another link; later commands may move the rover."""
        text = f"stopped by {stopped.identity or 'a stop'}, over another link"
        refusal = Refusal(Reason.STOPPED, text, cause=stopped.identity)
        self._planner.suspend(refusal)
        self._context.goals.motion.cancel_all(refusal)
        self._context.goals.camera.cancel_all(refusal)

    def shut_down(self) -> None:
        """End the plan and all goals as the process ends; see `Planner.shut_down`."""
        refusal = Refusal(Reason.INTERRUPTED, "the executive was shut down")
        self._planner.shut_down(refusal)
        self._cancel_all(refusal)

    def end_goals(self, refusal: Refusal) -> None:
        """Suspend the executing plan, and cancel every goal and active stop."""
        self._planner.suspend(refusal)
        self._cancel_all(refusal)

    def _cancel_all(self, refusal: Refusal) -> None:
        self._context.goals.cancel_all(refusal)
        for lifecycle in self._context.latches.take_stopping():
            lifecycle.cancel(refusal)

    def resume(self) -> None:
        """Release the rover, except for faults that end by themselves and are still active."""
        self._context.latches.clear()
        for fault in self._context.safety.resume():
            self._end_fault(fault)
        self._obey_faults()

    def suspend_plan_if_held(self) -> None:
        """Suspend a plan between two of its steps if motion is held."""
        goals, executing = self._context.goals, self._context.plans.executing
        if goals.motion.blocked_by is not None and goals.active is None and executing is not None:
            text = "no contact with the ground: the plan is held at the end of a step"
            self._planner.suspend(Refusal(Reason.LINK_LOST, text))

    def report_other_drivers(self) -> None:
        """Report each other mux input that starts or stops commanding the base."""
        history = self._context.safety.history
        moved = OdometryWindow(*history.moved.sums)
        for severity, text, figures in history.other_drivers.update(
            history.drivers, moved.pose_path_m, moved.turned_rad, history.commanding
        ):
            self._notifications.report_event(severity, text, figures=figures, foreign=True)

    def run_monitors(self) -> None:
        """Run the monitors, and take the reactions of faults that begin or end."""
        self.note_command()
        safety = self._context.safety
        safety.history.pose = self._context.status.pose
        changes = safety.check(self._context.goals.motion.active is not None)
        for fault in changes.begun:
            self._begin_fault(fault)
        for fault in changes.ended:
            self._end_fault(fault)
        self._pose.update(safety.active)

    def note_command(self) -> None:
        """Record the range of velocities expected now in the history of motion."""
        at_least, velocity = self._arbiter.expected
        self._context.safety.history.command(velocity, at_least)

    def on_latch_failure(self, stopped: bool, error: OSError) -> None:
        """Report that a stop, or its release, is not stored."""
        text = (
            f"the stop is not stored, a restart will release it: {error}"
            if stopped
            else f"the release of the stop is not stored, a restart will stop the rover: {error}"
        )
        self._notifications.report_event(Severity.ALARM, text, Reason.LEDGER_FAILED)

    def on_ledger_failure(self, error: LedgerError) -> None:
        """Enter SAFE, also after a restart, and fail camera and instant goals."""
        reason = Reason.LEDGER_FAILED
        danger = Refusal(reason, str(error), fault=reason.name.lower())
        self.enter_safe_mode(danger)
        self._latch.set(UNWRITTEN_LEDGER)  # its file of one sector may fit where no report does
        self._context.goals.camera.fail_all(danger)
        self._context.goals.instant.fail_all(danger)


def _first(faults: Sequence[Fault], then: Reaction) -> Refusal | None:
    return next((fault.refusal for fault in faults if fault.row.reaction is then), None)
