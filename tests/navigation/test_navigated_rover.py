"""The navigated rover of these tests: what it lets a navigation do, without an executive."""

from math import hypot

import pytest

from executive.settings import NavigationGate
from executive.values.facts import NavigationState, NavigationStatus
from executive.values.geometry import Pose, TargetFrame, Velocity
from executive.values.ports import NavigateTo, NavigationGoal
from executive.values.reports import Identity
from tests.support.kinematic import STEP_S
from tests.support.navigated import BASE_TIMEOUT_S, NavigatedRover, Server
from tests.support.navigation import POSITION_TOLERANCE_M, Navigation

TARGET = Pose(2.0, 1.0)
GOAL = NavigationGoal(1, NavigateTo((TARGET,), TargetFrame.ODOM), Identity("MOE", 1))
BRAKING_S = 0.3


def run(rover: NavigatedRover, duration_s: float, is_open: bool | None = True) -> list[str]:
    """Let time pass with the gate open, shut, or without an executive; return states of goals."""
    states = []
    for _ in range(round(duration_s / STEP_S)):
        if is_open is not None:
            rover.open_gate(is_open)
        rover.advance(STEP_S)
        states += [each.state.name for each in rover.facts if isinstance(each, NavigationStatus)]
        rover.facts.clear()
    return states


def driving(behaviour: str = "honest") -> NavigatedRover:
    rover = NavigatedRover(navigation=Navigation(behaviour))
    rover.navigate(GOAL)
    assert run(rover, 2.0) == [NavigationState.ACCEPTED.name]
    assert rover.moving.travel_mps > 0.3
    return rover


def test_a_navigation_drives_to_its_goal_through_an_open_gate() -> None:
    rover = driving()
    assert run(rover, 10.0) == [NavigationState.SUCCEEDED.name]
    off_m = hypot(rover.truth.x_m - TARGET.x_m, rover.truth.y_m - TARGET.y_m)
    assert off_m <= POSITION_TOLERANCE_M + 0.05


@pytest.mark.parametrize(("is_open", "extra_s"), [(False, 0.0), (None, 0.2)])
def test_a_gate_that_is_shut_or_left_alone_stops_it(is_open: bool | None, extra_s: float) -> None:
    rover = driving()
    run(rover, extra_s + BASE_TIMEOUT_S + BRAKING_S + 2 * STEP_S, is_open)
    assert rover.is_stationary


def test_zero_on_the_own_input_stops_it_sooner() -> None:
    rover = driving()
    rover.open_gate(False)
    rover.drive(Velocity())
    run(rover, BRAKING_S + STEP_S, False)
    assert rover.is_stationary


def test_a_relayed_navigation_moves_nothing_by_itself() -> None:
    rover = NavigatedRover(gate=NavigationGate.RELAY)
    rover.navigate(GOAL)
    run(rover, 2.0)
    assert rover.moved_m == 0.0


def test_a_cancel_ends_the_goal_unless_the_navigation_is_deaf() -> None:
    rover = driving()
    rover.cancel_navigation()
    assert run(rover, 0.5) == [NavigationState.CANCELLED.name]
    rover = driving("deaf_to_cancel")
    rover.cancel_navigation()
    assert run(rover, 0.5) == []


def test_requests_are_lost_by_a_server_that_was_killed_and_wait_while_it_is_frozen() -> None:
    for server, later in ((Server.KILLED, []), (Server.FROZEN, [NavigationState.ACCEPTED.name])):
        rover = NavigatedRover()
        rover.set_server(server)
        rover.navigate(GOAL)
        assert run(rover, 1.0) == []
        rover.set_server(Server.RUNNING)
        assert run(rover, 1.0) == later
    rover.set_server(Server.ABSENT)
    rover.navigate(GOAL)
    assert run(rover, 0.1) == [NavigationState.UNAVAILABLE.name]


def test_a_goal_that_is_accepted_too_late_is_cancelled() -> None:
    rover = NavigatedRover(answer_s=1.5)
    rover.navigate(GOAL)
    run(rover, 1.0)
    rover.cancel_navigation()
    assert run(rover, 4.0) == []
    assert rover.navigation.goal is None
