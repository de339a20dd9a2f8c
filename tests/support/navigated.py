"""A rover without physics that a navigation drives, through a mux or by the executive's relay."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from math import cos, inf, sin
from pathlib import Path
from random import Random
from typing import Final, NamedTuple

from executive.settings import (
    Controller,
    MuxEntry,
    MuxSettings,
    NavigationGate,
    NavigationSettings,
    Settings,
    load_settings,
)
from executive.values.facts import (
    ForeignMuxInput,
    MapToOdom,
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    NavigationVelocity,
    PlannedPath,
)
from executive.values.geometry import STANDING, Pose, TargetFrame, Velocity, wrap_rad
from executive.values.ports import (
    DriveBy,
    NavigateTo,
    NavigationGoal,
    PathRequest,
    TurnBy,
)
from sim.rover.jackal import Mux
from tests.support.kinematic import STEP_S, Bench, KinematicRover
from tests.support.navigation import (
    FINE_TOLERANCE,
    GoalEnd,
    GoalFeedback,
    GoalResult,
    Navigation,
    ServerRestarted,
)
from tests.support.sensed_drive import STEP_S as SENSED_STEP_S
from tests.support.sensed_drive import SensedDrive

BASE_TIMEOUT_S: Final = 0.3
MAX_MPS: Final = 2.0
BRAKING_MPS2: Final = 2.0
BRAKING_RADPS2: Final = 6.0
ANSWER_S: Final = 0.1
"""Time from a request until the server's answer, and from a result until it arrives."""
SMOOTHER_S: Final = 1.0
"""Time for which velocity_smoother repeats the last velocity of a controller that has ended."""
INPUT: Final = "navigation"
MUX: Final = MuxSettings(
    input="executive",
    lock="e_stop",
    stop="stop",
    topics={
        "stop": MuxEntry("stop_vel", 0.1, 255),
        "joystick": MuxEntry("joy_teleop/cmd_vel", 0.5, 10),
        "executive": MuxEntry("executive/cmd_vel", 0.5, 5),
        INPUT: MuxEntry("nav_vel", 0.5, 1),
    },
    locks={"e_stop": MuxEntry("e_stop", 0.0, 255), INPUT: MuxEntry("nav_lock", 0.2, 2)},
)
_ENDS: Final = {
    GoalEnd.SUCCEEDED: NavigationState.SUCCEEDED,
    GoalEnd.ABORTED: NavigationState.ABORTED,
    GoalEnd.CANCELLED: NavigationState.CANCELLED,
}


def settings(gate: NavigationGate, **changes: object) -> Settings:
    """Return the settings of a Jackal with a navigation behind this gate."""
    if gate is NavigationGate.LOCK:
        navigation = NavigationSettings(gate, input=INPUT, lock=INPUT)
    else:
        navigation = NavigationSettings(gate)
    mux = MUX if gate is NavigationGate.LOCK else None
    own = replace(load_settings("jackal"), mux=mux, navigation=navigation)
    return replace(own, **{"controller": Controller.NAVIGATION, **changes})  # type: ignore[arg-type]


class _Key(NamedTuple):
    """Stands for a goal's UUID.

    Attributes:
        process: the executive's process, counted.
        number: of the goal.
        serial: of the request.
    """

    process: int
    number: int
    serial: int


class Server(Enum):
    """State of the navigation's processes."""

    RUNNING = "running"
    FROZEN = "frozen"  # SIGSTOP: requests wait
    KILLED = "killed"  # kill -9: requests are lost, though the server still seems ready
    ABSENT = "absent"


