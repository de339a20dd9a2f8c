"""A motion that a navigation below makes, judged by the rover's own odometry."""

from collections.abc import Callable, Iterator
from contextlib import closing
from math import pi
from pathlib import Path

import pytest

from adapters.recording import RunFile
from adapters.recording.replay import replay
from executive.commands import FollowPath, MoveForward, MoveTo, Resume, Stop, Waypoint
from executive.commands.catalogue import DriveFor, SetPositionCompensation
from executive.motion import Leg
from executive.safety import unmonitored
from executive.settings import (
    Controller,
    NavigationGate,
    NavigationSettings,
    SettingsError,
    TargetFrame,
)
from executive.state import NavigationTrack
from executive.values.clock import ManualClock
from executive.values.facts import (
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    NavigationVelocity,
)
from executive.values.geometry import STANDING, Point, Pose, Velocity
from executive.values.ports import NavigateTo, NavigationGoal
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.support.kinematic import Bench
from tests.support.navigated import NavigatedBench, NavigatedRover, Server, settings
from tests.support.navigation import Navigation

LOCK, RELAY = NavigationGate.LOCK, NavigationGate.RELAY
NEAR = MoveTo(Waypoint(1.2, 0.4))
FAR = MoveTo(Waypoint(4.0, 0.0))


@pytest.fixture(params=list(NavigationGate), ids=lambda gate: gate.value)
def gate(request: pytest.FixtureRequest) -> NavigationGate:
    found: NavigationGate = request.param
    return found


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., NavigatedBench]]:
    benches: list[NavigatedBench] = []

    def begin(gate: NavigationGate, behaviour: str = "honest", **changes: object) -> NavigatedBench:
        bench = NavigatedBench(tmp_path, gate, Navigation(behaviour), settings(gate, **changes))
        benches.append(bench)
        return bench

    yield begin
    for each in benches:
        each.executive.simulate_crash()


Start = Callable[..., NavigatedBench]


def off_m(bench: NavigatedBench, x_m: float, y_m: float) -> float:
    return bench.rover.truth.point.distance_m(Point(x_m, y_m))


def figure(bench: NavigatedBench, number: int, name: str) -> float:
    (found,) = (each.value for each in bench.last(number).figures if each.name == name)
    return found


def test_the_navigation_drives_and_the_rover_drives_the_rest(
    start: Start, gate: NavigationGate
) -> None:
    bench = start(gate)
    bench.execute(NEAR, 1)
    assert off_m(bench, 1.2, 0.4) < 0.03
    text = bench.last(1).text
    assert "by odometry alone; the navigation reported success 0.1" in text
    (goal,) = bench.rover.goals
    assert goal.number == 1
    assert goal.command == Identity("MOE", 1)
    assert isinstance(goal.task, NavigateTo)
    assert goal.task.frame is TargetFrame.ODOM
    bench.execute(MoveTo(Waypoint(0.4, 0.4), Controller.TURN_DRIVE), 2)
    assert len(bench.rover.goals) == 1


def test_a_target_is_sent_in_the_frame_of_the_rovers_odometry(start: Start) -> None:
    bench = start(LOCK)
    bench.execute(SetPositionCompensation(1.0, 0.0, 0.0, pi / 2), 1)
    bench.execute(MoveTo(Waypoint(1.0, 1.0)), 2)
    (goal,) = bench.rover.goals
    assert isinstance(goal.task, NavigateTo)
    assert goal.task.poses[0].point.distance_m(Point(1.0, 0.0)) < 1e-9
    assert off_m(bench, 1.0, 0.0) < 0.03


@pytest.mark.parametrize("end", ["stop", "joystick", "replace", "drive"])
def test_each_end_shuts_the_gate_and_cancels(start: Start, gate: NavigationGate, end: str) -> None:
    bench = start(gate, "deaf_to_cancel")
    bench.submit(FAR, 1)
    bench.run(4.0)
    assert bench.rover.moving.travel_mps > 0.3
    cancels = bench.rover.cancels
    if end == "stop":
        bench.submit(Stop(), 2)
    elif end == "replace":
        bench.replace(MoveForward(0.0 + 0.1), 2)
    elif end == "drive":
        bench.replace(DriveFor(0.1, 0.0, 0.5), 2)
    elif gate is RELAY:
        return
    else:
        bench.rover.joystick = STANDING
    bench.run(0.5)
    assert bench.rover.cancels > cancels
    if end in {"stop", "joystick"}:
        assert bench.rover.is_stationary
        path_m = bench.rover.moved_m
        bench.run(1.0)
        assert bench.rover.moved_m == path_m
    if end == "joystick":
        assert bench.executive.mode.name == "PAUSED"
    bench.run(2.0)
    assert bench.executive.mode.name == "SAFE"  # it obeys no cancel


