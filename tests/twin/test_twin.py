"""The twin predicts where a command finds a rover behind a delay of 10 s."""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import hypot, pi
from pathlib import Path

import pytest

from adapters.twin import PredictedPose, ReportedPose, Twin
from adapters.twin import twin as twin_module
from executive.commands import (
    DIRECT_LINK,
    Command,
    FollowPath,
    MoveForward,
    PreemptionPolicy,
    Resume,
    RotateBy,
    Stop,
    Waypoint,
)
from executive.settings import load_settings
from executive.values.geometry import Point, Pose
from executive.values.reports import Identity, Stage
from sim.rover import World
from sim.rover.faults import LeftWheelsStuck
from sim.rover.lockstep import LockStep
from tests.support.delayed import DelayedLink

ONE_WAY_S = 5.0
JACKAL = load_settings("jackal")
SLOW = replace(JACKAL, drive=replace(JACKAL.drive, travel_speed_mps=0.5))


@contextmanager
def delayed(folder: Path, loss: float = 0.0) -> Iterator[DelayedLink]:
    bench = LockStep(SLOW, World(), folder, seed=3)
    link = DelayedLink(bench, ONE_WAY_S, loss)
    try:
        link.run(2 * ONE_WAY_S)
        yield link
    finally:
        link.twin.close()
        bench.executive.close()


def predicted(link: DelayedLink) -> PredictedPose:
    found = link.twin.predict(link.utc_s)
    assert found is not None
    return found


def error_m(link: DelayedLink, found: PredictedPose) -> float:
    """Return the error of a prediction, at the time of arrival."""
    assert abs(found.arrival_utc_s - link.utc_s) < 0.06
    return found.pose.point.distance_m(link.pose.point)


def off_path_m(path: tuple[Point, ...], point: Point) -> float:
    def off_m(start: Point, end: Point) -> float:
        dx, dy = end.x_m - start.x_m, end.y_m - start.y_m
        along = (point.x_m - start.x_m) * dx + (point.y_m - start.y_m) * dy
        part = min(1.0, max(0.0, along / (dx * dx + dy * dy or 1.0)))
        return hypot(start.x_m + part * dx - point.x_m, start.y_m + part * dy - point.y_m)

    return min(off_m(*pair) for pair in itertools.pairwise(path))


def errors_m(link: DelayedLink, duration_s: int) -> list[float]:
    """Return the error of the prediction made in each second."""
    found = []
    made: list[PredictedPose] = []
    for second in range(duration_s):
        made.append(predicted(link))
        link.run(1.0)
        if second >= ONE_WAY_S - 1:
            found.append(error_m(link, made.pop(0)))
    return found


def test_an_idle_rover_is_where_it_reported_to_be(tmp_path: Path) -> None:
    with delayed(tmp_path) as link:
        found = predicted(link)
        assert found.as_of_utc_s <= link.utc_s - ONE_WAY_S
        assert found.arrival_utc_s == link.utc_s + ONE_WAY_S
        assert found.pose.point.distance_m(link.pose.point) < 0.01


def test_a_sent_command_moves_the_prediction_before_any_report(tmp_path: Path) -> None:
    with delayed(tmp_path) as link:
        link.send(MoveForward(8.0))
        link.run(3.0)
        found = predicted(link)
        assert link.last is not None
        assert link.last.pose.x_m < 0.01  # not even the command has arrived
        assert 1.0 < found.pose.x_m < 1.5
        assert found.path[0] == link.last.pose.point
        assert found.path[-1] == found.pose.point


def test_errors_of_a_path_and_its_extension_are_within_two_sigma(tmp_path: Path) -> None:
    corner, end = Waypoint(2.0, 0.0), Waypoint(2.0, 3.0)
    with delayed(tmp_path) as link:
        link.send(FollowPath((corner, end)))
        found_m = errors_m(link, 4)
        link.send(FollowPath((Waypoint(4.0, 3.0),)))
        found_m += errors_m(link, 26)
        assert max(found_m) < 0.15
        assert link.pose.point.distance_m(Point(4.0, 3.0)) < 0.2


def test_stuck_wheels_leave_the_rover_on_the_drawn_path(tmp_path: Path) -> None:
    with delayed(tmp_path) as link:
        drive = link.send(MoveForward(8.0))
        link.run(ONE_WAY_S + 3.0)
        link.bench.rover.inject(LeftWheelsStuck())
        made = [predicted(link)]
        first = link.twin._copy
        assert first is not None
        for _ in range(15):
            link.run(1.0)
            made.append(predicted(link))
            if len(made) > ONE_WAY_S:
                assert off_path_m(made.pop(0).path, link.pose.point) < 0.3
        assert link.stages(drive)[-1] is Stage.FAILED
        assert link.twin._copy is not first
        assert not Path(first._folder.name).exists(), "its files are deleted"
        assert made[0].pose.point.distance_m(link.pose.point) < 0.05  # corrected by the report