@dataclass
class NavigatedRover(KinematicRover):
    """A base that brakes by a ramp and has a timeout, driven through a mux or by the executive.

    `pose` and `velocity` are those of its odometry, `truth` is where it is.

    Attributes:
        goals: those that it was requested to navigate to.
        cancels: how often it was requested to cancel.
        moved_m, turned_rad: accumulated path of the base by ground truth.
        answer_s: latency of requests and results.
        lost_requests: number of goals that will be lost on their way to the server.
        loss_ratio: probability of that for each further goal, and for each cancel.
        smoother: whether the last velocity is repeated when the navigation sends none.
        first_request_s: time of the first goal that it was requested to navigate to.
        last_event_s: time of the navigation's last feedback or result on an own goal.
        joystick: velocity that it sends on its input of the mux; None while it is released.
        odometry_every: ticks between two messages of odometry; 0 for none.
        drift: part of each motion that odometry does not measure.
        map_to_odom: transform that is published; None while there is none.
        notices_restart: whether a restart of the server is reported at once, as LOST.
        preempted_late: whether a goal's ABORTED arrives before the other client's goal is seen.
    """

    gate: NavigationGate = NavigationGate.LOCK
    navigation: Navigation = field(default_factory=Navigation)
    truth: Pose = field(default_factory=Pose)
    goals: list[NavigationGoal] = field(default_factory=list)
    cancels: int = 0
    moved_m: float = 0.0
    turned_rad: float = 0.0
    answer_s: float = ANSWER_S
    lost_requests: int = 0
    loss_ratio: float = 0.0
    smoother: bool = False
    joystick: Velocity | None = None
    first_request_s: float = inf
    last_event_s: float = inf
    odometry_every: int = 1
    drift: float = 0.0
    map_to_odom: Pose | None = None
    notices_restart: bool = False
    preempted_late: bool = False
    server: Server = Server.RUNNING
    random: Random = field(default_factory=lambda: Random(0))
    now_s: float = 0.0
    _mux: Mux = field(default_factory=lambda: Mux(MUX))
    _wanted: Velocity = STANDING
    _wanted_at_s: float = -inf
    _moving: Velocity = STANDING
    _process: int = 1
    _serial: int = 0
    _key: _Key | None = None
    _abandoned: set[object] = field(default_factory=set)
    _answered: set[object] = field(default_factory=set)
    _others: set[object] = field(default_factory=set)
    _later: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    _frozen: list[Callable[[], None]] = field(default_factory=list)
    _last: Velocity = STANDING
    _last_at_s: float = -inf
    _ticks: int = 0

    # The port

    def drive(self, velocity: Velocity) -> None:
        self.sent.append(velocity)
        if self.gate is NavigationGate.RELAY or self._mux.passes("executive", self.now_s):
            self._command(velocity)

    def lock(self, held: bool) -> None:
        if self.gate is NavigationGate.RELAY:
            return
        self._mux.lock("e_stop", held, self.now_s)
        if held and self._mux.passes("stop", self.now_s):
            self._command(STANDING)

    def emergency_stop(self) -> None:
        self.open_gate(False)
        self.lock(True)
        self.drive(STANDING)

    def open_gate(self, is_open: bool) -> None:
        self._mux.lock(INPUT, not is_open, self.now_s)

    def navigate(self, goal: NavigationGoal) -> None:
        self.goals.append(goal)
        self.first_request_s = min(self.first_request_s, self.now_s)
        self._abandon()
        self._serial += 1
        key = self._key = _Key(self._process, goal.number, self._serial)
        if self.server is Server.ABSENT:
            self.facts.append(NavigationStatus(goal.number, NavigationState.UNAVAILABLE))
        elif self.lost_requests > 0:
            self.lost_requests -= 1
        elif self.random.random() >= self.loss_ratio:
            self._request(lambda: self._submit(key, goal))

    def cancel_navigation(self) -> None:
        self.cancels += 1
        self._abandon()
        if self.random.random() >= self.loss_ratio:
            self._request(lambda: self._cancel(None))

    def plan_path(self, request: PathRequest) -> None:
        points = request.start.point, request.goal.point
        self.facts.append(PlannedPath(request.number, points))

    # What happens to it

    def replace_server(self, navigation: Navigation | None = None) -> None:
        """Start another process of the navigation, which knows nothing of any goal."""
        behaviour, speed_mps = self.navigation.behaviour, self.navigation.speed_mps
        self.navigation = navigation or Navigation(behaviour, speed_mps=speed_mps)
        self.server = Server.RUNNING

    def set_server(self, server: Server) -> None:
        """Kill, freeze or continue the navigation."""
        self.server = server
        if server is Server.RUNNING:
            waiting, self._frozen = self._frozen, []
            for each in waiting:
                each()

    def restart_adapter(self) -> None:
        """Lose what the executive's process knew; messages that it sent are under way."""
        self._process += 1
        self._key = None
        self._abandoned.clear()
        self.facts.clear()

    def guard(self) -> None:
        """Stop as the guard of an executive that has ended: zero, and the gate shut."""
        self.open_gate(False)
        self.drive(STANDING)

    @property
    def is_stationary(self) -> bool:
        """Whether it is stationary by ground truth."""
        return self._moving == STANDING

    @property
    def moving(self) -> Velocity:
        """Its true velocity."""
        return self._moving

    def advance(self, step_s: float) -> None:
        self.now_s += step_s
        self._ticks += 1
        self._move(step_s)
        due = [each for at_s, each in self._later if at_s <= self.now_s + 1e-9]
        self._later = [each for each in self._later if each[0] > self.now_s + 1e-9]
        for each in due:
            each()
        self._step_navigation()
        if self.joystick is not None:
            self.facts.append(ForeignMuxInput("joystick", overrides=True))
            if self._mux.passes("joystick", self.now_s):
                self._command(self.joystick)
        if self.map_to_odom is not None:
            self.facts.append(MapToOdom(self.map_to_odom))

    # The base

    def _command(self, velocity: Velocity) -> None:
        if velocity.finite:
            travel_mps = max(-MAX_MPS, min(MAX_MPS, velocity.travel_mps))
            self._wanted = Velocity(travel_mps, velocity.rotate_radps)
            self._wanted_at_s = self.now_s

    @property
    def commanded(self) -> Velocity:
        """The velocity that the base obeys; zero after its timeout."""
        timed_out = self.now_s - self._wanted_at_s > BASE_TIMEOUT_S + 1e-9
        return STANDING if timed_out else self._wanted

    def _move(self, step_s: float) -> None:
        wanted, before = self.commanded, self._moving
        self._moving = now = Velocity(
            _toward(before.travel_mps, wanted.travel_mps, BRAKING_MPS2 * step_s),
            _toward(before.rotate_radps, wanted.rotate_radps, BRAKING_RADPS2 * step_s),
        )
        ahead_m = (before.travel_mps + now.travel_mps) / 2 * step_s
        turn_rad = (before.rotate_radps + now.rotate_radps) / 2 * step_s
        start = self.truth
        self.truth = _moved(start, ahead_m, turn_rad, self.spin_centre_m)
        self.moved_m += start.point.distance_m(self.truth.point)
        self.turned_rad += abs(turn_rad)
        measured = 1.0 - self.drift
        self.pose = _moved(self.pose, ahead_m * measured, turn_rad, self.spin_centre_m)
        self.velocity = now

    # The navigation and the messages to and from it

    def _request(self, request: Callable[[], None]) -> None:
        self._after(self.answer_s / 2, lambda: self._deliver(request))

    def _deliver(self, request: Callable[[], None]) -> None:
        if self.server is Server.FROZEN:
            self._frozen.append(request)
        elif self.server is Server.RUNNING:
            request()

    def _after(self, delay_s: float, action: Callable[[], None]) -> None:
        self._later.append((self.now_s + delay_s, action))

    def _abandon(self) -> None:
        if self._key is not None and self._key not in self._answered:
            self._abandoned.add(self._key)

    def _cancel(self, key: object | None) -> None:
        self.navigation.cancel(key)

    def _submit(self, key: _Key, goal: NavigationGoal) -> None:
        poses, relative = self._poses_of(goal.task)
        accepted = self.navigation.submit(key, poses, self.now_s)
        running = self.navigation.goal
        if relative and running is not None and running.key == key:
            running.tolerance = FINE_TOLERANCE
            running.reverse = isinstance(goal.task, DriveBy) and goal.task.distance_m < 0.0
        if accepted is not None:
            self._after(self.answer_s / 2, lambda: self._on_answer(key, accepted))

    def _on_answer(self, key: _Key, accepted: bool) -> None:
        """Report an answer, or cancel the goal if it was given up in the meantime."""
        if key.process != self._process:
            return
        self._answered.add(key)
        if key in self._abandoned:
            if accepted:
                self._request(lambda: self._cancel(key))
            return
        state = NavigationState.ACCEPTED if accepted else NavigationState.REJECTED
        self.facts.append(NavigationStatus(key.number, state))

    def _poses_of(self, task: NavigateTo | TurnBy | DriveBy) -> tuple[list[Pose], bool]:
        """Return the poses in the frame of odometry, and whether the task is relative."""
        now = self.pose
        match task:
            case NavigateTo(poses, TargetFrame.MAP):
                assert self.map_to_odom is not None
                to_odom = self.map_to_odom.inverse
                return [to_odom.compose(each) for each in poses], False
            case NavigateTo(poses):
                return list(poses), False
            case TurnBy(angle_rad):
                turned = replace(now, heading_rad=wrap_rad(now.heading_rad + angle_rad))
                return [turned], True
            case DriveBy(distance_m):
                point = now.ahead(distance_m)
                return [replace(now, x_m=point.x_m, y_m=point.y_m)], True

    def _step_navigation(self) -> None:
        velocity = None
        if self.server is Server.RUNNING:
            velocity = self.navigation.step(self.now_s, self.pose)
            self._take_status()
            self._take_events()
        if velocity is not None:
            self._last, self._last_at_s = velocity, self.now_s
        elif self.smoother and self.now_s - self._last_at_s <= SMOOTHER_S:
            velocity = self._last
        if velocity is not None:
            self.facts.append(NavigationVelocity(velocity))
            if self.gate is NavigationGate.LOCK and self._mux.passes(INPUT, self.now_s):
                self._command(velocity)

    def _take_events(self) -> None:
        events, self.navigation.events = self.navigation.events, []
        for event in events:
            self._take_event(event)

    def _take_status(self) -> None:
        """Look for goals of other clients on the status topic."""
        goal = self.navigation.goal
        if goal is None or goal.key in self._others or self._is_own(goal.key):
            return
        self._others.add(goal.key)
        preempted = NavigationStatus(self._number, NavigationState.PREEMPTED)
        late_s = self.answer_s + STEP_S if self.preempted_late else 0.0
        self._after(late_s, lambda: self.facts.append(preempted))

    def _is_own(self, key: object) -> bool:
        return isinstance(key, _Key) and key.process == self._process

    @property
    def _number(self) -> int:
        return 0 if self._key is None else self._key.number

    def _take_event(self, event: GoalFeedback | GoalResult | ServerRestarted) -> None:
        key = event.key
        if not isinstance(key, _Key) or not self._is_own(key) or key in self._abandoned:
            return
        number = key.number  # also of an earlier goal
        self.last_event_s = self.now_s
        match event:
            case GoalFeedback(_, remaining_m, recoveries, poses):
                feedback = NavigationFeedback(number, remaining_m, recoveries, poses)
                self._after(0.0, lambda: self.facts.append(feedback))
            case GoalResult(_, end, code, text):
                status = NavigationStatus(number, _ENDS[end], code, "", text)
                self._after(self.answer_s / 2, lambda: self.facts.append(status))
            case ServerRestarted() if self.notices_restart:
                lost = NavigationStatus(number, NavigationState.LOST)
                self._after(self.answer_s / 2, lambda: self.facts.append(lost))
            case ServerRestarted():
                pass


