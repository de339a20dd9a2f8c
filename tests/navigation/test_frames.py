"""Navigated motions to targets in the map, whose transform jumps or is lost."""

from math import hypot
from pathlib import Path
from random import Random

import pytest

from executive.commands import MoveTo, Waypoint
from executive.settings import NavigationGate
from executive.values.geometry import Pose, TargetFrame
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.stress.navigated_drives import MAX_OFF_M, MAX_OFF_RAD
from tests.support.navigated import NavigatedBench

IN_MAP = Pose(2.0, -1.0, heading_rad=0.7)
JUMP_M = 0.3
TARGET = Waypoint(4.0, 1.0, -0.5)


def jumped(pose: Pose, random: Random) -> Pose:
    return Pose(
        pose.x_m + random.choice((JUMP_M, -JUMP_M)),
        pose.y_m + random.uniform(-0.1, 0.1),
        heading_rad=pose.heading_rad + random.uniform(-0.02, 0.02),
    )


def off_in_map(bench: NavigatedBench) -> tuple[float, float]:
    """Return how far the rover is from the target, by ground truth and the present transform."""
    assert bench.rover.map_to_odom is not None
    now = bench.rover.map_to_odom.compose(bench.rover.truth)
    assert TARGET.heading_rad is not None
    return hypot(TARGET.x_m - now.x_m, TARGET.y_m - now.y_m), now.heading_rad - TARGET.heading_rad


def drive(bench: NavigatedBench) -> None:
    bench.rover.map_to_odom = IN_MAP
    bench.run(1.0)
    bench.submit(MoveTo(TARGET, frame=TargetFrame.MAP), 1)


@pytest.mark.parametrize("gate", NavigationGate)
@pytest.mark.parametrize("seed", range(2))
def test_a_jump_at_any_time_is_followed(gate: NavigationGate, seed: int, tmp_path: Path) -> None:
    random = Random(seed)
    with NavigatedBench(tmp_path, gate) as bench:
        drive(bench)
        jump_at = random.randrange(1, 200)
        for tick in range(2000):
            if bench.stages(1)[-1].terminal:
                break
            if tick == jump_at:
                bench.rover.map_to_odom = jumped(IN_MAP, random)
            bench.step()
        assert bench.stages(1)[-1] is Stage.EXECUTED
        off_m, off_rad = off_in_map(bench)
        assert off_m <= MAX_OFF_M
        assert abs(off_rad) <= MAX_OFF_RAD


@pytest.mark.parametrize("gate", NavigationGate)
def test_a_jump_after_the_navigation_has_ended_is_followed(
    gate: NavigationGate, tmp_path: Path
) -> None:
    with NavigatedBench(tmp_path, gate) as bench:
        drive(bench)
        began = False
        for _ in range(2000):
            began = began or bench.rover.navigation.goal is not None
            if began and bench.rover.navigation.goal is None:
                break
            bench.step()
        bench.run(0.4)
        bench.rover.map_to_odom = jumped(IN_MAP, Random(1))
        assert bench.finish(1) is Stage.EXECUTED
        assert off_in_map(bench)[0] <= MAX_OFF_M


@pytest.mark.parametrize("gate", NavigationGate)
def test_a_lost_transform_holds_and_then_fails(gate: NavigationGate, tmp_path: Path) -> None:
    with NavigatedBench(tmp_path, gate) as bench:
        drive(bench)
        bench.run(3.0)
        bench.rover.map_to_odom = None
        bench.run(2.0)
        moved_m = bench.rover.moved_m
        assert bench.finish(1, 10.0) is Stage.FAILED
        assert bench.last(1).reason is Reason.NO_MAP
        bench.run(5.0)
        assert bench.rover.moved_m == moved_m


@pytest.mark.parametrize("gate", NavigationGate)
def test_a_transform_that_returns_continues_the_drive(gate: NavigationGate, tmp_path: Path) -> None:
    with NavigatedBench(tmp_path, gate) as bench:
        drive(bench)
        bench.run(3.0)
        bench.rover.map_to_odom = None
        bench.run(2.5)
        bench.rover.map_to_odom = IN_MAP
        assert bench.finish(1) is Stage.EXECUTED
        assert off_in_map(bench)[0] <= MAX_OFF_M
