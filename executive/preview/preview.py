"""`PreviewRun` predicts a motion or plan with the rover's tree and laws, on a kinematic copy of it.

Nothing here affects the rover, its ledger, tree or goals. The present state is copied as values,
so that a preview can be computed on any thread, in slices.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import ceil, inf
from typing import Final, Protocol, assert_never

from executive.checks import check_pose, check_request, is_navigated, path_mismatch
from executive.commands import (
    ABOARD_LINK,
    DIRECT_LINK,
    Command,
    DriveFor,
    Line,
    Motion,
    Request,
    SetRotateSpeed,
    SetTravelSpeed,
    requested_controller,
)
from executive.commands.intake import ABOARD_PREFIX, check_arguments, localized
from executive.commands.lifecycle import CommandLifecycle
from executive.goals import Context, Goals
from executive.motion import Arbiter, TrajectorySolver, make_locomotion
from executive.obstacles.detour import Detours
from executive.obstacles.zones import ROUNDING_M, Zones
from executive.plans import PlanNode, PlanStep, TimeLimit, TimeLimitEnd, nominal_steps
from executive.preview.navigated_base import NavigatedBase
from executive.preview.preview_rover import (
    CachedTrajectorySolver,
    DelegatedMotionBase,
    DynamicModelBase,
    KinematicBase,
)
from executive.safety import FaultMonitor
from executive.settings import (
    Controller,
    LocomotionKind,
    MotionEndKind,
    MotionExtent,
    NavigationGate,
    NavigationSettings,
    RelativeActions,
    Sensors,
    Settings,
    curved_m,
)
from executive.state import FileFolder, Status, Uncertainty
from executive.values.clock import ManualClock
from executive.values.facts import Battery, MapToOdom, PlannedPath
from executive.values.geometry import STANDING, Point, Pose, TargetFrame, Velocity, wrap_rad
from executive.values.ports import PathRequest
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity

MAX_PREVIEW_S: Final = 300.0
"""Maximum duration of a previewed motion, which bounds the computation; chosen, not measured."""
CONFIRMATION_S: Final = 0.1
"""Time that an inertial sensor needs to confirm the standstill after a motion."""
MAX_POSES: Final = 200
_IDENTITY: Final = Identity(f"{ABOARD_PREFIX}preview", 1)


@dataclass(frozen=True, slots=True)
class TimedPose:
    """Predicted pose of base_link at a time after the start."""

    time_s: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class Clearance:
    """Minimum distance of the rover's turning disc to a zone or a known rock.

    Attributes:
        obstacle: human-readable name of the obstacle.
    """

    least_m: float
    obstacle: str


@dataclass(frozen=True, slots=True)
class Preview:
    """Predicted result of a motion or a plan.

    Attributes:
        length_m: path length of base_link.
        turned_rad: sum of all turning, without sign.
        path: at most `MAX_POSES`, evenly spaced in time, in the odometry frame, with the end.
        within_m, within_rad: deviation from the end pose at 2 sigma.
        energy_j: None if the asset's settings lack energy figures.
        clearance: None without zones and known rocks.
        note: a restriction of the prediction, for display; empty without one.
    """

    duration_s: float
    length_m: float
    turned_rad: float
    path: tuple[TimedPose, ...]
    within_m: float
    within_rad: float
    energy_j: float | None
    clearance: Clearance | None
    note: str = ""

    @property
    def end(self) -> Pose:
        """Pose of base_link at the end."""
        return self.path[-1].pose


@dataclass(frozen=True, slots=True)
class StepPreview:
    """Predicted result of one step of a plan; `refusal` if it would be refused or fail.

    Attributes:
        node: path of its leaf.
        duration_s: 0 without motion.
        end: pose at its end; the time is from the start of the plan.
        clearance: None without motion, too.
    """

    node: str
    duration_s: float
    length_m: float
    end: TimedPose
    energy_j: float | None
    clearance: Clearance | None
    refusal: Refusal | None


@dataclass(frozen=True, slots=True)
class PreviewStart:
    """State copied from the present: the expected pose, speed limits, file folder.

    Attributes:
        obstacles: obstacles to avoid.
        uncertainty: uncertainty of the pose.
        map_origin: origin of the map in the frame of the pose; None if it is unknown.
        detours: detours, with earlier results.
        odom_origin: origin of the rover's odometry in the frame of the pose.
        battery: state of the battery, for navigated motions.
    """

    pose: Pose
    travel_speed_mps: float
    rotate_speed_radps: float
    slow_ratio: float
    files: FileFolder
    obstacles: Zones
    uncertainty: Uncertainty
    map_origin: Pose | None = None
    detours: Detours = field(default_factory=Detours)
    odom_origin: Pose = field(default_factory=Pose)
    battery: Battery | None = None


class TickableTree(Protocol):
    """The interface of a behaviour tree that a preview needs."""

    def tick(self) -> None:
        """Run every branch that is due once."""


@dataclass(slots=True)
class _PathTrace:
    """Trace of the copy: its path, and its clearance to known obstacles."""

    settings: Settings
    poses: list[TimedPose]
    length_m: float = 0.0
    turned_rad: float = 0.0
    curved_m: float = 0.0
    step_clearance: Clearance | None = None
    _earlier: Clearance | None = None
    _radius_m: float = field(init=False)
    _gaps_m: list[float] = field(init=False)

    def __post_init__(self) -> None:
        footprint = self.settings.footprint
        self._radius_m = 0.0 if footprint is None else footprint.radius_m
        self._gaps_m = [-inf for _ in self.settings.zones]
        self._update_clearance(self.poses[0].pose, self.poses[0].pose)

    def add(self, time_s: float, pose: Pose) -> None:
        before = self.poses[-1].pose
        self.poses.append(TimedPose(time_s, pose))
        if pose == before:
            return
        length_m = pose.point.distance_m(before.point)
        turned_rad = abs(wrap_rad(pose.heading_rad - before.heading_rad))
        self.length_m += length_m
        self.turned_rad += turned_rad
        self.curved_m += curved_m(length_m, turned_rad)
        self._update_clearance(before, pose)

    def _update_clearance(self, before: Pose, pose: Pose) -> None:
        """Compute the distances of the obstacles that may be the nearest now.

        The distance of each other one is at least the last one less the path since. Inside a zone
        the last one is that of a line's shallowest point; its end may be deeper by its length.
        """
        start, end = before.point, pose.point
        step_m = start.distance_m(end)
        for index, obstacle in enumerate(self.settings.zones):
            gap_m = self._gaps_m[index] - step_m
            least = self.step_clearance
            if least is None or gap_m - self._radius_m <= least.least_m + ROUNDING_M:
                gap_m = obstacle.clearance_m(start, end)
                left_m = gap_m - self._radius_m
                if least is None or left_m < least.least_m:
                    self.step_clearance = Clearance(left_m, obstacle.label)
                if gap_m <= 0.0:
                    gap_m -= step_m
            self._gaps_m[index] = gap_m

    def begin_step(self) -> None:
        self._earlier, self.step_clearance = self.clearance, None

    @property
    def clearance(self) -> Clearance | None:
        found = [each for each in (self._earlier, self.step_clearance) if each is not None]
        return min(found, key=lambda each: each.least_m, default=None)


class PreviewRun:
    """Computes one preview, in slices, on the thread that calls `advance`.

    A plan is previewed as if each step succeeded: of a fallback the first child, of a retry one
    attempt. Steps without motion take no time; speeds that a plan sets apply.

    Attributes:
        result: the preview, or the refusal of its motion; None until it is computed.
        steps: the predicted steps of a plan; the last one may be refused.
    """

    def __init__(
        self,
        request: Motion | PlanNode,
        start: PreviewStart,
        settings: Settings,
        build_tree: Callable[[Context], TickableTree],
        solver: TrajectorySolver | None = None,
    ) -> None:
        self._request = request
        self._start = start
        self._settings = replace(settings, sensors=Sensors(), zones=start.obstacles)
        self._confirmation_s = 0.0 if settings.sensors.imu is None else CONFIRMATION_S
        self._solver: CachedTrajectorySolver | None = None
        self._straight = ""
        navigation = _previewed_navigation(request, settings)
        mpc, controller = replace(settings.mpc, selectable=False), Controller.TURN_DRIVE
        if navigation is not None and settings.controller is Controller.NAVIGATION:
            controller = Controller.NAVIGATION
        elif navigation is None and solver is not None and uses_mpc(request, settings):
            self._solver = CachedTrajectorySolver(solver)
            mpc = replace(settings.mpc, odometry_age_s=0.0, odometry_slip=None)
            if settings.controller is Controller.MPC:
                controller = Controller.MPC
        self._settings = replace(
            self._settings, controller=controller, mpc=mpc, navigation=navigation, mux=None
        )
        self._build_tree = build_tree
        self._holds_velocity = any(isinstance(each, DriveFor) for each in _requests(request))
        self._course = iter(()) if isinstance(request, Motion) else nominal_steps(request)
        self._timeouts_s: list[float] = []
        self._lifecycle: CommandLifecycle | None = None
        self._step: PlanStep | None = None
        self._before = MotionExtent(0.0, 0.0, 0.0)
        self._began_s = 0.0
        self._end = MotionEndKind.LINE
        self._next = self._begin_first
        self.result: Preview | Refusal | None = None
        self.steps: list[StepPreview] = []

    @property
    def waiting_for_solver(self) -> bool:
        """Whether it waits for a trajectory."""
        return self._solver is not None and self._solver.busy

    @property
    def path_request(self) -> PathRequest | None:
        """The path of the navigation's planner that it waits for; None if it waits for none."""
        base = self._base
        request = base.path_request if isinstance(base, NavigatedBase) else None
        if request is None or request.frame is TargetFrame.MAP:
            return request
        into = self._start.odom_origin.inverse
        return replace(request, start=into.compose(request.start), goal=into.compose(request.goal))

    def provide_path(self, path: PlannedPath) -> None:
        """Provide the path that it waits for, as the planner answered, or why there is none."""
        request, start = self.path_request, self._start
        in_map = request is not None and request.frame is TargetFrame.MAP
        origin = (start.map_origin if in_map else start.odom_origin) or Pose()
        points, text = path.points, path.text
        if request is not None and points:
            text = path_mismatch(points, request.start.point, request.goal.point)
            points = () if text else points
        self._straight = self._straight if points else text
        moved = (origin.compose(Pose(each.x_m, each.y_m)).point for each in points)
        self.provide_leg(tuple(moved), text)

    def provide_leg(self, path: tuple[Point, ...], text: str = "") -> None:
        """Provide the path that it waits for as a leg has it, in the frame of the pose."""
        assert isinstance(self._base, NavigatedBase)
        self._base.provide_path(path, text)

    def advance(self, ticks: int) -> bool:
        """Advance the copy by some ticks, after `set_up`; return whether there is a result.

        A tick with a slice of a search is the last one.
        """
        for _ in range(ticks):
            if self.path_request is not None:
                break
            if self.result is None and not self.waiting_for_solver:
                self._next()
            if self._context.detours.searched:
                break
        return self.result is not None

    def set_up(self) -> None:
        """Create the copy, and start; called once."""
        clock, settings, start = ManualClock(), self._settings, self._start
        self._clock = clock
        self._base = self._copied_base(clock)
        status = Status(clock, settings)
        status.travel_speed_mps = start.travel_speed_mps
        status.rotate_speed_radps = start.rotate_speed_radps
        status.speed_limit_ratio = start.slow_ratio
        locomotion, mover = make_locomotion(self._base, clock, settings, status, self._solver)
        safety, goals = FaultMonitor(clock, settings), Goals(clock)
        self._track = _PathTrace(settings, [TimedPose(0.0, start.pose)])
        self._arbiter = Arbiter(clock, settings, self._base, mover, lambda: False)
        self._context = Context(
            *(clock, settings, status, safety, goals, locomotion, start.files),
            detours=start.detours,
        )
        self._tree = self._build_tree(self._context)
        if start.battery is not None:
            status.observe(start.battery)
        self._observe_base()

    def _begin_first(self) -> None:
        self._next = self._tick
        if isinstance(self._request, Motion):
            self._begin(self._request)
        else:
            self._begin_next()

    def _copied_base(
        self, clock: ManualClock
    ) -> KinematicBase | DynamicModelBase | DelegatedMotionBase:
        settings, start = self._settings, self._start
        pose = start.pose
        if settings.navigation is not None:
            ratio = start.slow_ratio
            speed_mps = min(start.travel_speed_mps * ratio, settings.navigation.speed_mps)
            speeds = Velocity(speed_mps, start.rotate_speed_radps * ratio)
            return NavigatedBase(clock, settings, pose, start.map_origin or Pose(), speeds)
        match settings.locomotion:
            case LocomotionKind.DELEGATED:
                return DelegatedMotionBase(clock, settings, pose)
            case LocomotionKind.VELOCITY if self._solver is None:
                return KinematicBase(clock, settings, pose)
            case LocomotionKind.VELOCITY:
                return DynamicModelBase(clock, settings, pose)
            case _:
                assert_never(settings.locomotion)

    def _tick(self) -> None:
        context, intents = self._context, self._context.intents
        if context.detours.advance():
            return
        intents.clear()
        self._tree.tick()
        if context.goals.motion.active is None:
            intents.motion = STANDING
        self._arbiter.commit(intents)
        if self._lifecycle is not None and self._lifecycle.stage.terminal:
            lifecycle, self._lifecycle = self._lifecycle, None
            self._clock.advance(self._confirmation_s)
            self._end_step(lifecycle)
        if self.result is not None:
            return
        self._clock.advance(self._settings.tick_s)
        self._base.advance()
        self._observe_base()
        if self._clock.now_s() > MAX_PREVIEW_S:
            text = f"duration exceeds {MAX_PREVIEW_S:g} s: preview it in parts"
            self.result = Refusal(Reason.NOT_SUPPORTED, text)

    def _observe_base(self) -> None:
        if self._start.map_origin is not None:
            self._context.status.observe(MapToOdom(self._start.map_origin.inverse))
        for fact in self._base.facts():
            self._context.status.observe(fact)
            if self._holds_velocity:  # only its result is that of the monitors' history
                self._context.safety.observe(fact)
        now_s = self._clock.now_s()
        if now_s > 0.0:
            self._track.add(now_s, self._base.pose)

    def _end_step(self, lifecycle: CommandLifecycle) -> None:
        if lifecycle.refusal is not None:
            self._refuse(lifecycle.refusal)
            return
        step = self._step
        took_s = self._clock.now_s() - self._began_s
        if step is not None and step.deadline_s is not None and took_s > step.deadline_s:
            self._refuse(_late(took_s, step.deadline_s))
            return
        self._add_step()
        self._begin_next()

    def _begin_next(self) -> None:
        """Start the next motion, or build the preview after the last."""
        for each in self._course:
            match each:
                case TimeLimit():
                    self._timeouts_s.append(self._clock.now_s())
                case TimeLimitEnd(limit=limit):
                    took_s = self._clock.now_s() - self._timeouts_s.pop()
                    if took_s > limit.duration_s:
                        self.result = _at(limit.path, _late(took_s, limit.duration_s))
                case PlanStep(request=request):
                    assert request is not None
                    self._step, self._before = each, self._extent()
                    self._track.begin_step()
                    self._set_or_begin(request)
            if self._lifecycle is not None or self.result is not None:
                return
        self.result = self._result()

    def _set_or_begin(self, request: Request) -> None:
        match request:
            case SetTravelSpeed(speed_mps):
                self._context.status.travel_speed_mps = speed_mps
            case SetRotateSpeed(speed_radps):
                self._context.status.rotate_speed_radps = speed_radps
            case _ if isinstance(request, Motion):
                self._begin(request)
                return
            case _:
                pass
        self._add_step()

    def _begin(self, wanted: Motion) -> None:
        pose, settings = self._context.status.pose, self._settings
        request = localized(wanted, self._context.status, settings)
        if isinstance(request, Refusal):
            self._refuse(request)
            return
        refusal = (
            check_arguments(request, settings, pose.point)
            or check_pose(request, pose, self._start.uncertainty, settings)
            or check_request(request, pose, settings, *self._context.scene)
        )
        if refusal is not None:
            self._refuse(refusal)
            return
        self._began_s = self._clock.now_s()
        self._end = end_kind(request, pose, settings)
        link = DIRECT_LINK if is_navigated(request, settings) else ABOARD_LINK
        self._lifecycle = CommandLifecycle(Command(_IDENTITY, request, link), lambda *_: None)
        self._lifecycle.accept()
        self._context.goals.motion.add(self._lifecycle)

    def _refuse(self, refusal: Refusal) -> None:
        """End with a refusal, prefixed by the plan step that it concerns."""
        if self._step is not None:
            self._add_step(refusal)
            refusal = _at(self._step.location.path, refusal)
        self.result = refusal

    def _add_step(self, refusal: Refusal | None = None) -> None:
        """Add the step that ends now, if a plan is previewed."""
        if self._step is None:
            return
        track, before, now = self._track, self._before, self._extent()
        took = replace(
            now,
            duration_s=now.duration_s - before.duration_s,
            length_m=now.length_m - before.length_m,
            turned_rad=now.turned_rad - before.turned_rad,
            curved_m=now.curved_m - before.curved_m,
        )
        self.steps.append(
            StepPreview(
                self._step.location.path,
                took.duration_s,
                took.length_m,
                TimedPose(now.duration_s, track.poses[-1].pose),
                self._settings.prediction.energy_j(took),
                track.step_clearance,
                refusal,
            )
        )

    def _extent(self) -> MotionExtent:
        track = self._track
        return MotionExtent(
            self._clock.now_s(), track.length_m, track.turned_rad, track.curved_m, self._end
        )

    def _result(self) -> Preview:
        track, prediction, extent = self._track, self._settings.prediction, self._extent()
        duration_s = extent.duration_s
        every = max(1, ceil((len(track.poses) - 1) / (MAX_POSES - 1)))
        path = track.poses[:-1:every]
        path.append(TimedPose(duration_s, track.poses[-1].pose))
        return Preview(
            duration_s,
            track.length_m,
            track.turned_rad,
            tuple(path),
            prediction.position_deviation_m(extent),
            prediction.heading_deviation_rad(extent),
            prediction.energy_j(extent),
            track.clearance,
            self._straight and f"along straight lines: {self._straight}",
        )