@dataclass
class SensedNavigatedRover(NavigatedRover):
    """The same with all sensors of a `SensedDrive`; its odometry is one of them."""

    def __post_init__(self) -> None:
        """Let it stand at the origin of its odometry."""
        self.body = SensedDrive(settings(self.gate))
        self.body.observe = lambda fact: self.facts.append(fact)
        self.odometry_every = 0

    def _move(self, step_s: float) -> None:
        before, body = self.truth, self.body
        body.commanded = self.commanded
        for _ in range(round(step_s / SENSED_STEP_S)):
            body.move_on()
        self.truth, self.pose = body.true, body.believed
        self._moving = self.velocity = body.motion
        self.moved_m += before.point.distance_m(self.truth.point)


class NavigatedBench(Bench):
    """An executive over a navigated rover."""

    rover: NavigatedRover

    def __init__(
        self,
        folder: Path,
        gate: NavigationGate,
        navigation: Navigation | None = None,
        settings_: Settings | None = None,
        start: Pose | None = None,
        sensed: bool = False,
    ) -> None:
        pose, navigation = start or Pose(), navigation or Navigation()
        kind = SensedNavigatedRover if sensed else NavigatedRover
        rover = kind(pose=pose, truth=pose, gate=gate, navigation=navigation)
        chosen = settings_ or settings(gate)
        if sensed:  # it turns about base_link
            law = replace(chosen.turn_drive, control_point_m=0.0)
            chosen = replace(chosen, turn_drive=law)
        super().__init__(folder, chosen, rover=rover, all_sensors=sensed)

    def step(self) -> None:
        """Let one tick pass; odometry may have a lower rate than ticks."""
        every = self.rover.odometry_every
        self.odometry = every > 0 and self.rover._ticks % every == 0
        super().step()

    def crash(self) -> None:
        """Lose the process as kill -9 does, and start another on the same ledger."""
        self.rover.restart_adapter()
        super().crash()

    def kill(self, duration_s: float, guard_after_s: float | None = None) -> None:
        """Lose the process, and start another after a while.

        Args:
            duration_s: how long there is none.
            guard_after_s: when the guard of the process stops the rover; None if it does not.
        """
        self.executive.simulate_crash()
        self.rover.restart_adapter()
        for tick in range(round(duration_s / STEP_S)):
            if guard_after_s is not None and tick * STEP_S >= guard_after_s:
                self.rover.guard()
            self.clock.advance(STEP_S)
            self.rover.advance(STEP_S)
            self.rover.facts.clear()
        self.restart()


def _moved(pose: Pose, ahead_m: float, turn_rad: float, spin_centre_m: float) -> Pose:
    along_rad, left_m = pose.heading_rad + turn_rad / 2, -spin_centre_m * turn_rad
    return Pose(
        pose.x_m + ahead_m * cos(along_rad) - left_m * sin(along_rad),
        pose.y_m + ahead_m * sin(along_rad) + left_m * cos(along_rad),
        heading_rad=wrap_rad(pose.heading_rad + turn_rad),
    )


def _toward(value: float, wanted: float, step: float) -> float:
    return max(value - step, min(value + step, wanted))
