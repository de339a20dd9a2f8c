"""The rover's own behaviour behind the port: base, head, battery."""

from math import nan, pi, radians

import mujoco
import pytest

from executive.values.facts import Battery, CameraAngles
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import CameraIntent
from sim.rover.body import SimulatedBody
from sim.rover.jackal import SimulatedJackal
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import World
from tests.sim.driving import hold, jpeg, readings


def test_stops_by_itself_when_commands_cease() -> None:
    rover = SimulatedJackal(World())
    hold(rover, Velocity(0.5, 0), 1.0)
    rover.advance(0.2)
    assert rover.true_velocity.travel_mps == pytest.approx(0.5, abs=0.02)
    rover.advance(0.3)
    assert rover.true_velocity.travel_mps == pytest.approx(0, abs=0.01)


def test_respects_its_own_limits() -> None:
    rover = SimulatedJackal(World(friction=0.9))
    hold(rover, Velocity(9, 0), 3.0)
    assert rover.true_velocity.travel_mps == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("velocity", [Velocity(nan, 0), Velocity(0, float("inf"))])
def test_refuses_a_velocity_that_is_none(velocity: Velocity) -> None:
    with pytest.raises(ValueError, match="no velocity"):
        SimulatedJackal(World()).drive(velocity)


def test_camera_turns_with_the_speed_it_is_given() -> None:
    rover = SimulatedJackal(World())
    rover.point_camera(CameraIntent(1.0, -0.5, 0.4))
    seen = readings(rover, CameraAngles, STANDING, 1.5)
    assert len(seen) == 15
    assert seen[11].pan_rad - seen[5].pan_rad == pytest.approx(0.4 * 0.6, abs=0.02)
    assert seen[11].tilt_rad - seen[5].tilt_rad == pytest.approx(-0.4 * 0.6, abs=0.02)
    final = readings(rover, CameraAngles, STANDING, 2.0)[-1]
    assert (final.pan_rad, final.tilt_rad) == pytest.approx((1.0, -0.5), abs=0.01)


def test_camera_turns_no_further_than_its_head_can() -> None:
    rover = SimulatedJackal(World())
    rover.point_camera(CameraIntent(-9, 9, 2.0))
    final = readings(rover, CameraAngles, STANDING, 3.0)[-1]
    assert (final.pan_rad, final.tilt_rad) == pytest.approx((-2.9, 1.2), abs=0.02)


def volts(rover: SimulatedJackal, velocity: Velocity, duration_s: float) -> list[float]:
    return [battery.voltage_v for battery in readings(rover, Battery, velocity, duration_s)]


def test_battery_sags_under_load_and_recovers() -> None:
    rover = SimulatedJackal(World())
    rest_v = volts(rover, STANDING, 4.0)
    load_v = volts(rover, Velocity(0.5, 1.5), 4.0)
    assert len(rest_v) == len(load_v) == 4
    assert all(24 < voltage < 29.4 for voltage in rest_v + load_v)
    assert rest_v[-1] - load_v[-1] > 0.1
    hold(rover, STANDING, 2.0)
    assert volts(rover, STANDING, 2.0)[-1] == pytest.approx(rest_v[-1], abs=0.02)


UPHILL = World(slope_rad=radians(8))


def weight_n(rover: SimulatedBody) -> float:
    """Return with what force the ground carries the rover, which must stand."""
    free_joint_n = rover.model.body_subtreemass[rover.model.body("base_link").id]
    lifted_n = rover.data.qfrc_constraint[2]
    assert lifted_n == pytest.approx(9.81 * free_joint_n, rel=0.02)
    return float(lifted_n)


@pytest.mark.parametrize(("kind", "mass_kg"), [(SimulatedJackal, 15.0), (SimulatedMocup, 0.5)])
def test_the_ground_carries_it_until_it_is_unloaded(
    kind: type[SimulatedJackal] | type[SimulatedMocup], mass_kg: float
) -> None:
    rover = kind(World())
    rover.advance(1.0)
    empty_n = weight_n(rover)
    rover.set_cargo_mass(mass_kg)
    rover.advance(1.0)
    assert weight_n(rover) - empty_n == pytest.approx(9.81 * mass_kg, rel=0.03)
    rover.set_cargo_mass(0.0)
    rover.advance(1.0)
    assert weight_n(rover) == pytest.approx(empty_n, rel=0.01)


def test_it_takes_power_uphill_and_returns_to_its_position() -> None:
    used_j = []
    for mass_kg in (0.0, 15.0):
        rover = SimulatedJackal(UPHILL)
        rover.advance(0.5)
        before = rover.true_pose
        rover.set_cargo_mass(mass_kg)
        assert rover.true_pose == before
        hold(rover, Velocity(1.0, 0.0), 3.0)
        used_j.append(rover.energy_j)
    assert used_j[1] > 1.3 * used_j[0]


def test_a_camera_pointed_back_sees_it() -> None:
    rover = SimulatedJackal(World())
    rover.data.joint("camera_pan").qpos[:] = pi
    rover.data.joint("camera_tilt").qpos[:] = -0.6
    mujoco.mj_forward(rover.model, rover.data)
    empty = jpeg(rover)
    rover.set_cargo_mass(10.0)
    laden = jpeg(rover)
    rover.set_cargo_mass(0.0)
    assert laden != empty
    assert jpeg(rover) == empty


@pytest.mark.parametrize("mass_kg", [-1.0, 51.0, nan])
def test_an_invalid_mass_is_refused(mass_kg: float) -> None:
    rover = SimulatedJackal(World())
    with pytest.raises(ValueError, match="is not in 0 "):
        rover.set_cargo_mass(mass_kg)
