"""What a fault has shown of the pose stays in force: over motions, a resume, and a restart."""

from collections.abc import Iterator
from dataclasses import replace
from math import hypot
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import (
    ConfirmPose,
    FollowPath,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    RotateTo,
    SetPositionCompensation,
    Waypoint,
)
from executive.obstacles.zones import KnownRock, Zones
from executive.settings import BatterySettings, load_settings
from executive.values.geometry import Pose, wrap_rad
from executive.values.reasons import Figure, Reason
from executive.values.reports import Report, Severity, Stage
from tests.core.test_second_odometry import SeeingBench, with_second_odometry
from tests.support.kinematic import Bench

ABSOLUTE: tuple[Request, ...] = (
    MoveTo(Waypoint(1.0, 0.0, 0.0)),
    FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.0))),
    RotateTo(0.5),
)


def moved(pose: Pose, x_m: float = 0.0, y_m: float = 0.0, heading_rad: float = 0.0) -> Pose:
    return replace(
        pose,
        x_m=pose.x_m + x_m,
        y_m=pose.y_m + y_m,
        heading_rad=wrap_rad(pose.heading_rad + heading_rad),
    )


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with Bench(tmp_path) as bench:
        bench.run(1.0)
        yield bench


def jump(bench: Bench, **by: float) -> None:
    """Let the odometry jump, and end what the executive does about it."""
    bench.rover.pose = moved(bench.rover.pose, **by)
    bench.run(0.5)
    number = bench.executive.last_sequence + 100
    bench.submit(Resume(), number)
    assert bench.stages(number)[-1] is Stage.EXECUTED
    bench.run(0.5)


def figure(report: Report, name: str) -> float:
    return next(each.value for each in report.figures if each.name == name)


def test_a_resume_does_not_make_a_pose_good_that_a_jump_has_disproved(bench: Bench) -> None:
    jump(bench, x_m=0.5)
    for number, request in enumerate(ABSOLUTE[:2], start=1):
        refusal = bench.refusal(request, number)
        assert refusal.reason is Reason.POSE_UNCERTAIN
        for message in ("0.5", "odometry_jumped", "setPositionCompensation", "confirmPose"):
            assert message in refusal.text
        assert {each.name for each in refusal.figures} >= {
            "position uncertainty",
            "heading uncertainty",
            "position bound",
        }
    bench.execute(RotateTo(0.5), 3)


def test_a_turned_heading_refuses_headings_and_lines(bench: Bench) -> None:
    jump(bench, heading_rad=0.4)
    for number, request in enumerate(ABSOLUTE, start=1):
        assert bench.refusal(request, number).reason is Reason.POSE_UNCERTAIN


def test_relative_motions_run_and_report_their_start(bench: Bench) -> None:
    jump(bench, x_m=0.5)
    bench.execute(MoveForward(1.0), 1)
    assert "from (0.50, 0.00), uncertain by 0.5" in bench.last(1).text
    assert figure(bench.last(1), "position uncertainty") == pytest.approx(0.53, abs=0.02)


def test_the_uncertainty_grows_with_the_distance_that_is_driven(bench: Bench) -> None:
    jump(bench, heading_rad=0.4)
    before = bench.executive.status.uncertainty
    bench.execute(MoveForward(2.0), 1)
    after = bench.executive.status.uncertainty
    assert after.position_m - before.position_m == pytest.approx(2.0 * (0.4 + 0.02), abs=0.05)


@pytest.mark.parametrize(
    "remedy", [ConfirmPose(0.0, 0.0), SetPositionCompensation(-0.5, 0.0, 0.0, 0.0)]
)
def test_an_operator_makes_the_pose_certain_again(bench: Bench, remedy: Request) -> None:
    jump(bench, x_m=0.5)
    bench.execute(remedy, 1)
    assert not bench.executive.status.uncertainty
    bench.execute(ABSOLUTE[0], 2)