def test_a_pause_ends_the_goal_and_its_end_requests_another(start: Start) -> None:
    bench = start(LOCK)
    bench.submit(NEAR, 1)
    bench.run(2.0)
    bench.rover.joystick = STANDING
    bench.run(1.0)
    assert bench.rover.is_stationary
    bench.rover.joystick = None
    bench.run(1.0)
    bench.execute(Resume(), 2)
    assert bench.finish(1) is Stage.EXECUTED
    assert [each.number for each in bench.rover.goals] == [1, 2]


def test_an_unanswered_goal_is_requested_under_another_number(start: Start) -> None:
    bench = start(LOCK)
    bench.rover.lost_requests = 2
    bench.execute(NEAR, 1)
    assert [each.number for each in bench.rover.goals] == [1, 2, 3]


def test_a_navigation_that_is_not_there_is_awaited(start: Start) -> None:
    bench = start(LOCK)
    bench.rover.server = Server.ABSENT
    bench.submit(NEAR, 1)
    bench.run(2.0)
    bench.rover.set_server(Server.RUNNING)
    assert bench.finish(1) is Stage.EXECUTED
    bench.rover.server = Server.ABSENT
    bench.submit(MoveTo(Waypoint(0.0, 0.0)), 2)
    assert bench.finish(2) is Stage.FAILED
    assert bench.last(2).reason is Reason.NAVIGATION_UNAVAILABLE
    assert 4.5 < figure(bench, 2, "waited") < 5.0


def test_a_goal_of_the_process_before_is_cancelled_and_drives_nothing(
    start: Start, gate: NavigationGate
) -> None:
    bench = start(gate)
    bench.submit(FAR, 1)
    bench.run(3.0)
    bench.kill(1.0, guard_after_s=0.2)
    path_m = bench.rover.moved_m
    bench.run(6.0)
    assert bench.rover.moved_m == path_m
    assert bench.executive.mode.name == "IDLE"
    bench.execute(MoveTo(Waypoint(1.0, 0.0)), 2)


class Late(Navigation):
    """Reaches its target, and repeats its last velocity afterwards, by no goal."""

    until_s = 0.0
    repeats_s = 0.8

    def step(self, now_s: float, pose: Pose) -> Velocity | None:
        goal, velocity = self.goal, super().step(now_s, pose)
        if goal is not None and self.goal is None:
            self.until_s = now_s + self.repeats_s
        return Velocity(0.2, 0.0) if now_s < self.until_s else velocity


@pytest.mark.parametrize("repeats_s", [0.8, 4.0])
def test_success_waits_until_the_navigation_is_silent(start: Start, repeats_s: float) -> None:
    bench, late = start(LOCK), Late()
    bench.rover.navigation, late.repeats_s = late, repeats_s
    bench.submit(MoveTo(Waypoint(1.0, 0.0, tolerance_m=0.3)), 1)
    ended = bench.finish(1)
    assert ended is (Stage.EXECUTED if repeats_s < 1.0 else Stage.FAILED)
    if ended is Stage.EXECUTED:
        assert bench.clock.now_s() >= late.until_s
    else:
        assert bench.last(1).reason is Reason.NAVIGATION_UNCOMMANDED_MOTION
        assert bench.executive.mode.name == "SAFE"


def test_settings_with_a_navigation_need_a_rover_with_one(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="this rover has no navigation"):
        Bench(tmp_path, settings(LOCK))


class Undecided(Navigation):
    """Gives feedback, and never drives."""

    def step(self, now_s: float, pose: Pose) -> Velocity | None:
        if self.goal is not None:
            self._feed(self.goal, now_s, 1.5)
        return None


def test_a_drive_without_an_end_has_a_deadline_that_names_its_state(start: Start) -> None:
    section = NavigationSettings(RELAY, recovery_s=2.0)
    bench = start(RELAY, navigation=section)
    bench.rover.navigation = Undecided()
    bench.submit(NEAR, 1)
    bench.run(2.0)
    state = "navigation goal 1 accepted, 1.50 m of its path left"
    assert bench.executive.why == f"standing during MOE:1 moveTo, {state}"
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.DRIVE_DEADLINE
    assert bench.last(1).text.startswith(f"drive: not done ({state}) within ")


