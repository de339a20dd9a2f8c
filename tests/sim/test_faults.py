"""Faults do what they say, and end when they are cleared."""

from math import hypot

import pytest

from executive.geometry import STANDING, Velocity
from executive.state.status import Battery, Frame, Odometry
from sim.rover.body import JUMP_M, Fault, Pack
from sim.rover.jackal import SimulatedJackal
from sim.rover.world import World
from tests.sim.driving import hold

AHEAD = Velocity(0.5, 0)


@pytest.fixture
def rover() -> SimulatedJackal:
    rover = SimulatedJackal(World())
    hold(rover, AHEAD, 1.0)
    return rover


def odometry(rover: SimulatedJackal, velocity: Velocity, duration_s: float) -> list[Odometry]:
    return [fact for fact in hold(rover, velocity, duration_s) if isinstance(fact, Odometry)]


def test_lost_odometry_is_silent_until_it_comes_back(rover: SimulatedJackal) -> None:
    rover.inject(Fault.ODOMETRY_LOST)
    assert odometry(rover, AHEAD, 1.0) == []
    rover.clear(Fault.ODOMETRY_LOST)
    told = odometry(rover, AHEAD, 1.0)
    assert len(told) == 50
    assert told[-1].pose.x_m == pytest.approx(rover.true_pose.x_m, abs=0.03)


def test_frozen_odometry_goes_on_telling_the_same(rover: SimulatedJackal) -> None:
    rover.inject(Fault.ODOMETRY_FROZEN)
    told = odometry(rover, AHEAD, 1.0)
    assert len({fact.stamp_s for fact in told}) == 50
    assert len({fact.pose for fact in told}) == 1
    rover.clear(Fault.ODOMETRY_FROZEN)
    assert len({fact.pose for fact in odometry(rover, AHEAD, 1.0)}) == 50


def test_jumping_odometry_stays_where_it_jumped_to(rover: SimulatedJackal) -> None:
    rover.inject(Fault.ODOMETRY_JUMP)
    rover.clear(Fault.ODOMETRY_JUMP)
    told = odometry(rover, STANDING, 1.0)[-1].pose
    true = rover.true_pose
    assert hypot(told.x_m - true.x_m, told.y_m - true.y_m) == pytest.approx(JUMP_M, abs=0.02)


@pytest.mark.parametrize(("fault", "sign"), [(Fault.LEFT_STUCK, 1), (Fault.RIGHT_STUCK, -1)])
def test_a_stuck_side_swings_the_rover_round(
    rover: SimulatedJackal, fault: Fault, sign: int
) -> None:
    rover.inject(fault)
    hold(rover, AHEAD, 2.0)
    assert sign * rover.true_pose.heading_rad > 0.5
    rover.clear(fault)
    heading_rad = rover.true_pose.heading_rad
    hold(rover, AHEAD, 1.0)
    assert rover.true_pose.heading_rad == pytest.approx(heading_rad, abs=0.15)


def test_a_dead_camera_sends_no_picture(rover: SimulatedJackal) -> None:
    rover.inject(Fault.CAMERA_DEAD)
    rover.request_frame()
    assert not any(isinstance(fact, Frame) for fact in hold(rover, STANDING, 0.2))
    rover.clear(Fault.CAMERA_DEAD)
    assert not any(isinstance(fact, Frame) for fact in hold(rover, STANDING, 0.2))
    rover.request_frame()
    assert any(isinstance(fact, Frame) for fact in hold(rover, STANDING, 0.2))


def test_a_low_battery_tells_so(rover: SimulatedJackal) -> None:
    rover.inject(Fault.BATTERY_LOW)
    told = [fact for fact in hold(rover, STANDING, 1.0) if isinstance(fact, Battery)]
    assert [fact.voltage_v for fact in told] == [Pack().fault_v]
