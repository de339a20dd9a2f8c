"""A rover that carries out whole motions, also for another way than the executive's."""

from collections.abc import Iterator
from math import hypot, pi
from pathlib import Path
from typing import Any

import pytest

from executive.commands import (
    DriveFor,
    FollowPath,
    Mode,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
    Waypoint,
)
from executive.motion import make_locomotion
from executive.state import Status
from executive.values.clock import ManualClock
from executive.values.facts import ExternalCommandEnded, ExternalCommandRunning, ExternalStop
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import CameraIntent, DelegatedMotion, DriveBy, TurnBy, VelocityHold
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.support.kinematic import ALL_STAGES, KinematicRover
from tests.support.self_moving import SelfMovingBench, settings

pytestmark = pytest.mark.alike


def near(value: float) -> Any:
    return pytest.approx(value)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[SelfMovingBench]:
    with SelfMovingBench(tmp_path) as bench:
        yield bench


def motions(bench: SelfMovingBench) -> list[TurnBy | DriveBy | VelocityHold]:
    return [motion.primitive for motion in bench.rover.reported if motion is not None]


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (RotateBy(-4.0), [TurnBy(-4.0, 1.5)]),
        (RotateTo(pi / 2), [TurnBy(near(pi / 2), 1.5)]),
        (MoveForward(-1.5), [DriveBy(near(-1.5), 1.0)]),
        (DriveFor(0.5, 0.2, 3.0), [VelocityHold(Velocity(0.5, 0.2), near(3.0))]),
        (
            MoveTo(Waypoint(0.0, 2.0, 0.0)),
            [TurnBy(near(pi / 2), 1.5), DriveBy(near(2.0), 1.0), TurnBy(near(-pi / 2), 1.5)],
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_command_splits_into_delegated_motions_each_requested_once(
    bench: SelfMovingBench, request_: Request, expected: list[TurnBy | DriveBy | VelocityHold]
) -> None:
    bench.rover.reported.clear()
    bench.execute(request_, 1)
    assert bench.stages(1) == ALL_STAGES
    assert motions(bench) == expected
    assert bench.rover.reported.count(None) == 0
    assert bench.rover.sent == []


def test_the_speed_that_is_set_goes_with_the_motion(bench: SelfMovingBench) -> None:
    bench.submit(SetTravelSpeed(0.25), 1)
    bench.execute(MoveForward(1.0), 2)
    assert motions(bench) == [DriveBy(near(1.0), 0.25)]


def test_a_path_is_driven_and_a_slipping_leg_is_retried(bench: SelfMovingBench) -> None:
    bench.rover.slip = 0.02
    positions = (Waypoint(1.0, 0.0), Waypoint(3.0, 1.0))
    bench.execute(FollowPath(positions), 1)
    pose = bench.rover.pose
    assert hypot(pose.x_m - 3.0, pose.y_m - 1.0) <= 0.03


def test_a_stop_halts_it_at_once_until_resume(bench: SelfMovingBench) -> None:
    bench.drive_on()
    bench.submit(Stop(), 2)
    assert bench.rover.reported[-1] is None
    assert bench.rover.velocity == STANDING
    assert bench.finish(1) is Stage.CANCELLED
    assert bench.finish(2) is Stage.EXECUTED
    halts = bench.rover.reported.count(None)
    bench.run(5.0)
    assert bench.rover.reported.count(None) == halts
    bench.submit(Resume(), 3)
    bench.execute(MoveForward(0.5), 4)


def test_a_rover_that_does_not_halt_is_stopped_again(bench: SelfMovingBench) -> None:
    bench.submit(MoveForward(50.0), 1)
    bench.run(1.0)
    bench.rover.deaf = True
    before = bench.rover.reported.count(None)
    bench.submit(Stop(), 2)
    bench.run(4.5)
    assert bench.rover.reported.count(None) - before == 6
    assert bench.finish(2) is Stage.FAILED
    assert bench.last(2).reason is Reason.STOP_DEADLINE


def test_what_replaces_a_motion_halts_it_first(bench: SelfMovingBench) -> None:
    bench.drive_on()
    bench.replace(RotateBy(1.0), 2)
    assert bench.finish(2) is Stage.EXECUTED
    first, halt, second = bench.rover.reported[-3:]
    assert isinstance(first, DelegatedMotion)
    assert halt is None
    assert isinstance(second, DelegatedMotion)


def test_a_refusal_by_the_rover_fails_with_its_text(bench: SelfMovingBench) -> None:
    bench.rover.refuses = True
    bench.submit(MoveForward(1.0), 1)
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.MOTION_NOT_EXECUTED
    assert "motor stuck" in bench.last(1).text


@pytest.mark.at_length
@pytest.mark.parametrize("is_active", [False, True])
def test_an_unanswered_leg_fails_by_its_deadline_unless_it_is_active(
    bench: SelfMovingBench, is_active: bool
) -> None:
    bench.rover.deaf = True
    bench.submit(MoveForward(1.0), 1)
    bench.run(0.5)
    if is_active:
        bench.executive.observe(ExternalCommandRunning(Identity("MOE", 1)))
        bench.run(60.0)
        bench.executive.observe(ExternalCommandEnded(Identity("MOE", 1), True))
    assert bench.finish(1) is (Stage.EXECUTED if is_active else Stage.FAILED)
    assert bench.last(1).reason is (None if is_active else Reason.DRIVE_DEADLINE)
    bench.step()
    assert bench.rover.reported[-1] is None


def test_it_halts_when_ticks_end(bench: SelfMovingBench) -> None:
    bench.drive_on()
    bench.clock.advance(1.0)
    bench.executive.observe(bench.rover.angles)
    assert bench.rover.reported[-1] is None


def test_a_motion_that_was_halted_between_ticks_is_not_begun_again(bench: SelfMovingBench) -> None:
    bench.drive_on()
    bench.clock.advance(0.2)
    bench.executive.observe(bench.rover.angles)
    answer, bench.rover.facts = bench.rover.facts, []
    bench.run(0.2)
    assert bench.rover.reported[-1] is None
    bench.rover.facts = answer
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.MOTION_NOT_EXECUTED


def test_the_rover_must_be_of_the_kind_that_the_settings_name() -> None:
    chosen, clock = settings(), ManualClock()
    with pytest.raises(TypeError, match="delegated"):
        make_locomotion(KinematicRover(), clock, chosen, Status(clock, chosen))


@pytest.mark.at_length
def test_the_camera_waits(bench: SelfMovingBench, monkeypatch: pytest.MonkeyPatch) -> None:
    point = bench.rover.point_camera

    def point_at_rest(wanted: CameraIntent) -> None:
        if bench.rover.velocity == STANDING:
            point(wanted)

    monkeypatch.setattr(bench.rover, "point_camera", point_at_rest)
    bench.submit(MoveForward(20.0), 1)
    bench.submit(SetCameraAngles(0.5, 0.0), 2)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.finish(2) is Stage.EXECUTED


@pytest.mark.parametrize("executed", [True, False])
def test_a_command_by_another_link_ends_as_there(bench: SelfMovingBench, executed: bool) -> None:
    bench.submit(MoveForward(1.0), 1)
    bench.submit(MoveForward(1.0), 2)
    bench.run(0.2)
    bench.executive.observe(ExternalCommandEnded(Identity("MOE", 1), executed))
    bench.step()
    assert bench.stages(1)[-1] is (Stage.EXECUTED if executed else Stage.FAILED)
    assert bench.finish(2) is Stage.EXECUTED


def test_an_active_leg_is_neither_stopped_nor_aborted(bench: SelfMovingBench) -> None:
    bench.run(0.2)
    bench.rover.reported.clear()
    bench.rover.execute_motion(DelegatedMotion(0, DriveBy(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    bench.submit(MoveForward(5.0), 1)
    bench.run(0.2)
    bench.executive.observe(ExternalCommandRunning(Identity("MOE", 1)))
    bench.run(20.0)
    assert len(bench.rover.reported) == 1
    bench.executive.observe(ExternalCommandEnded(Identity("MOE", 1), True))
    bench.step()
    assert bench.stages(1)[-1] is Stage.EXECUTED


def test_a_rover_moved_by_another_command_halts_before_its_leg(bench: SelfMovingBench) -> None:
    bench.run(0.2)
    bench.rover.execute_motion(DelegatedMotion(0, DriveBy(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    bench.execute(MoveForward(0.5), 2)
    assert None in bench.rover.reported


def test_a_restart_leaves_alone_what_another_link_moves(bench: SelfMovingBench) -> None:
    bench.rover.reported.clear()
    bench.rover.execute_motion(DelegatedMotion(0, DriveBy(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    bench.crash()
    bench.run(1.0)
    bench.executive.close()
    assert None not in bench.rover.reported
    assert bench.rover.velocity != STANDING


def test_a_restart_halts_motion_of_the_executive(bench: SelfMovingBench) -> None:
    bench.submit(MoveForward(9.0), 1)
    bench.run(1.0)
    bench.crash()
    assert bench.rover.reported[-1] is None
    bench.rover.facts.clear()
    bench.run(0.2)
    bench.submit(MoveForward(9.0), 2)
    bench.run(1.0)
    assert bench.rover.velocity != STANDING
    bench.executive.close()
    assert bench.rover.reported[-1] is None


def test_a_stop_halts_what_another_link_moves_but_once(bench: SelfMovingBench) -> None:
    bench.rover.execute_motion(DelegatedMotion(0, DriveBy(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    for number in (2, 3):
        bench.submit(Stop(), number)
        assert bench.rover.reported[-1] is None
        assert bench.finish(number) is Stage.EXECUTED
        bench.run(0.2)
        bench.rover.execute_motion(DelegatedMotion(0, DriveBy(5.0, 0.2), Identity("MOE", 4)))
        bench.run(3.0)
        assert bench.rover.reported[-1] is not None
    assert bench.executive.mode is Mode.STOPPED


def test_a_stop_by_another_link_cancels_all_and_latches_nothing(bench: SelfMovingBench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(5.0), 2)
    bench.run(1.0)
    bench.rover.reported.clear()
    bench.rover.halt()
    bench.executive.observe(ExternalStop(Identity("MOE", 40)))
    bench.run(0.5)
    for number in (1, 2):
        assert (bench.stages(number)[-1], bench.last(number).reason) == (
            Stage.CANCELLED,
            Reason.STOPPED,
        )
    assert bench.rover.velocity == STANDING
    bench.execute(MoveForward(0.5), 3)