def test_motion_behind_a_lock_is_listed_as_not_monitored() -> None:
    named = {name for each in unmonitored(settings(LOCK)) for name in each.faults}
    assert "off_command" in named - {n for e in unmonitored(settings(RELAY)) for n in e.faults}


def test_the_position_of_odometry_counts_not_the_report(start: Start) -> None:
    bench = start(LOCK, "succeeds_at_once")
    bench.submit(MoveTo(Waypoint(0.7, 0.4)), 1)
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.OFF_TARGET
    text = "the navigation reported success 0.81 m from the target"
    assert bench.last(1).text.startswith(text)
    bench.execute(MoveTo(Waypoint(0.3, 0.2)), 2)
    assert off_m(bench, 0.3, 0.2) < 0.03


PATH = (
    Waypoint(1.0, 0.0, tolerance_m=0.8),
    Waypoint(1.5, 0.5, tolerance_m=0.8),
    Waypoint(2.0, 0.0),
    Waypoint(2.0, -1.0),
)


def test_wide_waypoints_are_passed_in_one_goal(start: Start) -> None:
    bench = start(LOCK)
    bench.execute(FollowPath(PATH), 1)
    sizes = [
        len(each.task.poses) for each in bench.rover.goals if isinstance(each.task, NavigateTo)
    ]
    assert sizes == [3, 1]
    assert off_m(bench, 2.0, -1.0) < 0.03


class Shortcut(Navigation):
    """Drives to the last pose alone, and reports success for all."""

    def submit(self, key: object, poses: list[Pose], now_s: float) -> bool | None:  # type: ignore[override]
        return super().submit(key, poses[-1:], now_s)


def test_a_waypoint_that_odometry_did_not_pass_is_driven_to_again(start: Start) -> None:
    bench = start(LOCK)
    bench.rover.navigation = Shortcut()
    path = (Waypoint(1.0, 1.5, tolerance_m=0.8), Waypoint(2.0, 0.0))
    bench.execute(FollowPath(path), 1)
    ends = [
        each.task.poses[-1].point for each in bench.rover.goals if isinstance(each.task, NavigateTo)
    ]
    assert [(round(each.x_m, 3), round(each.y_m, 3)) for each in ends] == [(2, 0), (1, 1.5), (2, 0)]
    assert off_m(bench, 2.0, 0.0) < 0.03


MAP = TargetFrame.MAP
ODOM_IN_MAP = Pose(10.0, 5.0, heading_rad=pi / 2)


def test_a_target_in_the_map_is_sent_in_the_map_and_stays_there(start: Start) -> None:
    bench = start(LOCK)
    bench.rover.map_to_odom = ODOM_IN_MAP
    bench.run(0.2)
    bench.submit(MoveTo(Waypoint(10.0, 6.5), frame=MAP), 1)
    bench.run(2.0)
    bench.rover.map_to_odom = moved = Pose(10.2, 5.1, heading_rad=pi / 2 + 0.1)
    assert bench.finish(1) is Stage.EXECUTED
    assert moved.compose(bench.rover.pose).point.distance_m(Point(10.0, 6.5)) < 0.03
    goal = bench.rover.goals[0]
    assert isinstance(goal.task, NavigateTo)
    assert goal.task.frame is MAP
    assert goal.task.poses[0].point.distance_m(Point(10.0, 6.5)) < 1e-9
    assert figure(bench, 1, "map moved") > 0.1


def test_a_lost_transform_holds_the_motion_and_then_fails_it(start: Start) -> None:
    bench = start(LOCK)
    bench.rover.map_to_odom = ODOM_IN_MAP
    bench.run(0.2)
    bench.submit(MoveTo(Waypoint(10.0, 8.0), frame=MAP), 1)
    bench.run(2.0)
    bench.rover.map_to_odom = None
    bench.run(1.6)
    assert bench.rover.is_stationary
    bench.rover.map_to_odom = ODOM_IN_MAP
    bench.run(1.5)
    assert bench.rover.moving.travel_mps > 0.1
    bench.rover.map_to_odom = None
    assert bench.finish(1, 6.0) is Stage.FAILED
    assert bench.last(1).reason is Reason.NO_MAP
    assert 3.9 < figure(bench, 1, "age") < 5.5
    assert bench.rover.is_stationary


