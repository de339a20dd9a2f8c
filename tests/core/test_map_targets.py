"""Targets in the map: kept there while the transform of the map moves under the odometry."""

from contextlib import closing
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path

import pytest

from adapters.recording import RunFile
from adapters.recording.replay import replay
from executive.commands import FollowPath, MoveTo, Waypoint
from executive.commands.catalogue import SetPositionCompensation
from executive.commands.lifecycle import Duplicate
from executive.preview import Preview, PreviewRun
from executive.settings import TargetFrame, load_settings
from executive.values.facts import MapToOdom
from executive.values.geometry import STANDING, Point, Pose
from executive.values.reasons import Reason
from executive.values.reports import PlanStatus, Stage
from tests.support.kinematic import Bench, KinematicRover
from tests.support.plans import PlanBench, plan
from trees.snapshot import NodeStatus

MAP = TargetFrame.MAP
ODOM_IN_MAP = Pose(10.0, 5.0, heading_rad=pi / 2)


@dataclass
class LocalizedRover(KinematicRover):
    """A rover whose localisation tells of the map in each step."""

    odom_in_map: Pose | None = ODOM_IN_MAP

    def advance(self, step_s: float) -> None:
        super().advance(step_s)
        if self.odom_in_map is not None:
            self.facts.append(MapToOdom(self.odom_in_map))

    @property
    def in_map(self) -> Pose:
        assert self.odom_in_map is not None
        return self.odom_in_map.compose(self.pose)


def bench_with(
    folder: Path, frame: TargetFrame = TargetFrame.ODOM, tape: RunFile | None = None
) -> tuple[PlanBench, LocalizedRover]:
    rover = LocalizedRover()
    settings = replace(load_settings("jackal"), frame=frame)
    bench = PlanBench(folder, settings, rover=rover, tape=tape)
    bench.run(0.5)
    return bench, rover


def figure(bench: Bench, number: int, name: str) -> float:
    (found,) = (each.value for each in bench.last(number).figures if each.name == name)
    return found


def test_a_pose_and_its_inverse_compose_to_the_origin() -> None:
    pose = Pose(3.0, -2.0, heading_rad=2.5)
    found = pose.compose(pose.inverse)
    assert (found.x_m, found.y_m, found.heading_rad) == pytest.approx((0.0, 0.0, 0.0))
    assert ODOM_IN_MAP.compose(Pose(1.0, 0.0)).point.distance_m(Point(10.0, 6.0)) < 1e-9


@pytest.mark.parametrize("frame", [TargetFrame.ODOM, MAP])
def test_a_target_in_the_map_is_reached_there(tmp_path: Path, frame: TargetFrame) -> None:
    bench, rover = bench_with(tmp_path, frame)
    requested = MAP if frame is TargetFrame.ODOM else None
    with bench:
        bench.execute(MoveTo(Waypoint(10.0, 7.0, pi), frame=requested), 1)
        assert rover.in_map.point.distance_m(Point(10.0, 7.0)) < 0.05
        assert abs(abs(rover.in_map.heading_rad) - pi) < 0.08
        assert figure(bench, 1, "map x") == pytest.approx(rover.in_map.x_m, abs=0.01)
        assert figure(bench, 1, "map age") < 0.1
        path = (Waypoint(10.0, 6.0), Waypoint(11.0, 6.0))
        bench.execute(FollowPath(path, frame=requested), 2)
        assert rover.in_map.point.distance_m(Point(11.0, 6.0)) < 0.05
        bench.execute(MoveTo(Waypoint(1.0, 0.0), frame=TargetFrame.ODOM), 3)
        assert rover.pose.point.distance_m(Point(1.0, 0.0)) < 0.05


