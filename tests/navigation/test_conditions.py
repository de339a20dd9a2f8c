"""Honest navigations whose messages are lost or late, and executives whose ticks are late."""

from collections.abc import Callable
from itertools import cycle
from pathlib import Path

import pytest

from executive.commands import MoveTo, Waypoint
from executive.settings import NavigationGate
from executive.values.facts import Odometry
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.stress.navigated_drives import DriveResult, Watch, judge_success
from tests.support.kinematic import STEP_S
from tests.support.navigated import NavigatedBench, NavigatedRover, Server
from tests.support.navigation import Navigation

TARGET = Waypoint(1.5, 0.5, 0.4)
ABSENT_S = 3.0


def lost(count: int) -> Callable[[NavigatedRover], None]:
    return lambda rover: setattr(rover, "lost_requests", count)


def answered_after(latency_s: float) -> Callable[[NavigatedRover], None]:
    return lambda rover: setattr(rover, "answer_s", latency_s)


def smoothed(rover: NavigatedRover) -> None:
    rover.smoother = True


def slow_odometry(rover: NavigatedRover) -> None:
    rover.odometry_every = 2


CONDITIONS = [
    lost(1),
    lost(4),
    answered_after(0.9),
    answered_after(1.2),
    answered_after(1.9),
    smoothed,
    slow_odometry,
]


def result_of(bench: NavigatedBench) -> DriveResult:
    result = Watch(bench, 1, (TARGET,)).result()
    assert list(judge_success(result, str(result))) == []
    return result


@pytest.mark.parametrize(
    ("condition", "gate"), list(zip(CONDITIONS, cycle(NavigationGate), strict=False))
)
def test_an_honest_drive_is_no_false_alarm(
    condition: Callable[[NavigatedRover], None], gate: NavigationGate, tmp_path: Path
) -> None:
    with NavigatedBench(tmp_path, gate) as bench:
        bench.run(1.0)
        condition(bench.rover)
        bench.submit(MoveTo(TARGET), 1)
        result = result_of(bench)
        assert result.stage is Stage.EXECUTED, str(result)


@pytest.mark.parametrize("appears", [True, False])
def test_a_server_is_waited_for(appears: bool, tmp_path: Path) -> None:
    with NavigatedBench(tmp_path, NavigationGate.LOCK) as bench:
        bench.rover.set_server(Server.ABSENT)
        bench.run(1.0)
        bench.submit(MoveTo(TARGET), 1)
        bench.run(ABSENT_S)
        if appears:
            bench.rover.set_server(Server.RUNNING)
        result = result_of(bench)
        assert result.reason is (None if appears else Reason.NAVIGATION_UNAVAILABLE)


@pytest.mark.parametrize("gate", NavigationGate)
def test_a_late_tick_stops_the_rover_and_leaves_the_goal(
    gate: NavigationGate, tmp_path: Path
) -> None:
    with NavigatedBench(tmp_path, gate, Navigation("deaf_to_cancel")) as bench:
        bench.run(1.0)
        bench.submit(MoveTo(TARGET), 1)
        bench.run(2.0)
        rover, cancels = bench.rover, bench.rover.cancels
        for _ in range(5):
            bench.clock.advance(STEP_S)
            rover.advance(STEP_S)
            bench.executive.observe(Odometry(bench.clock.now_s(), rover.pose, rover.velocity))
        # Zero was sent after 0.15 s.
        assert abs(rover.moving.travel_mps) < 0.5
        rover.facts.clear()
        assert result_of(bench).stage is Stage.EXECUTED
        assert len(rover.goals) == 1
        assert rover.cancels == cancels + 1  # at the end
