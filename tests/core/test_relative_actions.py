"""moveForward and rotateBy by actions of a navigation, judged by odometry as own motions are."""

from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import Motion, MoveForward, MoveTo, RotateBy, Waypoint
from executive.settings import NavigationGate, RelativeActions, Settings
from executive.values.geometry import wrap_rad
from executive.values.ports import DriveBy, NavigateTo, TurnBy
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.support.navigated import NavigatedBench, settings
from tests.support.navigation import Navigation


def relative(gate: NavigationGate, by: RelativeActions = RelativeActions.NAV2) -> Settings:
    asset = settings(gate)
    assert asset.navigation is not None
    return replace(asset, navigation=replace(asset.navigation, relative=by))


@pytest.mark.parametrize("gate", NavigationGate)
@pytest.mark.parametrize(
    "motion", [MoveForward(1.5), MoveForward(-0.5), RotateBy(2.0), RotateBy(-1.0)]
)
def test_an_action_carries_out_a_relative_motion_and_the_rover_finishes_it(
    tmp_path: Path, motion: Motion, gate: NavigationGate
) -> None:
    with NavigatedBench(tmp_path, gate, settings_=relative(gate)) as bench:
        bench.submit(motion, 1)
        assert bench.finish(1) is Stage.EXECUTED, bench.last(1).text
        (goal,) = bench.rover.goals
        if isinstance(motion, MoveForward):
            assert isinstance(goal.task, DriveBy)
            assert goal.task.distance_m == pytest.approx(motion.distance_m)
            assert bench.rover.truth.x_m == pytest.approx(motion.distance_m, abs=0.04)
        else:
            assert isinstance(motion, RotateBy)
            assert isinstance(goal.task, TurnBy)
            assert goal.task.angle_rad == pytest.approx(motion.angle_rad)
            off_rad = wrap_rad(bench.rover.truth.heading_rad - motion.angle_rad)
            assert abs(off_rad) < 0.08
        assert "; the navigation reported success " in bench.last(1).text


@pytest.mark.parametrize("behaviour", ["succeeds_at_once", "aborts", "rejects"])
def test_a_wrong_result_of_an_action_is_no_success(tmp_path: Path, behaviour: str) -> None:
    gate = NavigationGate.RELAY
    with NavigatedBench(tmp_path, gate, Navigation(behaviour), relative(gate)) as bench:
        bench.submit(MoveForward(1.5), 1)
        assert bench.finish(1) is Stage.FAILED
        reasons = {
            "succeeds_at_once": Reason.OFF_TARGET,
            "aborts": Reason.NAVIGATION_FAILED,
            "rejects": Reason.NAVIGATION_REJECTED,
        }
        assert bench.last(1).reason is reasons[behaviour]
        assert bench.rover.moved_m < 0.05


def test_a_lost_request_is_repeated_by_the_rest(tmp_path: Path) -> None:
    gate = NavigationGate.LOCK
    with NavigatedBench(tmp_path, gate, settings_=relative(gate)) as bench:
        bench.rover.lost_requests = 1
        bench.submit(MoveForward(1.0), 1)
        assert bench.finish(1) is Stage.EXECUTED, bench.last(1).text
        assert len(bench.rover.goals) == 2
        assert bench.rover.truth.x_m == pytest.approx(1.0, abs=0.04)


def test_without_actions_the_rover_drives_by_itself(tmp_path: Path) -> None:
    gate = NavigationGate.LOCK
    with NavigatedBench(tmp_path, gate, settings_=settings(gate)) as bench:
        bench.execute(MoveForward(1.0), 1)
        bench.execute(RotateBy(1.0), 2)
        assert not bench.rover.goals
        bench.execute(MoveTo(Waypoint(2.0, 0.0)), 3)
        assert [type(each.task) for each in bench.rover.goals] == [NavigateTo]


@pytest.mark.parametrize("angle_rad", [6.28, -3.5])
def test_more_than_half_a_turn_is_not_left_to_an_action(tmp_path: Path, angle_rad: float) -> None:
    gate = NavigationGate.RELAY
    at_once = Navigation("succeeds_at_once")
    with NavigatedBench(tmp_path, gate, at_once, relative(gate)) as bench:
        bench.execute(RotateBy(angle_rad), 1)
        assert not bench.rover.goals
        assert bench.rover.turned_rad == pytest.approx(abs(angle_rad), abs=0.1)