def test_the_waypoints_of_a_leg_move_with_its_map() -> None:
    leg = Leg(0.0, Point(2.0, 0.0), False, None, 0.03, via_points=(Waypoint(1.0, 0.0),))
    (via,) = leg.moved(Pose(5.0, 1.0, heading_rad=pi / 2)).via_points
    assert via.point.distance_m(Point(5.0, 2.0)) < 1e-9


def test_a_tolerance_beyond_the_reach_of_the_finish_counts(start: Start) -> None:
    bench = start(LOCK, "succeeds_at_once")
    bench.execute(MoveTo(Waypoint(0.8, 0.0, tolerance_m=0.9)), 1)
    assert bench.rover.moved_m == 0.0


def test_a_jump_of_the_map_at_the_end_is_compared_again(start: Start) -> None:
    bench = start(LOCK)
    bench.rover.map_to_odom = ODOM_IN_MAP
    bench.run(0.2)
    bench.submit(MoveTo(Waypoint(10.0, 6.2), frame=MAP), 1)
    while not any("reported success" in each.message for each in bench.executive.tree.nodes()):
        bench.step()
    bench.rover.map_to_odom = moved = Pose(10.0, 4.2, heading_rad=pi / 2)
    assert bench.finish(1) is Stage.EXECUTED
    assert moved.compose(bench.rover.pose).point.distance_m(Point(10.0, 6.2)) < 0.03
    assert len(bench.rover.goals) == 2


@pytest.mark.at_length
def test_a_recording_with_a_navigation_is_replayed_with_the_same_decisions(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape:
        rover = NavigatedRover(navigation=Navigation("recovers"), map_to_odom=ODOM_IN_MAP)
        bench = NavigatedBench.__new__(NavigatedBench)
        super(NavigatedBench, bench).__init__(tmp_path, settings(LOCK), rover=rover, tape=tape)
        bench.run(0.2)
        bench.submit(MoveTo(Waypoint(10.3, 6.0, pi), frame=MAP), 1)
        assert bench.finish(1) is Stage.EXECUTED
        rover.navigation = Navigation("aborts_and_drives_on")
        bench.submit(MoveTo(Waypoint(-1.0, 0.0)), 2)
        assert bench.finish(2) is Stage.FAILED
        bench.run(3.0)
        assert bench.executive.mode.name == "SAFE"
        bench.run(5.0)
        bench.execute(Resume(), 3)
        bench.executive.simulate_crash()
    assert replay(path).difference is None


def goal(number: int) -> NavigationGoal:
    return NavigationGoal(number, NavigateTo((Pose(1.0),), TargetFrame.ODOM), Identity("MOE", 1))


def test_reports_of_other_goals_and_after_the_end_change_nothing() -> None:
    clock = ManualClock()
    track = NavigationTrack(clock)
    track.observe(NavigationStatus(1, NavigationState.ACCEPTED))
    assert not track.accepted
    track.begin(goal(2))
    for state in NavigationState:
        track.observe(NavigationStatus(1, state))
    track.observe(NavigationFeedback(1, 0.0))
    assert track.text == "navigation goal 2 requested"
    track.observe(NavigationStatus(2, NavigationState.UNAVAILABLE))
    assert not track.answered
    track.observe(NavigationStatus(2, NavigationState.ACCEPTED))
    clock.advance(2.0)
    track.observe(NavigationStatus(2, NavigationState.ACCEPTED))
    assert track.contact_s == clock.now_s() - 2.0
    track.observe(NavigationStatus(2, NavigationState.SUCCEEDED))
    for state in NavigationState:
        track.observe(NavigationStatus(2, state))
    assert track.answer == NavigationStatus(2, NavigationState.SUCCEEDED)
    track.end()
    assert not track.accepted
    assert track.text == ""


@pytest.mark.parametrize("velocity", [Velocity(float("nan"), 0.0), Velocity(0.0, 0.1)])
def test_a_velocity_that_is_not_zero_is_motion(velocity: Velocity) -> None:
    track = NavigationTrack(ManualClock())
    track.observe(NavigationVelocity(Velocity(1e-9, -1e-9)))
    assert not track.moves
    track.observe(NavigationVelocity(velocity))
    assert track.moves
