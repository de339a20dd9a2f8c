"""`Goal`: an accepted command in the tree, with its progress; `Context`: state for the leaves."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from executive.commands import (
    PLAN_LINK,
    CameraWork,
    Command,
    DriveFor,
    FollowPath,
    InstantCommand,
    Mode,
    Motion,
    MoveTo,
)
from executive.commands.intake import check_lifetime, in_map
from executive.commands.lifecycle import CommandLifecycle
from executive.motion import Intents, Latches, Leg, Locomotion, MotionVerification
from executive.obstacles.detour import Detours, Scene
from executive.obstacles.zones import ClearanceViolation
from executive.plans import ActivePlans
from executive.safety import FaultMonitor
from executive.settings import Settings
from executive.state import FileFolder, MotionStatistics, Status
from executive.values.clock import Clock
from executive.values.facts import Source
from executive.values.geometry import Point, Pose, TargetFrame
from executive.values.ports import Video
from executive.values.quantities import rate_text
from executive.values.reasons import Figure, Identity, Refusal


@dataclass(slots=True)
class LegProgress:
    """The progress of a goal through its steps, as its leaves record it; a step has legs.

    Attributes:
        step: index of the step in execution.
        attempts: how often the step ended off its target.
        detour_stops: number of stops of the goal on detours around obstacles.
        obstacle_stops: how often a newly detected obstacle ended a line of the step.
        at_detour: whether the leg ends at a detour point, and not at the target of the step.
        left_path: whether the step detours around a scanned obstacle.
        finishing: whether the rover drives itself from where the navigation ended.
        turn_then_drive: whether turns and lines drive the step, since its curve failed.
        blocking: the newly detected obstacle, until the detour around it is planned.
        last_driven: where a motion ended last, until the next is planned.
    """

    step: int = 0
    attempts: int = 0
    detour_stops: int = 0
    obstacle_stops: int = 0
    at_detour: bool = False
    left_path: bool = False
    finishing: bool = False
    turn_then_drive: bool = False
    blocking: ClearanceViolation | None = None
    last_driven: Point | None = None

    @property
    def untried(self) -> bool:
        """Whether no leg of the step has ended yet, nor a detour leg before it."""
        return not self.attempts and not self.detour_stops

    @property
    def new(self) -> bool:
        """Whether no leg of the goal has ended yet."""
        return not self.step and self.untried

    def end_step(self) -> None:
        """Continue with the next step."""
        self.step += 1
        self.attempts = self.obstacle_stops = 0
        self.left_path = self.turn_then_drive = self.finishing = False

    def begin_leg(self, detour: bool, in_one: bool) -> None:
        """Begin a leg.

        Args:
            detour: whether it is a detour around obstacles.
            in_one: whether it is driven as one curve, without a stop on the detour.
        """
        self.at_detour = detour and not in_one
        self.left_path = self.left_path or detour
        self.blocking = None

    def stop_before(self, blocking: ClearanceViolation | None) -> None:
        """End a leg before a newly detected obstacle, which the next leg avoids."""
        self.blocking = blocking
        self.detour_stops += 1
        self.obstacle_stops += 1

    def end_detour(self) -> None:
        """End a leg at a detour point."""
        self.detour_stops += 1
        self.attempts = 0

    def abandon_curve(self, through: bool) -> None:
        """Abandon a curve without a solution: one to a single waypoint is not tried again."""
        self.attempts += 1
        self.turn_then_drive = not through


class Goal:
    """One accepted command, and its progress.

    Attributes:
        batch: number of the ledger's batch with its ACCEPTED; it starts once that is committed.
        after: life cycle of the unfinished command that it must follow; None for none.
        progress: progress through its steps.
        request: the request in the frame of the pose, by the last transform that was used.
        leg: the leg as last planned, or a leg of the detour to it.
        start_pose: start pose of the leg as last planned.
        origin: start pose of the leg as first planned.
        verification: compares the motion with the second odometry; None without one.
        waits_for_map: whether it holds because the transform of the map is lost.
        navigation_report: last report of the navigation at its end; empty without one.
        slid_m: distance slid before this leg, beyond what its motion allows.
        statistics: statistics of the motion; None if they are not needed.
    """

    def __init__(
        self, lifecycle: CommandLifecycle, arrived_s: float, arrived_utc_s: float, batch: int
    ) -> None:
        self.lifecycle = lifecycle
        self.batch = batch
        self.after: CommandLifecycle | None = None
        self.arrived_s = arrived_s
        self.arrived_utc_s = arrived_utc_s
        self.started_s = 0.0
        self.progress = LegProgress()
        self.request = lifecycle.command.request
        self._map_origin: Pose | None = None
        self.waits_for_map = False
        self.leg = Leg(None, None, False, None, 0.0)
        self.start_pose = self.origin = Pose()
        self.verification: MotionVerification | None = None
        self.navigation_report = ""
        self.navigation_figures: tuple[Figure, ...] = ()
        self.slid_m = 0.0
        self.statistics: MotionStatistics | None = None

    def localize(self, status: Status, settings: Settings) -> None:
        """Move request and leg with the map if they are in it and it is known."""
        request = self.command.request
        if not in_map(request, settings):
            return
        assert isinstance(request, MoveTo | FollowPath)
        origin, before = status.map_origin, self._map_origin
        if isinstance(origin, Refusal):
            return
        if before is not None and not self.progress.at_detour:
            self.leg = self.leg.moved(origin.compose(before.inverse))
        self.request, self._map_origin = request.moved(origin), origin

    def target_frame(self, status: Status) -> tuple[Pose, TargetFrame]:
        """Return the origin of the frame of its waypoints in the frame of the pose, and the frame.

        That of a map is the same as of `request`.
        """
        if self._map_origin is None:
            return status.odom_origin, TargetFrame.ODOM
        return self._map_origin, TargetFrame.MAP

    def end_navigation(self, report: str, figures: tuple[Figure, ...]) -> None:
        """Let the rover itself drive the rest of the leg, from where the navigation ended."""
        self.progress.finishing = True
        self.navigation_report, self.navigation_figures = report, figures

    def map_figures(self, status: Status) -> tuple[Figure, ...]:
        """Return pose and transform age in the map; none for waypoints in the odometry frame."""
        if self._map_origin is None:
            return ()
        pose = self._map_origin.inverse.compose(status.pose)
        return (
            Figure("map x", pose.x_m, "m"),
            Figure("map y", pose.y_m, "m"),
            Figure("map heading", pose.heading_rad, "rad"),
            Figure("map age", status.map_age_s, "s"),
        )

    def result_figures(self, known: tuple[Figure, ...]) -> tuple[Figure, ...]:
        """Return the measured and predicted figures of the goal, except those named in `known`."""
        names = {each.name for each in known}
        figures = () if self.statistics is None else self.statistics.figures()
        return tuple(each for each in figures if each.name not in names)

    @property
    def command(self) -> Command:
        """The command of this goal."""
        return self.lifecycle.command

    @property
    def step_count(self) -> int:
        """Number of steps: the waypoints of a path, otherwise one."""
        request = self.command.request
        return len(request.waypoints) if isinstance(request, FollowPath) else 1

    @property
    def waits(self) -> bool:
        """Whether the command that it must follow has not ended."""
        return self.after is not None and not self.after.stage.terminal

    @property
    def is_velocity(self) -> bool:
        """Whether the goal holds a velocity instead of reaching a target."""
        return isinstance(self.command.request, DriveFor)


class GoalQueue:
    """Goals of one branch of the tree in order of arrival; at most one is active.

    A goal that waits for the command before it holds all goals behind it in an ordered queue, in
    others only those of its source.

    Args:
        clock: the clock of lifetimes.
        ordered: whether each goal starts where the one before it ends.

    Attributes:
        blocked_by: why waiting goals may not start; None if they may.
        durable: number of the last batch that is committed.
        check_start: returns a refusal of a goal that starts, or None.
    """

    def __init__(self, clock: Clock, *, ordered: bool = False) -> None:
        self._clock, self._ordered = clock, ordered
        self.check_start: Callable[[Goal], Refusal | None] = lambda _: None
        self._waiting: deque[Goal] = deque()
        self.active: Goal | None = None
        self.blocked_by: Refusal | None = None
        self.durable = 0

    @property
    def waiting(self) -> int:
        """Number of waiting goals, without the active one."""
        return len(self._waiting)

    def __len__(self) -> int:
        return len(self._waiting) + (self.active is not None)

    def __iter__(self) -> Iterator[Goal]:
        if self.active is not None:
            yield self.active
        yield from self._waiting

    def add(self, lifecycle: CommandLifecycle, batch: int = 0) -> Goal:
        """Append the goal of an accepted command, and return it."""
        goal = Goal(lifecycle, self._clock.now_s(), self._clock.utc_s(), batch)
        self._waiting.append(goal)
        return goal

    def activate_next(self) -> Goal | None:
        """Return the active goal, or start the next unexpired one that meets its precondition."""
        while self.active is None and self.blocked_by is None:
            goal, late = next(self._next_goals(), (None, None))
            if goal is None:
                break
            self._waiting.remove(goal)
            if late:
                goal.lifecycle.expire(late)
                continue
            goal.started_s = self._clock.now_s()
            self.active = goal
            if goal.statistics is not None:
                goal.statistics.begin()
            goal.lifecycle.start()
            if (refusal := self.check_start(goal)) is not None:
                self.fail_active(refusal)
        return self.active

    def _next_goals(self) -> Iterator[tuple[Goal, Refusal | None]]:
        """Yield the goals that may start now, and those that are too late, with the refusal."""
        held = set[str]()
        for goal in self._waiting:
            if goal.batch > self.durable:
                return
            waited_s, source = self._clock.now_s() - goal.arrived_s, goal.command.identity.source
            late = check_lifetime(goal.command, self._clock.utc_s(), goal.arrived_utc_s, waited_s)
            if late or not (goal.waits or source in held):
                yield goal, late
            elif self._ordered:
                return
            else:
                held.add(source)

    def set_durable(self, batch: int) -> bool:
        """Permit goals up to a batch to start; return whether this releases one."""
        before, self.durable = self.durable, batch
        return any(before < goal.batch <= batch for goal in self._waiting)

    def complete_active(self, text: str = "", figures: tuple[Figure, ...] = ()) -> None:
        """Complete the active goal successfully."""
        self._end(
            lambda goal: goal.lifecycle.execute(text, (*figures, *goal.result_figures(figures)))
        )

    def fail_active(self, refusal: Refusal) -> None:
        """Fail the active goal."""
        self._end(lambda goal: goal.lifecycle.fail(refusal, goal.result_figures(refusal.figures)))

    def cancel(self, lifecycle: CommandLifecycle, refusal: Refusal) -> None:
        """Cancel one goal, waiting or active; without effect if it is not in this queue."""
        if self.active is not None and self.active.lifecycle is lifecycle:
            self._end(lambda goal: goal.lifecycle.cancel(refusal))
            return
        for goal in self._waiting:
            if goal.lifecycle is lifecycle:
                self._waiting.remove(goal)
                lifecycle.cancel(refusal)
                return

    def cancel_all(self, refusal: Refusal) -> None:
        """Cancel the active goal and all waiting ones."""
        self._end(lambda goal: goal.lifecycle.cancel(refusal))
        while self._waiting:
            self._waiting.popleft().lifecycle.cancel(refusal)

    def fail_all(self, refusal: Refusal) -> None:
        """Fail the active goal, and cancel all waiting ones for the same reason."""
        self.fail_active(refusal)
        self.cancel_all(refusal)

    def _end(self, ending: Callable[[Goal], None]) -> None:
        goal, self.active = self.active, None
        if goal is not None:
            ending(goal)


class Goals:
    """All goals of an asset, in one queue for each branch of the tree that executes them.

    Attributes:
        motion, camera, instant: goals that move the rover, that use the camera, and that end in
            their first tick.
    """

    def __init__(self, clock: Clock) -> None:
        self.motion = GoalQueue(clock, ordered=True)
        self.camera = GoalQueue(clock)
        self.instant = GoalQueue(clock)

    def __iter__(self) -> Iterator[GoalQueue]:
        return iter((self.motion, self.camera, self.instant))

    def __len__(self) -> int:
        return len(self.motion) + len(self.camera) + len(self.instant)

    @property
    def waiting(self) -> int:
        """Number of waiting goals, without the active ones."""
        return sum(queue.waiting for queue in self)

    @property
    def active(self) -> Goal | None:
        """The first active goal; motion before camera."""
        return next((queue.active for queue in self if queue.active is not None), None)

    @property
    def motion_mode(self) -> Mode:
        """The mode as determined by motion goals: IDLE, MOVING or TELEOP."""
        if not len(self.motion):
            return Mode.IDLE
        active = self.motion.active
        return Mode.TELEOP if active is not None and active.is_velocity else Mode.MOVING

    def add(
        self,
        request: Motion | CameraWork | InstantCommand,
        lifecycle: CommandLifecycle,
        batch: int = 0,
    ) -> Goal:
        """Append the goal of an accepted command to the queue of its request.

        Args:
            request: decides the queue.
            lifecycle: life cycle of the command.
            batch: number of the ledger's batch with its ACCEPTED; 0 without a ledger.
        """
        if isinstance(request, Motion):
            return self.motion.add(lifecycle, batch)
        if isinstance(request, CameraWork):
            return self.camera.add(lifecycle, batch)
        return self.instant.add(lifecycle, batch)

    def set_durable(self, batch: int) -> bool:
        """Permit goals up to a batch to start; return whether this releases one."""
        if batch == self.motion.durable:
            return False
        released = [queue.set_durable(batch) for queue in self]  # of each queue
        return any(released)

    def cancel(self, lifecycle: CommandLifecycle, refusal: Refusal) -> None:
        """Cancel one goal, waiting or active; others continue."""
        for queue in self:
            queue.cancel(lifecycle, refusal)

    def cancel_all(self, refusal: Refusal) -> None:
        """Cancel every goal."""
        for queue in self:
            queue.cancel_all(refusal)

    def fail_active(self, refusal: Refusal) -> None:
        """Fail the active goals."""
        for queue in self:
            queue.fail_active(refusal)


@dataclass(frozen=True, slots=True)
class Context:
    """State, goals and intents of one asset, passed to every leaf.

    Attributes:
        video: None if the asset has none.
    """

    clock: Clock
    settings: Settings
    status: Status
    safety: FaultMonitor
    goals: Goals
    locomotion: Locomotion
    files: FileFolder
    video: Video | None = None
    intents: Intents = field(default_factory=Intents)
    latches: Latches = field(default_factory=Latches)
    plans: ActivePlans = field(default_factory=ActivePlans)
    detours: Detours = field(default_factory=Detours)

    @property
    def scene(self) -> Scene:
        """The present obstacles, and the detours around them."""
        return self.status.obstacles, self.detours

    @property
    def mode(self) -> Mode:
        """The asset's mode, derived from latches, plans and motion goals."""
        if self.latches.hazard is not None:
            return Mode.SAFE if self.latches.safe else Mode.STOPPED
        if self.latches.stopped_by is not None:
            return Mode.STOPPED
        if self.latches.paused is not None:
            return Mode.PAUSED
        if self.plans.executing is not None:
            return Mode.PLAN
        moving = self.goals.motion_mode
        return Mode.PAUSED if moving is Mode.IDLE and self.plans.suspended else moving

    def mode_for(self, command: Command) -> Mode:
        """Return the mode that applies to a command: PLAN, also in a pause, except to its own."""
        mode = self.mode
        if self.plans.executing is None or mode not in {Mode.PLAN, Mode.PAUSED}:
            return mode
        return self.goals.motion_mode if command.link == PLAN_LINK else Mode.PLAN

    @property
    def holding_stop(self) -> Identity | None:
        """The stop that holds the rover; None if none does, or if a fault does."""
        return None if self.latches.hazard is not None else self.latches.stop

    @property
    def holding_fault(self) -> str | None:
        """Name of the fault that holds the rover, or keeps waiting goals from their start."""
        latches, motion = self.latches, self.goals.motion
        holding = latches.hazard
        if holding is None and latches.stopped_by is None:
            holding = latches.paused or (None if motion.active else motion.blocked_by)
        return None if holding is None else holding.fault

    @property
    def lost_map(self) -> Refusal | None:
        """A refusal if the active motion is in the map and its transform is lost; or None."""
        active = self.goals.motion.active
        if active is None or not in_map(active.command.request, self.settings):
            return None
        origin = self.status.map_origin
        return origin if isinstance(origin, Refusal) else None

    @property
    def why(self) -> str:
        """One line on the rover's present motion as measured, and its reason."""
        uncertainty = self.status.uncertainty
        if not uncertainty:
            return self._doing
        return f"{self._doing}; the pose is uncertain by {uncertainty}, since {uncertainty.cause}"

    @property
    def _doing(self) -> str:
        latches, active, status = self.latches, self.goals.motion.active, self.status
        moving = status.odometry_fresh and not status.standing
        velocity = status.velocity
        moves = (
            f"moves at {velocity.travel_mps:+.2f} m/s, {rate_text(velocity.rotate_radps, '+.1f')}"
        )
        held = f"{moves}, but should be stationary" if moving else self._slides or "standing"
        if latches.hazard is not None:
            text = f"{self.mode.name}: {latches.hazard.text}; {self._recovery_hint}"
            return text if held == "standing" else f"{held}: {text}"
        if latches.stopped_by is not None:
            return f"{held}: stopped by {latches.stopped_by}; send resume"
        if latches.paused is not None:
            return f"PAUSED: {latches.paused.text}; {self._recovery_hint}"
        if not status.odometry_fresh:
            return status.rejections.explain("standing: no odometry", Source.ODOMETRY)
        if active is None and self.goals.motion.blocked_by is not None:
            return f"{held}: {self.goals.motion.blocked_by.text}"
        inputs = ", ".join(map(str, self.safety.history.mux_inputs))
        publishing = ", ".join(filter(None, (inputs, *status.foreign_publishers)))
        others = f" (also publishing: {publishing})" if publishing else ""
        if active is None and inputs and moving:
            drivers = "; ".join(map(str, self.safety.history.drivers))
            return f"{moves}, driven by {drivers}: {self._idle_text}"
        if active is None:
            return f"{held}: {self._idle_text}{others}"
        doing = f"{active.command.identity} {active.command.name}{others}"
        doing += "" if self.lost_map is None else f": {self.lost_map.text}"
        navigation = "" if status.navigation is None else status.navigation.text
        doing += f", {navigation}" if navigation else ""
        return f"{moves} for {doing}" if moving else f"standing during {doing}"

    @property
    def _slides(self) -> str | None:
        over_ground = self.safety.history.over_ground
        if over_ground is None or not over_ground.apart_s:
            return None
        felt = over_ground.motion(self.clock.now_s())
        return None if felt is None else f"slides at {felt}, with its wheels at rest"

    @property
    def _recovery_hint(self) -> str:
        if self.safety.self_clearing:
            stopped = self.latches.stopped_by is not None
            return f"{'send resume' if stopped else 'continues'} once the cause is cleared"
        if self.safety.unresolved_cause() is None:
            return "the cause is cleared: send resume"
        return "clear the cause, then send resume"

    @property
    def _idle_text(self) -> str:
        plans, head = self.plans, next(iter(self.goals.motion), None)
        if head is not None and head.after is not None:
            waiting = head.command
            return f"{waiting.identity} {waiting.name} waits: {waiting.precondition}"
        if plans.executing is not None:
            return f"plan {plans.executing} {plans.waits or 'runs no motion now'}"
        if plans.suspended:
            names, first = ", ".join(plans.suspended), plans.suspended[0]
            recovery = f"send resumePlan {first} (`rover plan resume {first}`)"
            return f"plan {names} is suspended; {recovery}"
        return "no motion goal"
