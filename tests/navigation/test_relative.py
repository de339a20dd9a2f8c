"""moveForward and rotateBy by actions of a navigation that lies."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import pi
from pathlib import Path

import pytest

from executive.commands import MoveForward, MoveTo, RotateBy, Waypoint
from executive.settings import NavigationGate, RelativeActions
from executive.values.geometry import STANDING, Point, Pose, Velocity, wrap_rad
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.stress.strange_navigations import StrangeNavigation
from tests.support.navigated import NavigatedBench, settings
from tests.support.navigation import GoalEnd, Navigation, RunningGoal

MAX_OFF_M, MAX_OFF_RAD = 0.13, 0.1
BEHAVIOURS = (
    "honest",
    "never_ends",
    "feedback_lies",
    "drives_away_and_succeeds",
    "succeeds_off_and_turned",
)


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
@pytest.mark.parametrize(
    ("request_", "gate"),
    [(MoveForward(1.0), NavigationGate.LOCK), (RotateBy(-2.0), NavigationGate.RELAY)],
)
def test_a_relative_motion_is_executed_only_where_it_ends(
    request_: MoveForward | RotateBy, behaviour: str, gate: NavigationGate, tmp_path: Path
) -> None:
    own = settings(gate)
    assert own.navigation is not None
    relative = replace(own.navigation, relative=RelativeActions.NAV2)
    chosen = replace(own, navigation=relative)
    with NavigatedBench(tmp_path, gate, StrangeNavigation(behaviour, 3), chosen) as bench:
        bench.run(1.0)
        bench.submit(request_, 1)
        stage, truth = bench.finish(1), bench.rover.truth
        ahead_m, turn_rad = (1.0, 0.0) if isinstance(request_, MoveForward) else (0.0, -2.0)
        if stage is Stage.EXECUTED:
            assert abs(truth.x_m - ahead_m) <= MAX_OFF_M
            assert abs(truth.y_m) <= MAX_OFF_M
            assert abs(wrap_rad(truth.heading_rad - turn_rad)) <= MAX_OFF_RAD
        else:
            assert behaviour not in {"honest", "never_ends"}
            assert bench.last(1).reason is Reason.OFF_TARGET


class Constant(Navigation):
    """Drives at a constant velocity for a time, then succeeds."""

    velocity, duration_s = STANDING, 1.0

    def _do_honest(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        self._feed(goal, now_s, 1.0)
        if now_s - goal.accepted_s < self.duration_s:
            return self._give(self.velocity)
        self._end(GoalEnd.SUCCEEDED)
        return self._give(STANDING)


@contextmanager
def driven(
    folder: Path, velocity: Velocity, duration_s: float, gate: NavigationGate = NavigationGate.LOCK
) -> Iterator[NavigatedBench]:
    """A bench whose navigation acts relatively, at a constant velocity."""
    own, navigation = settings(gate), Constant()
    assert own.navigation is not None
    own = replace(own, navigation=replace(own.navigation, relative=RelativeActions.NAV2))
    navigation.velocity, navigation.duration_s = velocity, duration_s
    with NavigatedBench(folder, gate, navigation, own) as bench:
        yield bench


def test_a_spin_by_further_turns_to_the_same_heading_fails(tmp_path: Path) -> None:
    with driven(tmp_path, Velocity(0.0, 1.2), (1.0 + 2 * pi) / 1.2) as bench:
        bench.submit(RotateBy(1.0), 1)
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.OFF_TARGET
        assert abs(bench.rover.turned_rad) < 1.0 + pi + 0.6


def test_a_turn_that_drives_away_ends_there(tmp_path: Path) -> None:
    with driven(tmp_path, Velocity(0.5, 1.0), 60.0) as bench:
        bench.submit(RotateBy(1.0), 1)
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.OFF_TARGET
        assert bench.rover.moved_m < 0.5


def test_the_deadline_of_a_spin_is_that_of_a_turn(tmp_path: Path) -> None:
    with driven(tmp_path, STANDING, 300.0) as bench:
        bench.submit(RotateBy(1.0), 1)
        assert bench.finish(1, 200.0) is Stage.FAILED
        assert bench.last(1).reason is Reason.TURN_DEADLINE


@pytest.mark.parametrize(("drift_radps", "distance_m"), [(0.01, 1.5), (0.03, 1.5), (-0.01, 5.0)])
def test_a_drive_that_drifted_is_finished_as_it_began(
    drift_radps: float, distance_m: float, tmp_path: Path
) -> None:
    short = (distance_m - 0.02) / 0.4
    with driven(tmp_path, Velocity(0.4, drift_radps), short, NavigationGate.RELAY) as bench:
        bench.submit(MoveForward(distance_m), 1)
        assert bench.finish(1) is Stage.EXECUTED
        truth = bench.rover.truth
        assert truth.point.distance_m(Point(distance_m, 0.0)) <= 0.06
        assert abs(truth.heading_rad) <= MAX_OFF_RAD


def test_the_navigation_drives_a_car_again_where_it_cannot_finish(tmp_path: Path) -> None:
    own = settings(NavigationGate.LOCK)
    drive = replace(own.drive, min_turning_radius_m=0.6)
    car = replace(own, drive=drive, turn_drive=replace(own.turn_drive, control_point_m=0.0))
    with NavigatedBench(tmp_path, NavigationGate.LOCK, Navigation(seed=1), car) as bench:
        bench.rover.spin_centre_m = 0.0
        bench.submit(MoveTo(Waypoint(3.0, -2.0, 1.0)), 1)
        bench.finish(1)
        assert bench.last(1).reason is Reason.OFF_TARGET
        assert len(bench.rover.goals) == 3
