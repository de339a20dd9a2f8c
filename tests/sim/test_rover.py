"""The rover's own behaviour behind the port: base, head, battery."""

from math import nan

import pytest

from executive.geometry import STANDING, Velocity
from executive.ports import CameraIntent, VelocityRover
from executive.state.status import Battery, CameraAngles
from sim.rover.jackal import SimulatedJackal
from sim.rover.world import World
from tests.sim.driving import hold


def test_is_a_rover_of_the_core() -> None:
    rover: VelocityRover = SimulatedJackal(World())
    rover.drive(STANDING)


def test_stops_by_itself_when_commands_cease() -> None:
    rover = SimulatedJackal(World())
    hold(rover, Velocity(0.5, 0), 1.0)
    rover.advance(0.2)
    assert rover.true_velocity.travel_mps == pytest.approx(0.5, abs=0.02)
    rover.advance(0.3)
    assert rover.true_velocity.travel_mps == pytest.approx(0, abs=0.01)


def test_keeps_its_own_limits() -> None:
    rover = SimulatedJackal(World(friction=0.9))
    hold(rover, Velocity(9, 0), 3.0)
    assert rover.true_velocity.travel_mps == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("velocity", [Velocity(nan, 0), Velocity(0, float("inf"))])
def test_refuses_a_velocity_that_is_none(velocity: Velocity) -> None:
    with pytest.raises(ValueError, match="no velocity"):
        SimulatedJackal(World()).drive(velocity)


def angles(rover: SimulatedJackal, duration_s: float) -> list[CameraAngles]:
    return [fact for fact in hold(rover, STANDING, duration_s) if isinstance(fact, CameraAngles)]


def test_camera_turns_with_the_speed_it_is_given() -> None:
    rover = SimulatedJackal(World())
    rover.point_camera(CameraIntent(1.0, -0.5, 0.4))
    seen = angles(rover, 1.5)
    assert len(seen) == 15
    assert seen[11].pan_rad - seen[5].pan_rad == pytest.approx(0.4 * 0.6, abs=0.02)
    assert seen[11].tilt_rad - seen[5].tilt_rad == pytest.approx(-0.4 * 0.6, abs=0.02)
    final = angles(rover, 2.0)[-1]
    assert (final.pan_rad, final.tilt_rad) == pytest.approx((1.0, -0.5), abs=0.01)


def test_camera_turns_no_further_than_its_head_can() -> None:
    rover = SimulatedJackal(World())
    rover.point_camera(CameraIntent(-9, 9, 2.0))
    final = angles(rover, 3.0)[-1]
    assert (final.pan_rad, final.tilt_rad) == pytest.approx((-2.9, 1.2), abs=0.02)


def volts(rover: SimulatedJackal, velocity: Velocity, duration_s: float) -> list[float]:
    return [
        fact.voltage_v for fact in hold(rover, velocity, duration_s) if isinstance(fact, Battery)
    ]


def test_battery_sags_under_load_and_recovers() -> None:
    rover = SimulatedJackal(World())
    rest_v = volts(rover, STANDING, 4.0)
    load_v = volts(rover, Velocity(0.5, 1.5), 4.0)
    assert len(rest_v) == len(load_v) == 4
    assert all(24 < voltage < 29.4 for voltage in rest_v + load_v)
    assert rest_v[-1] - load_v[-1] > 0.1
    hold(rover, STANDING, 2.0)
    assert volts(rover, STANDING, 2.0)[-1] == pytest.approx(rest_v[-1], abs=0.02)


def test_less_charge_gives_less_voltage() -> None:
    full, low = (
        volts(SimulatedJackal(World(charge_ratio=charge)), STANDING, 1.0)[0]
        for charge in (1.0, 0.2)
    )
    assert full == pytest.approx(29.0, abs=0.3)
    assert low == pytest.approx(24.7, abs=0.3)


def test_driving_costs_energy() -> None:
    rovers = [SimulatedJackal(World()) for _ in range(2)]
    hold(rovers[0], STANDING, 5.0)
    hold(rovers[1], Velocity(0.5, 1.0), 5.0)
    assert rovers[0].energy_j == pytest.approx(30 * 5, rel=0.02)
    assert rovers[1].energy_j > 1.5 * rovers[0].energy_j