def _at(path: str, refusal: Refusal) -> Refusal:
    """Return a refusal, prefixed by the path of the node that it concerns."""
    return replace(refusal, text=f"{path}: {refusal.text}")


def _late(took_s: float, limit_s: float) -> Refusal:
    text = f"duration {took_s:.2f} s exceeds {limit_s:g} s"
    figures = (Figure("duration", took_s, "s"), Figure("bound", limit_s, "s"))
    return Refusal(Reason.PLAN_DEADLINE, text, figures)


def end_kind(request: Motion, start: Pose, settings: Settings) -> MotionEndKind:
    """Return how a motion of an asset from a start pose ends."""
    if (
        not settings.offers_mpc
        or requested_controller(request, settings.controller) is not Controller.MPC
    ):
        return MotionEndKind.LINE
    return (
        MotionEndKind.FREE_CURVE
        if isinstance(request.segments(start)[-1], Line)
        else MotionEndKind.CURVE
    )


def uses_mpc(what: Motion | PlanNode, settings: Settings) -> bool:
    """Return whether a motion, or a motion of a plan, is driven by mpc."""
    return settings.offers_mpc and any(
        requested_controller(each, settings.controller) is Controller.MPC
        for each in _requests(what)
    )


def _previewed_navigation(what: Motion | PlanNode, settings: Settings) -> NavigationSettings | None:
    """Return the settings of the copy's navigation; None if no motion is navigated."""
    navigation = settings.navigation
    if navigation is None or not any(is_navigated(each, settings) for each in _requests(what)):
        return None
    own = RelativeActions.OFF
    return replace(navigation, gate=NavigationGate.RELAY, input=None, lock=None, relative=own)


def _requests(what: Motion | PlanNode) -> tuple[Request, ...]:
    if isinstance(what, Motion):
        return (what,)
    course = (each for each in nominal_steps(what) if isinstance(each, PlanStep))
    return tuple(each.request for each in course if each.request is not None)
