"""`RoverTree`: the static behaviour tree of a rover: stop, then safety, then work, then idle."""

from math import floor
from pathlib import Path
from typing import Final

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.commands import (
    CameraPointing,
    DeleteFile,
    ExecuteAction,
    InstantCommand,
    MoveFile,
    TakePicture,
    TargetCommand,
)
from executive.commands.actions import perform
from executive.core.runner import Executive
from executive.faults import summary
from executive.goals import Context, Goals
from executive.motion import VelocityLocomotion
from executive.plans import PlanExecution, PlanRoot
from executive.safety import FaultMonitor, unmonitored
from executive.settings import Settings
from executive.state import FileFolder, join_sources
from executive.state import Status as AssetStatus
from executive.values.clock import ManualClock
from executive.values.geometry import STANDING
from executive.values.reasons import Figure, Reason, Refusal
from trees.camera import Capture, PanTilt
from trees.composites import Parallel, Selector, Sequence, TickedNode
from trees.leaf import (
    STOP_DEADLINE_S,
    Condition,
    GoalLeaf,
    Idle,
    Leaf,
    TakeGoal,
    awaited,
    refusal,
    sources,
    unconfirmed,
)
from trees.motion import WHOLE_MOTIONS, Drive, FinishLeg, PlanLeg, Turn
from trees.plan import PlanTree
from trees.snapshot import FaultSnapshot, NodeKind, TreeNodeSnapshot, TreeSnapshot, nodes

ALMOST_S: Final = 1e-6
AWAITED_S: Final = 3.0
"""Extra time to wait for a source: a second odometry has gaps of 4 s."""
ODOMETRY_RESPONSE_S: Final = 0.2
"""Acceleration time until odometry shows motion. A zero twist at 1 m/s ended a stop after 0 s."""


class StopRover(Leaf):
    """Commands zero; ends the stop commands once every available source shows standstill.

    Until then it reports the remaining motion once a second. Odometry that has not shown the
    commanded motion is ignored until braking must have ended. A source that was not received since
    standstill has more time than the others.
    """

    def begin(self) -> float:
        """Allow the time of a stop from full speed."""
        self._began_s = self.context.clock.now_s()
        self._last_progress_s = 0
        self._bound_s = STOP_DEADLINE_S
        self._odometry_trusted_s = self._began_s
        limits, before = self.context.settings.drive, self.context.latches.stopped_from
        braking_s = max(
            abs(before.travel_mps) / limits.travel_acceleration_mps2,
            abs(before.rotate_radps) / limits.rotate_acceleration_radps2,
        )
        if braking_s > ODOMETRY_RESPONSE_S and self.context.status.standing:
            self._odometry_trusted_s += braking_s
        return STOP_DEADLINE_S

    def act(self) -> Status:
        """Request standstill until it is confirmed."""
        self.context.intents.motion = STANDING
        now_s = self.context.clock.now_s()
        took_s = now_s - self._began_s
        found = sources(self.context)
        if now_s < self._odometry_trusted_s:
            return Status.RUNNING
        left = unconfirmed(self.context, found)
        if left:
            self._report_progress(took_s, left)
            return Status.RUNNING
        by = join_sources([each.source for each in found])
        for lifecycle in self.context.latches.take_stopping():
            lifecycle.execute(
                f"stationary after {took_s:.2f} s, {by}", (Figure("duration", took_s, "s"),)
            )
        return Status.SUCCESS

    def on_timeout(self) -> Status:
        """Fail the stop commands: zero was sent, but not every source shows standstill."""
        found = sources(self.context)
        if awaited(self.context, found) and self._bound_s == STOP_DEADLINE_S:
            self._bound_s += AWAITED_S
            self.set_deadline(AWAITED_S)
            return Status.RUNNING
        for lifecycle in self.context.latches.take_stopping():
            lifecycle.fail(refusal(self.context, found, self._bound_s))
        return Status.FAILURE

    def _report_progress(self, took_s: float, left: str) -> None:
        seconds = floor(took_s + ALMOST_S)
        if self._last_progress_s < seconds < self._bound_s:
            self._last_progress_s = seconds
            text = f"standstill not confirmed {seconds} s after the stop: {left}"
            for lifecycle in self.context.latches.stopping:
                lifecycle.advance(seconds, round(self._bound_s), text)


class HoldWhileUnsafe(Leaf):
    """Holds zero velocity while a hazard lasts."""

    def begin(self) -> float:
        """Allow the time of a stop from full speed."""
        return STOP_DEADLINE_S

    def act(self) -> Status:
        """Request standstill."""
        self.context.intents.motion = STANDING
        return Status.RUNNING

    def on_timeout(self) -> Status:
        """Leave the stop to the latch, so that the camera can work again."""
        return Status.FAILURE


INSTANT_DEADLINE_S: Final = 5.0


class RunInstantCommand(GoalLeaf):
    """Executes an instant command, and ends the goal."""

    timeout_reason = Reason.INSTANT_COMMAND_FAILED
    timeout_text = "not done"

    def begin(self) -> float:
        """Allow more than needed: it is executed in its first tick."""
        return INSTANT_DEADLINE_S

    def act(self) -> Status:
        """Execute the command."""
        try:
            refusal = self._do()
        except OSError as error:
            refusal = Refusal(Reason.INSTANT_COMMAND_FAILED, f"command failed: {error.strerror}")
        if refusal is not None:
            return self.fail(refusal)
        self.queue.complete_active()
        return Status.SUCCESS

    def _do(self) -> Refusal | None:
        context = self.context
        match self.goal.command.request:
            case DeleteFile(path):
                return context.files.delete(path)
            case MoveFile(path, target):
                return context.files.move(path, target)
            case ExecuteAction(text):
                return perform(text, context.video)
            case request:
                raise TypeError(f"{request} is no instant command")