def test_a_relative_motion_continues_after_a_correction(tmp_path: Path) -> None:
    """The rover begins late: the twin is corrected, and ends where the rover does."""
    with delayed(tmp_path) as link:
        drive = link.send(MoveForward(6.0), late_s=2.0)
        link.run(11.0)
        before = predicted(link).pose.x_m
        link.run(2.0)  # its report has arrived
        assert predicted(link).pose.x_m < before + 0.5
        link.run(30.0)
        assert link.stages(drive)[-1] is Stage.EXECUTED
        assert predicted(link).pose.point.distance_m(link.pose.point) < 0.1


def test_a_lost_command_is_dropped_once_its_report_is_missing(tmp_path: Path) -> None:
    with delayed(tmp_path, loss=1.0) as link:
        link.send(MoveForward(8.0))
        link.run(8.0)
        assert predicted(link).pose.x_m > 3.0
        link.run(5.0)
        assert abs(predicted(link).pose.x_m) < 0.05


def test_a_stop_holds_the_twin_until_the_resume_arrives(tmp_path: Path) -> None:
    with delayed(tmp_path) as link:
        link.send(MoveForward(8.0))
        link.run(4.0)
        link.send(Stop())
        link.run(12.0)
        link.send(MoveForward(2.0))  # refused: it arrives while stopped
        link.run(1.0)
        stopped = predicted(link)
        assert stopped.pose.point.distance_m(link.pose.point) < 0.1
        link.send(Resume())
        link.send(RotateBy(pi / 2), preemption=PreemptionPolicy.APPEND)
        link.run(4.0)
        assert abs(predicted(link).pose.heading_rad - pi / 2) < 0.05
        link.run(12.0)
        assert abs(link.pose.heading_rad - pi / 2) < 0.05


def test_motions_of_another_console_are_not_predicted(tmp_path: Path) -> None:
    with delayed(tmp_path) as link:
        other = Command(Identity("other", 1), MoveForward(2.0), DIRECT_LINK)
        link.bench.submit(other)
        predicted(link)
        link.run(ONE_WAY_S + 3.0)
        assert link.twin.predict(link.utc_s) is None
        link.run(6.0)
        assert predicted(link).pose.point.distance_m(link.pose.point) < 0.05


NOW_S = 1_800_000_000.0


def test_restarts_along_a_long_motion_are_rare(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rover that is always slower than predicted does not use up the processor of the ground."""
    monkeypatch.setattr(twin_module, "RESTART_RATIO", 0.5)
    twin = Twin(SLOW, ONE_WAY_S)
    command = Command(Identity("MOE", 1), MoveForward(8.0), DIRECT_LINK)
    twin.on_pose(ReportedPose(NOW_S - ONE_WAY_S, Pose()))
    twin.on_sent(command, NOW_S - 2 * ONE_WAY_S)
    twin.on_stage(command.identity, Stage.STARTED, NOW_S - ONE_WAY_S)
    found, copies = [], []
    for second in range(1, 13):
        twin.on_pose(ReportedPose(NOW_S - ONE_WAY_S + second, Pose(0.1 * second, 0.0)))
        found.append(twin.predict(NOW_S + second) is not None)
        copies.append(twin._copy)
    twin.close()
    assert 2 <= len({id(each) for each in copies}) <= 5
    assert found.count(False) >= 4, "nothing is predicted while a restart is due"


def test_a_shorter_delay_restarts_a_twin_that_is_too_far_ahead() -> None:
    twin = Twin(SLOW, 300.0)
    twin.on_pose(ReportedPose(NOW_S - 400.0, Pose()))
    twin.predict(NOW_S)
    twin.one_way_s = ONE_WAY_S
    found = twin.predict(NOW_S)
    twin.close()
    assert found is not None
    assert found.arrival_utc_s == NOW_S + ONE_WAY_S


def test_the_path_is_complete_after_a_report_during_a_rest() -> None:
    twin = Twin(SLOW, 300.0)
    twin.on_pose(ReportedPose(NOW_S - 300.0, Pose()))
    twin.predict(NOW_S)
    twin.on_sent(Command(Identity("MOE", 1), MoveForward(8.0), DIRECT_LINK), NOW_S)
    twin.on_pose(ReportedPose(NOW_S - 270.0, Pose()))
    found = twin.predict(NOW_S + 30.0)
    twin.close()
    assert found is not None
    assert found.pose.x_m > 7.9
    assert max(one.distance_m(other) for one, other in itertools.pairwise(found.path)) < 0.2
