"""Cargo has weight, and is seen."""

from math import nan, pi, radians

import mujoco
import pytest

from executive.geometry import Velocity
from sim.rover.body import SimulatedBody
from sim.rover.jackal import SimulatedJackal
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import World
from tests.sim.driving import hold

UPHILL = World(slope_rad=radians(8))
AHEAD = Velocity(1.0, 0.0)


def weight_n(rover: SimulatedBody) -> float:
    """Return with what force the ground carries the rover, which must stand."""
    free_joint_n = rover.model.body_subtreemass[rover.model.body("base_link").id]
    lifted_n = rover.data.qfrc_constraint[2]
    assert lifted_n == pytest.approx(9.81 * free_joint_n, rel=0.02)
    return float(lifted_n)


@pytest.mark.parametrize(("kind", "mass_kg"), [(SimulatedJackal, 15.0), (SimulatedMocup, 0.5)])
def test_the_ground_carries_it_until_it_is_taken_off(
    kind: type[SimulatedJackal] | type[SimulatedMocup], mass_kg: float
) -> None:
    rover = kind(World())
    rover.advance(1.0)
    empty_n = weight_n(rover)
    rover.load(mass_kg)
    rover.advance(1.0)
    assert weight_n(rover) - empty_n == pytest.approx(9.81 * mass_kg, rel=0.03)
    rover.load(0.0)
    rover.advance(1.0)
    assert weight_n(rover) == pytest.approx(empty_n, rel=0.01)


def test_it_takes_power_uphill_and_stands_where_it_stood() -> None:
    used_j = []
    for mass_kg in (0.0, 15.0):
        rover = SimulatedJackal(UPHILL)
        rover.advance(0.5)
        before = rover.true_pose
        rover.load(mass_kg)
        assert rover.true_pose == before
        hold(rover, AHEAD, 3.0)
        used_j.append(rover.energy_j)
    assert used_j[1] > 1.3 * used_j[0]


def test_a_camera_that_looks_back_sees_it() -> None:
    rover = SimulatedJackal(World())
    rover.data.joint("camera_pan").qpos[:] = pi
    rover.data.joint("camera_tilt").qpos[:] = -0.6
    mujoco.mj_forward(rover.model, rover.data)
    empty = rover.take_picture().data
    rover.load(10.0)
    laden = rover.take_picture().data
    rover.load(0.0)
    assert laden != empty
    assert rover.take_picture().data == empty


@pytest.mark.parametrize("mass_kg", [-1.0, 51.0, nan])
def test_what_is_no_mass_is_refused(mass_kg: float) -> None:
    rover = SimulatedJackal(World())
    with pytest.raises(ValueError, match="is not in 0 "):
        rover.load(mass_kg)