class RoverTree:
    """The tree, with the interface that the runner needs.

    Attributes:
        ticked: the nodes that the last tick reached.
        plan: the tree of the executing plan, if any.
    """

    def __init__(self, context: Context) -> None:
        self.context = context
        self.root = build(context)
        self.ticks = 0
        self.ticked: frozenset[Behaviour] = frozenset()
        self.plan: PlanTree | None = None
        self._own = tuple(self.root.iterate())
        self._states: tuple[object, ...] = ()
        self._snapshots: tuple[TreeNodeSnapshot, ...] = ()

    def tick(self) -> None:
        """Tick once from the root."""
        self.ticks += 1
        ticked: list[Behaviour] = []
        self.root.run(ticked)
        self.ticked = frozenset(ticked)

    def stop(self) -> None:
        """Terminate every running node."""
        self.root.stop(Status.INVALID)

    def attach(self, plan: PlanRoot, execution: PlanExecution) -> PlanTree:
        """Return the tree of a plan, which remains attached until it is detached."""
        self.plan = PlanTree(plan, execution)
        return self.plan

    def detach(self) -> None:
        """Remove the plan's tree."""
        self.plan = None

    def nodes(self) -> tuple[TreeNodeSnapshot, ...]:
        """Return all nodes as of the last tick; those of a plan first, below the root.

        Nodes of a plan retain their results until a loop around them starts its next cycle. Without
        a plan it is the same object until a change: a recording requests it after each tick.
        """
        states = (self.ticked, *((each.status, each.feedback_message) for each in self._own))
        if states != self._states:
            self._states, self._snapshots = states, nodes(self.root, self.ticked)
        if self.plan is None:
            return self._snapshots
        root, *others = self._snapshots
        plan = self.plan.root
        planned = nodes(plan, frozenset(plan.iterate()), depth=1)
        return (root, *planned, *others)


def snapshot_of(executive: Executive, utc_s: float) -> TreeSnapshot:
    """Return a snapshot of an executive's tree and status; on the executive's thread.

    Args:
        executive: an executive with a `RoverTree`.
        utc_s: present time, seconds since 1970-01-01 UTC.
    """
    tree = executive.tree
    assert isinstance(tree, RoverTree)
    return TreeSnapshot(
        tick=tree.ticks,
        utc_s=utc_s,
        mode=executive.mode.name,
        why=executive.why,
        nodes=tree.nodes(),
        faults=tuple(
            FaultSnapshot(each.name, each.severity, each.refusal.text)
            for each in executive.safety.active
        ),
        unmonitored=summary(unmonitored(executive.settings, executive.safety.history)),
        active=executive.active_command,
    )


def build(context: Context) -> Selector:
    """Return the root of the tree for a context."""
    latches, status = context.latches, context.status

    def unsafe() -> bool:
        return latches.hazard is not None and status.odometry_fresh and not status.standing

    stopping = Condition(
        "stopping?",
        lambda: bool(latches.stopping),
        identity_of=lambda: latches.stopping[-1].command.identity,
    )
    any_goal = Condition("any goal?", lambda: len(context.goals) > 0)
    branches = _motion(context), _camera(context), _instant(context)
    return Selector(
        "rover",
        Sequence("priority stop", stopping, StopRover("stop", context)),
        Sequence("safety", Condition("unsafe?", unsafe), HoldWhileUnsafe("hold", context)),
        Sequence("work", any_goal, Parallel("side by side", *branches)),
        Idle("idle"),
    )


def _motion(context: Context) -> TickedNode:
    goals = context.goals.motion

    def waits() -> bool:
        return context.latches.paused is not None

    leg = Sequence(
        "leg",
        PlanLeg("plan leg", context),
        Turn("turn towards", context, final=False),
        Drive("drive", context),
        Turn("turn to heading", context, final=True),
        FinishLeg("finish leg", context),
        memory=True,
    )
    return Selector(
        "motion",
        Sequence("go", TakeGoal("take place", goals, TargetCommand, waits), leg),
        *(
            Sequence(name, TakeGoal(f"take {name}", goals, kind, waits), leaf(title, context))
            for name, kind, title, leaf in WHOLE_MOTIONS
        ),
        Idle("no motion"),
    )


def _camera(context: Context) -> TickedNode:
    goals = context.goals.camera
    return Selector(
        "camera",
        Sequence(
            "point",
            TakeGoal("take angles", goals, CameraPointing),
            PanTilt("pan and tilt", context, goals),
        ),
        Sequence(
            "picture",
            TakeGoal("take picture", goals, TakePicture),
            Capture("capture", context, goals),
        ),
        Idle("no camera work"),
    )


def _instant(context: Context) -> TickedNode:
    goals = context.goals.instant
    return Selector(
        "instant commands",
        Sequence(
            "instant command",
            TakeGoal("take instant command", goals, InstantCommand),
            RunInstantCommand("run instant command", context, goals),
        ),
        Idle("no instant command"),
    )


def leaf_paths(settings: Settings) -> frozenset[str]:
    """Return the paths of the leaves of an asset's tree."""
    return frozenset(each.path for each in preview(settings) if each.kind is NodeKind.LEAF)


def preview(settings: Settings) -> tuple[TreeNodeSnapshot, ...]:
    """Return the nodes of an asset's tree that is not running."""
    clock = ManualClock()
    status = AssetStatus(clock, settings)
    locomotion = VelocityLocomotion(clock, settings, status)
    files = FileFolder(Path(), lambda _: None)
    safety = FaultMonitor(clock, settings)
    context = Context(clock, settings, status, safety, Goals(clock), locomotion, files)
    return nodes(build(context), ())