@pytest.mark.at_length
def test_a_confirmed_pose_is_as_uncertain_as_the_operator_states(bench: Bench) -> None:
    bench.execute(ConfirmPose(0.3, 0.0), 1)
    assert bench.refusal(ABSOLUTE[0], 2).reason is Reason.POSE_UNCERTAIN
    bench.execute(MoveTo(Waypoint(9.0, 0.0)), 3)


def test_the_uncertainty_outlives_a_crash(bench: Bench) -> None:
    jump(bench, x_m=0.5, heading_rad=0.3)
    before = bench.executive.status.uncertainty
    bench.crash()
    bench.run(0.5)
    assert bench.executive.status.uncertainty == before
    assert bench.refusal(ABSOLUTE[0], 1).reason is Reason.POSE_UNCERTAIN
    bench.execute(ConfirmPose(0.0, 0.0), 2)
    bench.crash()
    bench.run(0.5)
    bench.execute(ABSOLUTE[0], 3)


def test_growth_and_end_are_reported_once(bench: Bench) -> None:
    jump(bench, x_m=0.5)
    bench.run(3.0)
    bench.execute(ConfirmPose(0.0, 0.0), 1)
    bench.run(1.0)
    message = [each for each in bench.received.reports if each.text.startswith("the pose is")]
    assert [each.severity for each in message] == [Severity.WARNING, Severity.INFORMATIONAL]
    assert message[0].reason is Reason.POSE_UNCERTAIN
    assert figure(message[0], "position uncertainty") == pytest.approx(0.5)


def test_a_rover_at_rest_on_a_drifting_pose_adds_up_all_of_the_drift(bench: Bench) -> None:
    for _ in range(40):
        bench.rover.pose = moved(bench.rover.pose, y_m=0.01)
        bench.step()
    bench.submit(Resume(), 90)
    assert bench.executive.status.uncertainty.position_m >= 0.4


def test_a_restart_alone_adds_nothing(bench: Bench) -> None:
    bench.execute(MoveForward(2.0), 1)
    bench.crash()
    bench.run(1.0)
    bench.execute(ABSOLUTE[0], 2)


def test_a_crash_within_a_motion_adds_nothing(bench: Bench) -> None:
    bench.drive_on(2.0)
    bench.crash()
    bench.run(1.0)
    bench.execute(ABSOLUTE[0], 2)


@pytest.mark.at_length
@pytest.mark.parametrize("pose", [Pose(), Pose(2.0, 1.0), Pose(2.0, 0.0, heading_rad=1.0)])
def test_odometry_that_differs_after_a_restart_is_uncertain(bench: Bench, pose: Pose) -> None:
    bench.execute(MoveForward(2.0), 1)
    bench.rover.pose = pose
    bench.crash()
    bench.run(1.0)
    assert bench.refusal(ABSOLUTE[0], 2).reason is Reason.POSE_UNCERTAIN
    assert "the restart" in bench.executive.status.uncertainty.cause


def test_zones_are_widened_by_the_uncertainty(tmp_path: Path) -> None:
    rock = Zones(rocks=(KnownRock("stone", 2.0, 0.9, 0.2),))
    with Bench(tmp_path, replace(load_settings("jackal"), zones=rock)) as bench:
        bench.run(1.0)
        jump(bench, x_m=0.5)
        refusal = bench.refusal(MoveForward(3.0), 1)
        assert refusal.reason is Reason.PATH_BLOCKED
        assert "0.50 m of it for the position uncertainty" in refusal.text
        assert {Figure("position uncertainty", 0.5, "m")} <= {
            replace(each, value=round(each.value, 2)) for each in refusal.figures
        }
        bench.execute(ConfirmPose(0.0, 0.0), 2)
        bench.execute(MoveForward(1.0), 3)


def test_the_return_home_is_longer_by_the_uncertainty(tmp_path: Path) -> None:
    jackal = load_settings("jackal")
    assert jackal.battery is not None
    battery = BatterySettings(capacity_j=1000.0, reserve_ratio=0.1, home=jackal.battery.home)
    with Bench(tmp_path, replace(jackal, battery=battery)) as bench:
        bench.charge_ratio = 0.4
        bench.run(1.0)
        jump(bench, y_m=2.0)
        bench.execute(ConfirmPose(0.0, 0.0), 1)
        bench.execute(MoveForward(0.3), 2)
        bench.execute(ConfirmPose(8.0, 0.0), 3)
        assert bench.refusal(MoveForward(0.3), 4).reason is Reason.BATTERY_INSUFFICIENT


