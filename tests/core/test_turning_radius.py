"""A base that cannot turn on the spot: it is moved by feasible velocities only, or refuses."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi
from pathlib import Path

import pytest

from executive.commands import (
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    Request,
    RotateBy,
    RotateTo,
    Turn,
    Waypoint,
    curves_of,
)
from executive.obstacles.zones import KeepOut, Zones
from executive.settings import Settings, SettingsError, load_settings, read_yaml
from executive.values.geometry import Point, Pose, Velocity, wrap_rad
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.support.kinematic import Bench, KinematicRover

RADIUS_M = 0.6
JACKAL = load_settings("jackal")
CAR = replace(
    JACKAL,
    drive=replace(JACKAL.drive, min_turning_radius_m=RADIUS_M),
    turn_drive=replace(JACKAL.turn_drive, control_point_m=0.0),
)


class Car(KinematicRover):
    """A base that turns only as it drives; its wheels steer at once.

    Attributes:
        tightest_m: the smallest radius that it was commanded, without limit at rest.
    """

    def __init__(self, pose: Pose | None = None) -> None:
        super().__init__(pose or Pose(), spin_centre_m=0.0)
        self.tightest_m = float("inf")

    def drive(self, velocity: Velocity) -> None:
        if velocity.rotate_radps:
            radius_m = abs(velocity.travel_mps / velocity.rotate_radps)
            self.tightest_m = min(self.tightest_m, radius_m)
        max_radps = abs(velocity.travel_mps) / RADIUS_M
        turned_radps = max(-max_radps, min(max_radps, velocity.rotate_radps))
        super().drive(replace(velocity, rotate_radps=turned_radps))


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with Bench(tmp_path, CAR, rover=Car()) as bench:
        yield bench


@pytest.mark.parametrize(
    "request_",
    [
        MoveTo(Waypoint(1.0, 1.0)),
        MoveTo(Waypoint(1.0, 0.0, pi / 2)),
        FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.5))),
        DriveFor(0.0, 0.5, 1.0),
        DriveFor(0.2, 0.5, 1.0),
    ],
    ids=str,
)
def test_a_motion_with_a_tighter_turn_is_refused_with_a_reason(
    bench: Bench, request_: Request
) -> None:
    refusal = bench.refusal(request_, 1)
    assert refusal.reason is Reason.TURN_TOO_TIGHT
    assert [figure.name for figure in refusal.figures] == ["radius", "bound"]
    assert "0.6 m" in refusal.text


@pytest.mark.parametrize(
    ("request_", "end"),
    [
        (MoveForward(1.0), Pose(1.0)),
        (MoveForward(-1.0), Pose(-1.0)),
        (MoveTo(Waypoint(2.0, 0.03)), Pose(2.0, 0.03)),
        (MoveTo(Waypoint(-2.0, 0.0)), Pose(-2.0)),
        (FollowPath((Waypoint(1.0, 0.0, 0.0), Waypoint(2.0, 0.0))), Pose(2.0)),
        (DriveFor(0.4, 0.5, pi), Pose(0.8, 0.8, heading_rad=pi / 2)),
    ],
    ids=str,
)
def test_what_needs_no_tighter_turn_is_driven(bench: Bench, request_: Request, end: Pose) -> None:
    bench.execute(request_, 1)
    rover = bench.rover
    assert isinstance(rover, Car)
    assert rover.pose.point.distance_m(end.point) < 0.12
    assert rover.pose.heading_rad == pytest.approx(end.heading_rad, abs=0.08)
    assert rover.tightest_m > RADIUS_M - 1e-6


@pytest.mark.parametrize(
    "request_",
    [*map(RotateBy, (0.1, pi / 2, -pi / 2, pi, -1.5 * pi, 2 * pi, 0.0)), RotateTo(-2.5)],
    ids=str,
)
def test_it_turns_by_arcs_and_ends_where_it_began(
    bench: Bench, request_: RotateBy | RotateTo
) -> None:
    bench.execute(request_, 1)
    angle_rad = request_.angle_rad if isinstance(request_, RotateBy) else request_.heading_rad
    rover = bench.rover
    assert isinstance(rover, Car)
    assert rover.pose.point.distance_m(Point(0.0, 0.0)) < 0.06
    assert abs(wrap_rad(rover.pose.heading_rad - angle_rad)) < 0.035
    assert rover.tightest_m > RADIUS_M - 1e-6


@pytest.mark.parametrize("angle_rad", [0.1, pi / 2, -2.0, pi, -1.5 * pi, 2 * pi])
@pytest.mark.parametrize("backward", [False, True])
def test_the_arcs_of_a_turn_lead_back_to_its_start(angle_rad: float, backward: bool) -> None:
    start = Pose(1.0, 2.0, heading_rad=3.0)
    (turn,) = RotateBy(angle_rad).segments(start)
    assert isinstance(turn, Turn)
    curves = curves_of(turn, RADIUS_M, backward)
    assert curves[-1].end.point.distance_m(start.point) < 1e-9
    assert wrap_rad(curves[-1].end.heading_rad - turn.end.heading_rad) == pytest.approx(0.0)
    assert (curves[0].by_m < 0.0) is backward
    assert sum(each.by_rad for each in curves) == pytest.approx(angle_rad)
    assert all(abs(each.by_m) >= RADIUS_M * abs(each.by_rad) - 1e-9 for each in curves)


def wall(x_m: float) -> KeepOut:
    return KeepOut(f"wall {x_m:g}", ((x_m, -3.0), (x_m + 0.2, -3.0), (x_m + 0.2, 3.0), (x_m, 3.0)))


@pytest.mark.parametrize(
    ("walls", "first"),
    [((), 1.0), ((wall(0.6),), -1.0), ((wall(-0.8),), 1.0), ((wall(0.6), wall(-0.8)), None)],
)
def test_it_turns_given_enough_space_and_is_refused_otherwise(
    walls: tuple[KeepOut, ...], first: float | None, tmp_path: Path
) -> None:
    settings = replace(CAR, zones=Zones(keep_out=walls))
    with Bench(tmp_path, settings, rover=Car()) as bench:
        if first is None:
            assert bench.refusal(RotateBy(pi / 2), 1).reason is Reason.PATH_BLOCKED
            return
        bench.execute(RotateBy(pi / 2), 1)
        driven = next(each.travel_mps for each in bench.rover.sent if each.travel_mps)
    assert driven * first > 0.0


def test_what_follows_a_turn_is_checked_and_predicted_from_its_start(bench: Bench) -> None:
    bench.submit(RotateBy(pi / 2), 1)
    bench.run(1.5)
    assert bench.rover.pose.point.distance_m(Point(0.0, 0.0)) > 0.1
    bench.submit(MoveTo(Waypoint(0.0, 2.0)), 2)
    assert bench.finish(2) is Stage.EXECUTED
    predicted = {
        each.name: each.value
        for report in bench.received.reports
        if report.identity == Identity("MOE", 1)
        for each in report.figures
    }
    assert predicted["predicted heading"] == pytest.approx(pi / 2, abs=0.035)
    assert abs(predicted["predicted x"]) + abs(predicted["predicted y"]) < 0.08
    assert predicted["predicted length"] > 0.9


def test_a_refusal_while_another_motion_drives_is_that_of_the_expected_pose(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1)
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 2)
    assert bench.refusal(MoveTo(Waypoint(2.0, 1.0)), 3).reason is Reason.TURN_TOO_TIGHT
    assert bench.finish(2) is Stage.EXECUTED


@pytest.mark.parametrize(
    ("key", "message"),
    [("0.0", "must be above 0"), ("-1", "must be above 0"), ("0.6", "control_point_m 0")],
)
def test_a_radius_that_cannot_be_is_one_clear_error(key: str, message: str, tmp_path: Path) -> None:
    text = Path("config/jackal.yaml").read_text(encoding="utf-8")
    path = tmp_path / "car.yaml"
    limited = f"drive:\n  min_turning_radius_m: {key}\n"
    path.write_text(text.replace("drive:\n", limited, 1), encoding="utf-8")
    with pytest.raises(SettingsError, match=message):
        read_yaml(path, Settings)