@pytest.mark.at_length
def test_the_target_stays_in_the_map_when_the_map_moves(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape:
        bench, rover = bench_with(tmp_path, tape=tape)
        bench.submit(MoveTo(Waypoint(10.0, 8.0, pi / 2), frame=MAP), 1)
        bench.run(2.0)
        assert rover.velocity.travel_mps > 0
        moved = Pose(10.2, 5.1, heading_rad=pi / 2 + 0.2)
        rover.odom_in_map = moved
        assert bench.finish(1) is Stage.EXECUTED
        assert rover.in_map.point.distance_m(Point(10.0, 8.0)) < 0.05
        assert abs(rover.in_map.heading_rad - pi / 2) < 0.08
        bench.executive.simulate_crash()
    assert replay(path).difference is None


def test_plans_and_previews_have_targets_in_the_map(tmp_path: Path) -> None:
    step = '<moveTo x="10" y="7" frame="map" deadline_s="60"/>'
    bench, rover = bench_with(tmp_path)
    with bench:
        for what in (MoveTo(Waypoint(10.0, 7.0), frame=MAP), plan(step)):
            run = bench.executive.preview(what)
            assert isinstance(run, PreviewRun)
            run.set_up()
            assert run.advance(2000)
            assert isinstance(run.result, Preview)
            assert run.result.end.point.distance_m(Point(2.0, 0.0)) < 0.05
        assert bench.outcome(step) is PlanStatus.COMPLETED
        assert rover.in_map.point.distance_m(Point(10.0, 7.0)) < 0.05


def test_a_compensated_pose_leaves_the_map_where_it_is(tmp_path: Path) -> None:
    bench, rover = bench_with(tmp_path)
    with bench:
        bench.execute(SetPositionCompensation(0.5, -0.3, 0.0, 0.4), 1)
        bench.execute(MoveTo(Waypoint(10.0, 7.0), frame=MAP), 2)
        assert rover.in_map.point.distance_m(Point(10.0, 7.0)) < 0.05


def test_without_a_recent_transform_it_is_refused(tmp_path: Path) -> None:
    bench, rover = bench_with(tmp_path)
    with bench:
        rover.odom_in_map = None
        bench.run(1.1)
        refusal = bench.refusal(MoveTo(Waypoint(10.0, 6.0), frame=MAP), 1)
        assert refusal.reason is Reason.NO_MAP
        assert refusal.text.startswith("no transform from map to odom for ")
        assert [each.value for each in refusal.figures if each.name == "bound"] == [1.0]
        bench.execute(MoveTo(Waypoint(1.0, 0.0)), 2)


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("lost_after_s", "leaf"), [(0.0, "plan leg"), (2.0, "plan leg"), (3.1, "finish leg")]
)
def test_a_motion_holds_until_the_transform_returns(
    tmp_path: Path, lost_after_s: float, leaf: str
) -> None:
    bench, rover = bench_with(tmp_path)
    with bench:
        if not lost_after_s:
            rover.odom_in_map = None
            bench.run(0.9)
        target = Point(10.0, 8.0)
        bench.submit(MoveTo(Waypoint(target.x_m, target.y_m), frame=MAP), 1)
        bench.run(lost_after_s)
        rover.odom_in_map = None
        bench.run(2.5)
        assert bench.stages(1)[-1] is Stage.PROGRESS
        running = [each.name for each in bench.nodes() if each.status is NodeStatus.RUNNING]
        assert running[-1] == leaf
        at = rover.pose.point
        bench.run(1.0)
        assert rover.velocity == STANDING
        assert rover.pose.point == at
        rover.odom_in_map = ODOM_IN_MAP
        assert bench.finish(1) is Stage.EXECUTED
        assert rover.in_map.point.distance_m(target) < 0.05


@pytest.mark.at_length
def test_a_path_and_a_plan_go_on_where_they_lost_the_transform(tmp_path: Path) -> None:
    bench, rover = bench_with(tmp_path)
    path = tuple(Waypoint(10.0, 5.5 + step, tolerance_m=0.3) for step in range(4))
    with bench:
        bench.submit(FollowPath(path, frame=MAP), 1)
        bench.run(2.0)
        rover.odom_in_map = None
        bench.run(4.0)
        rover.odom_in_map = replace(ODOM_IN_MAP, x_m=10.2)
        assert bench.finish(1) is Stage.EXECUTED
        assert rover.in_map.point.distance_m(path[-1].point) < 0.3
        bench.begin('<moveTo x="10" y="5" frame="map" deadline_s="60"/>', 2.0)
        rover.odom_in_map = None
        bench.run(4.0)
        assert rover.velocity == STANDING
        rover.odom_in_map = ODOM_IN_MAP
        assert bench.until(PlanStatus.COMPLETED, PlanStatus.FAILED) is PlanStatus.COMPLETED
        assert rover.in_map.point.distance_m(Point(10.0, 5.0)) < 0.05


def test_a_motion_without_the_transform_fails_after_a_wait(tmp_path: Path) -> None:
    bench, rover = bench_with(tmp_path)
    with bench:
        bench.submit(MoveTo(Waypoint(10.0, 9.0), frame=MAP), 1)
        bench.run(2.0)
        rover.odom_in_map = None
        bench.run(3.0)
        assert "no transform from map to odom for" in bench.executive.why
        assert bench.finish(1) is Stage.FAILED
        assert rover.velocity == STANDING
        assert bench.last(1).reason is Reason.NO_MAP
        assert 17.0 < figure(bench, 1, "age") < 20.0
        waits = [each.text for each in bench.received.reports if "waiting" in each.text]
        assert waits == ["waiting for the transform from map to odom"]
        bench.execute(MoveTo(Waypoint(1.0, 0.0)), 2)


def test_before_any_transform_it_is_refused(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        refusal = bench.refusal(MoveTo(Waypoint(1.0, 0.0), frame=MAP), 1)
        assert "no transform from map to odom yet" in refusal.text


@pytest.mark.at_length
@pytest.mark.parametrize(
    "motion", [MoveTo(Waypoint(1.0, 0.0)), FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.0)))]
)
def test_the_same_number_with_another_frame_is_another_command(
    tmp_path: Path, motion: MoveTo | FollowPath
) -> None:
    bench, _ = bench_with(tmp_path)
    with bench:
        first = replace(motion, frame=TargetFrame.ODOM)
        bench.execute(first, 1)
        assert isinstance(bench.submit(first, 1), Duplicate)
        for frame in (None, MAP):
            refusal = bench.refusal(replace(motion, frame=frame), 1)
            assert refusal.reason is Reason.DUPLICATE
        bench.crash()
        assert isinstance(bench.submit(first, 1), Duplicate)
        assert bench.refusal(replace(motion, frame=MAP), 1).reason is Reason.DUPLICATE
