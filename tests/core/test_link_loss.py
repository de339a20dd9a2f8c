"""What the rover does when nothing is heard of the ground: in stages, by mode, and told."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import (
    Command,
    DriveFor,
    FollowPath,
    Mode,
    MoveForward,
    Request,
    Resume,
    SetTravelSpeed,
    Stop,
    Waypoint,
)
from executive.commands.catalogue import ActivatePlan, ResumePlan, SubmitPlan
from executive.commands.lifecycle import Rejected
from executive.core.link_loss import ReturnPath
from executive.core.reactions import RETURN_SOURCE
from executive.settings import LinkLossSettings, SettingsError, load_settings, structure
from executive.values.geometry import STANDING, Point, Pose
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, ReportKind, Stage
from tests.support.kinematic import Bench
from tests.support.plans import plan

JACKAL = load_settings("jackal")
STAGES = [{"after_s": 2, "then": "hold"}, {"after_s": 10, "then": "stop"}]


def bench_with(folder: Path, **stages: object) -> Bench:
    loss = structure(stages, LinkLossSettings, "jackal.yaml")
    return Bench(folder, replace(JACKAL, link_loss=loss))


def texts(bench: Bench) -> list[str]:
    reports = bench.received.reports
    return [r.text for r in reports if r.reason is Reason.LINK_LOST and r.identity is None]


@pytest.mark.at_length
def test_by_default_it_continues(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(20.0), 1)
        assert bench.finish(1) is Stage.EXECUTED
        assert texts(bench) == []


@pytest.mark.at_length
def test_motion_is_held_at_the_end_of_the_step_and_continues_on_contact_with_the_ground(
    tmp_path: Path,
) -> None:
    with bench_with(tmp_path, motion=STAGES[:1]) as bench:
        for number in (1, 2):
            bench.submit(MoveForward(3.0), number)
        assert bench.finish(1) is Stage.EXECUTED
        bench.run(20.0)
        assert bench.stages(2)[-1] is Stage.ACCEPTED
        assert texts(bench) == [
            "no contact with the ground for 2.0 s: the rover holds at the end of the step"
        ]
        assert bench.executive.why == f"standing: {texts(bench)[0]}"
        bench.executive.ground.record_contact()
        assert bench.finish(2) is Stage.EXECUTED
        assert any(r.text == "ground link recovered" for r in bench.received.reports)


def test_teleoperation_is_stopped_until_resumed(tmp_path: Path) -> None:
    with bench_with(tmp_path, teleop=[{"after_s": 1, "then": "stop"}], motion=STAGES) as bench:
        bench.submit(DriveFor(0.5, 0.0, 30.0), 1)
        bench.run(0.9)
        bench.executive.ground.record_contact()
        bench.run(0.9)
        assert bench.executive.mode is Mode.TELEOP
        bench.run(0.3)
        assert bench.executive.mode.name == "STOPPED"
        assert (bench.stages(1)[-1], bench.last(1).reason) == (Stage.FAILED, Reason.LINK_LOST)
        assert "no contact with the ground" in bench.executive.why
        bench.submit(Resume(), 2)
        assert any(r.text == "ground link recovered" for r in bench.received.reports)
        bench.execute(MoveForward(0.2), 3)


@pytest.mark.at_length
def test_a_later_stage_follows_an_earlier_one(tmp_path: Path) -> None:
    with bench_with(tmp_path, motion=STAGES) as bench:
        bench.submit(MoveForward(15.0), 1)
        bench.run(11.0)
        assert len(texts(bench)) == 2
        assert bench.executive.mode is Mode.STOPPED
        assert bench.last(1).reason is Reason.LINK_LOST


@pytest.mark.at_length
def test_a_plan_is_suspended_between_two_steps(tmp_path: Path) -> None:
    legs = '<moveForward distance="3" deadline_s="60"/>' * 3
    with bench_with(tmp_path, plan=STAGES[:1]) as bench:
        bench.submit(SubmitPlan(plan(f"<Sequence>{legs}</Sequence>")), 1)
        bench.submit(ActivatePlan("survey"), 2)
        bench.run(30.0)
        assert bench.executive.mode is Mode.PAUSED
        assert 2.9 < bench.rover.pose.x_m < 3.1
        assert bench.received.plans[-1].done == 1


AT_TEN = [{"after_s": 10, "then": "return"}]


def mode(bench: Bench) -> Mode:
    return bench.executive.mode


def returns(bench: Bench) -> list[Report]:
    """Give the reports on the command by which the rover returns."""
    return [r for r in bench.received.reports if r.identity and r.identity.source == RETURN_SOURCE]


def events(bench: Bench) -> list[str]:
    return [r.text for r in bench.received.reports if r.kind is ReportKind.EVENT]


@pytest.mark.at_length
def test_it_returns_along_its_path_to_the_last_contact_with_the_ground(tmp_path: Path) -> None:
    around = [Waypoint(2.0, 0.0), Waypoint(2.0, 2.0), Waypoint(10.0, 2.0)]
    with bench_with(tmp_path, motion=AT_TEN) as bench:
        bench.execute(MoveForward(0.5), 1)
        bench.executive.ground.record_contact()
        bench.submit(FollowPath(tuple(around)), 2)
        bench.run(9.9)
        assert bench.rover.pose.y_m > 1.9
        bench.run(0.2)
        assert (bench.last(2).stage, bench.last(2).reason) == (Stage.FAILED, Reason.LINK_LOST)
        assert mode(bench) is Mode.MOVING
        least_x_m, poses = bench.rover.pose.x_m, []
        for _ in range(40):
            bench.run(0.5)
            poses.append(bench.rover.pose)
        aside_m = max(min(abs(p.y_m), abs(p.x_m - 2.0), abs(p.y_m - 2.0)) for p in poses)
        assert least_x_m >= 2.0 - 0.1
        assert aside_m < 0.15
        assert (bench.rover.pose.x_m, bench.rover.pose.y_m) == pytest.approx((0.5, 0.0), abs=0.05)
        assert bench.rover.pose.heading_rad == pytest.approx(0.0, abs=0.05)
        assert [r.stage for r in returns(bench)][-1] is Stage.EXECUTED
        assert events(bench)[-1] == "the rover is back at the position of the last ground contact"
        assert mode(bench) is Mode.IDLE
        bench.execute(MoveForward(0.5), 3)


def test_a_returning_rover_reports_it_and_halts_on_contact_with_the_ground(
    tmp_path: Path,
) -> None:
    with bench_with(tmp_path, motion=[{"after_s": 2, "then": "return"}]) as bench:
        bench.submit(MoveForward(20.0), 1)
        bench.run(5.0)
        assert texts(bench) == [
            "no contact with the ground for 2.0 s:"
            " the rover returns to the position of the last contact"
        ]
        assert bench.rover.velocity.travel_mps < -0.1
        assert f"for {returns(bench)[-1].identity} followPath" in bench.executive.why
        bench.executive.ground.record_contact()
        bench.run(1.0)
        assert bench.rover.velocity == STANDING
        assert (returns(bench)[-1].stage, events(bench)[-1]) == (
            Stage.CANCELLED,
            "ground link recovered",
        )
        assert mode(bench) is Mode.IDLE


@pytest.mark.at_length
@pytest.mark.parametrize("request_", [MoveForward(1.0), SetTravelSpeed(0.5), ActivatePlan("none")])
def test_any_command_ends_the_return_before_it_is_checked(
    tmp_path: Path, request_: Request
) -> None:
    with bench_with(tmp_path, motion=[{"after_s": 2, "then": "return"}]) as bench:
        bench.submit(MoveForward(20.0), 1)
        bench.run(3.0)
        bench.submit(request_, 2)
        assert returns(bench)[-1].stage is Stage.CANCELLED
        bench.run(1.5)
        assert bench.last(2).reason is (
            Reason.NO_SUCH_PLAN if isinstance(request_, ActivatePlan) else None
        )


@pytest.mark.at_length
def test_it_stops_waits_and_then_returns_and_stops_if_it_takes_too_long(tmp_path: Path) -> None:
    stages = [(3, "stop"), (5, "return"), (7, "stop")]
    reactions = [{"after_s": after_s, "then": then} for after_s, then in stages]
    with bench_with(
        tmp_path, teleop=reactions, motion=[{"after_s": 1, "then": "continue"}]
    ) as bench:
        bench.submit(DriveFor(1.0, 0.0, 30.0), 1)
        bench.run(4.0)
        assert mode(bench) is Mode.STOPPED
        away_m = bench.rover.pose.x_m
        bench.run(2.5)
        assert mode(bench) is Mode.MOVING
        assert bench.rover.pose.x_m < away_m - 0.1
        bench.run(1.0)
        assert mode(bench) is Mode.STOPPED
        assert returns(bench)[-1].reason is Reason.LINK_LOST


@pytest.mark.at_length
def test_a_plan_is_suspended_for_the_return(tmp_path: Path) -> None:
    legs = '<moveForward distance="3" deadline_s="60"/>' * 3
    with bench_with(tmp_path, plan=[{"after_s": 2, "then": "return"}]) as bench:
        bench.submit(SubmitPlan(plan(f"<Sequence>{legs}</Sequence>")), 1)
        bench.submit(ActivatePlan("survey"), 2)
        bench.run(2.5)
        assert mode(bench) is Mode.MOVING
        bench.run(15.0)
        assert mode(bench) is Mode.PAUSED
        assert bench.rover.pose.x_m == pytest.approx(0.0, abs=0.05)
        bench.submit(ResumePlan("survey"), 3)
        bench.run(1.0)
        assert mode(bench) is Mode.PLAN


@pytest.mark.alike
@pytest.mark.parametrize("first", ["hold", "stop"])
def test_a_rover_stopped_from_aboard_does_not_return(tmp_path: Path, first: str) -> None:
    with bench_with(tmp_path, motion=[{"after_s": 2, "then": first}, *AT_TEN]) as bench:
        bench.submit(MoveForward(20.0), 1)
        bench.run(3.0)
        bench.send(Command(Identity("ROS", 1), Stop(), "ros"))
        bench.run(10.0)
        assert mode(bench) is Mode.STOPPED
        assert events(bench)[-1].startswith(
            "the rover is stopped because it cannot return: not accepted in mode STOPPED"
        )
        bench.submit(Resume(), 2)
        bench.execute(MoveForward(0.5), 3)


def test_a_return_ended_by_a_fault_is_reported(tmp_path: Path) -> None:
    with bench_with(tmp_path, motion=[{"after_s": 2, "then": "return"}]) as bench:
        bench.submit(MoveForward(20.0), 1)
        bench.run(3.0)
        bench.odometry = False
        bench.run(3.0)
        assert returns(bench)[-1].stage is Stage.FAILED
        assert bench.rover.velocity == STANDING
        assert any(text.startswith("the rover did not return: ") for text in events(bench))


def test_no_other_client_commands_as_the_rover_itself(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        command = Command(Identity(RETURN_SOURCE, 1), MoveForward(1.0), "direct")
        assert isinstance(bench.send(command), Rejected)
        assert "reserved for the rover itself" in bench.received.reports[-1].text


@settings(max_examples=25)
@given(steps=st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 60)), max_size=6))
def test_the_return_path_is_never_far_from_the_outbound_one(
    steps: list[tuple[float, int]],
) -> None:
    trail, pose, arrived = ReturnPath(), Pose(), [Point(0.0, 0.0)]
    for curvature_per_m, count in steps:
        for _ in range(count):
            heading_rad = pose.heading_rad + 0.05 * curvature_per_m
            position = replace(pose, heading_rad=heading_rad).ahead(0.05)
            pose = Pose(position.x_m, position.y_m, heading_rad=heading_rad)
            trail.extend(pose)
            arrived.append(pose.point)
    path = [pose.point, *(Point(each.x_m, each.y_m) for each in trail.path_back)]
    for start, end in pairwise(path):
        for part in range(11):
            x_m = start.x_m + (end.x_m - start.x_m) * part / 10
            y_m = start.y_m + (end.y_m - start.y_m) * part / 10
            assert min(Point(x_m, y_m).distance_m(each) for each in arrived) < 0.4


@pytest.mark.parametrize(
    ("stages", "text"),
    [
        ([(10, "stop"), (2, "hold")], "put the earliest first"),
        ([(1, "wait")], "'wait' is none of continue, hold, stop, return"),
        ([(1, "stop"), (2, "hold")], "hold follows stop: only return can"),
        ([(1, "return"), (2, "continue")], "continue follows return: only stop can"),
        ([(0, "stop")], "after_s"),
    ],
)
def test_stages_that_make_no_sense_are_refused(stages: list[tuple[int, str]], text: str) -> None:
    read = [{"after_s": after_s, "then": then} for after_s, then in stages]
    with pytest.raises(SettingsError, match=text):
        structure({"motion": read}, LinkLossSettings, "jackal.yaml")


@pytest.mark.at_length
@pytest.mark.parametrize(("link", "signs"), [("ros", 0), ("direct", 1), ("relay", 1)])
def test_only_a_message_by_a_ground_link_is_contact(tmp_path: Path, link: str, signs: int) -> None:
    with bench_with(tmp_path, motion=[{"after_s": 2, "then": "continue"}]) as bench:
        bench.submit(MoveForward(10.0), 1)
        bench.run(1.5)
        assert bench.executive.ground.silent_s > 1.4
        bench.send(Command(Identity("someone", 1), SetTravelSpeed(0.5), link))
        bench.run(1.0)
        assert len(texts(bench)) == 1 - signs