@pytest.fixture
def seeing(tmp_path: Path) -> Iterator[SeeingBench]:
    with SeeingBench(tmp_path, with_second_odometry()) as bench:
        bench.run(6.0)
        yield bench


@pytest.mark.at_length
def test_a_second_odometry_that_agrees_makes_the_pose_certain_again(seeing: SeeingBench) -> None:
    jump(seeing, x_m=0.5)
    true = moved(seeing.rover.pose, x_m=-0.5)
    seeing.seen = lambda _: true
    seeing.run(2.0)
    assert seeing.refusal(ABSOLUTE[0], 1).reason is Reason.POSE_UNCERTAIN
    jump(seeing, x_m=-0.5)
    seeing.seen = lambda pose: pose
    seeing.run(2.0)
    assert not seeing.executive.status.uncertainty
    seeing.execute(ABSOLUTE[0], 2)


@pytest.mark.at_length
def test_a_push_that_only_the_second_odometry_sees_is_not_forgotten(seeing: SeeingBench) -> None:
    seeing.seen = lambda pose: moved(pose, y_m=0.5)
    seeing.run(3.0)
    seeing.submit(Resume(), 90)
    seeing.run(2.0)
    refusal = seeing.refusal(ABSOLUTE[0], 1)
    assert refusal.reason is Reason.POSE_UNCERTAIN
    assert "slide_at_rest" in refusal.text
    seeing.execute(SetPositionCompensation(0.0, 0.5, 0.0, 0.0), 2)
    seeing.execute(ABSOLUTE[0], 3)


def test_a_push_between_two_runs_is_detected_by_the_second_odometry(seeing: SeeingBench) -> None:
    seeing.execute(MoveForward(1.0), 1)
    seeing.run(2.0)
    seeing.seen = lambda pose: moved(pose, y_m=0.5)
    seeing.crash()
    seeing.run(3.0)
    assert seeing.refusal(ABSOLUTE[0], 2).reason is Reason.POSE_UNCERTAIN
    assert seeing.executive.status.uncertainty.position_m == pytest.approx(0.5, abs=0.05)


def test_a_motion_that_was_not_confirmed_leaves_its_error_behind(seeing: SeeingBench) -> None:
    seeing.submit(MoveForward(1.0), 1)
    seeing.run(0.5)
    seeing.seen = lambda pose: moved(pose, y_m=0.09)
    assert seeing.finish(1) is Stage.FAILED
    seeing.run(2.0)
    seeing.submit(Resume(), 90)
    assert seeing.executive.status.uncertainty.position_m == pytest.approx(0.09, abs=0.01)


@pytest.mark.at_length
@given(
    st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0), st.booleans(), st.booleans()
)
@settings(max_examples=25, deadline=None)
def test_no_jump_is_forgotten(
    tmp_path_factory: pytest.TempPathFactory,
    x_m: float,
    y_m: float,
    heading_rad: float,
    crash: bool,
    second: bool,
) -> None:
    """An absolute motion ends EXECUTED only where the odometry is truly right."""
    folder, asset = tmp_path_factory.mktemp("jump"), load_settings("jackal")
    with SeeingBench(folder, with_second_odometry() if second else asset) as bench:
        bench.run(6.0)
        true = bench.rover.pose
        bench.seen = lambda _: true
        bench.rover.pose = moved(bench.rover.pose, x_m, y_m, heading_rad)
        bench.run(1.5)
        if crash:
            bench.crash()
            bench.run(1.5)
        bench.submit(Resume(), 90)
        bench.run(1.0)
        wrong = hypot(x_m, y_m) > 0.2 or abs(heading_rad) > 0.1
        bench.submit(ABSOLUTE[0], 1)
        refused = bench.last(1).stage is Stage.REJECTED
        assert refused if wrong else True
