"""The model against what theory says of a skid-steered rover."""

from math import atan, hypot

import pytest

from executive.values.geometry import STANDING, Velocity, wrap_rad
from sim.rover.jackal import TRACK_M, TRACK_MULTIPLIER, WHEEL_RADIUS_M, SimulatedJackal
from sim.rover.world import SoilShape, World
from tests.sim.driving import hold

WHEELBASE_M = 0.262
EQUAL_LOADS = 1 + (WHEELBASE_M / TRACK_M) ** 2
REAL_LOADS = 1.446
"""The same theory (Coulomb friction under four wheels) for a centre of mass 12 mm ahead."""
LATENCY_M = 0.02
"""What a base that acts every 20 ms travels at 1 m/s before it notices."""


@pytest.mark.parametrize("friction", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("rate_radps", [0.5, 1.5])
def test_turns_by_coulomb_friction(friction: float, rate_radps: float) -> None:
    rover = SimulatedJackal(World(friction=friction))
    velocity = Velocity(0, rate_radps / TRACK_MULTIPLIER)
    hold(rover, velocity, 2.0)
    wheels_rad = turned_rad = 0.0
    for _ in range(100):
        heading_rad, before = rover.true_pose.heading_rad, rover.data.qpos[7:11].copy()
        hold(rover, velocity, 0.05)
        turned_rad += wrap_rad(rover.true_pose.heading_rad - heading_rad)
        left, right, rear_left, rear_right = rover.data.qpos[7:11] - before
        wheels_rad += (right + rear_right - left - rear_left) / 2 * WHEEL_RADIUS_M / TRACK_M
    assert wheels_rad / turned_rad == pytest.approx(REAL_LOADS, abs=0.025)
    assert wheels_rad / turned_rad == pytest.approx(EQUAL_LOADS, abs=0.07)


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_climbs_up_to_the_limit_of_friction(friction: float) -> None:
    climbed_m = []
    for part in (0.85, 0.95, 1.0):
        rover = SimulatedJackal(World(friction=friction, slope_rad=part * atan(friction)))
        hold(rover, Velocity(0.5, 0), 4.0)
        climbed_m.append(rover.true_pose.x_m)
    gentle_m, steep_m, limit_m = climbed_m
    assert gentle_m > 1.5
    assert 0.9 < steep_m < gentle_m
    assert limit_m < 0


@pytest.mark.parametrize(("friction", "needed_m"), [(0.3, 0.17), (0.6, 0.13)])
def test_stops_as_far_as_friction_or_its_motors_need(friction: float, needed_m: float) -> None:
    rover = SimulatedJackal(World(friction=friction))
    hold(rover, Velocity(1, 0), 2.0)
    assert rover.true_velocity.travel_mps == pytest.approx(1.0, abs=0.02)
    start_m = rover.true_pose.x_m
    hold(rover, STANDING, 1.5)
    assert rover.true_pose.x_m - start_m == pytest.approx(LATENCY_M + needed_m, abs=0.01)


@pytest.mark.parametrize("height_m", [0.02, 0.08])
def test_is_stationary_on_its_ground(height_m: float) -> None:
    world = World(ground=SoilShape(amplitude_m=height_m, seed=4))
    rover = SimulatedJackal(world)
    hold(rover, STANDING, 1.0)
    pose = rover.true_pose
    assert 0.03 < pose.z_m < height_m + 0.08
    assert hypot(pose.x_m, pose.y_m) < 0.02
    assert abs(rover.true_velocity.travel_mps) < 0.005


def test_repeats_bit_for_bit() -> None:
    def run(by_step: bool) -> tuple[object, ...]:
        rover = SimulatedJackal(World(ground=SoilShape(amplitude_m=0.1, seed=2)), seed=5)
        facts = []
        for tick in range(200):
            rover.drive(Velocity(0.6, 0.5 if tick % 40 < 20 else -0.7))
            if by_step:
                for _ in range(10):
                    rover.advance(0.005)
            else:
                rover.advance(0.05)
            facts += rover.facts()
        return rover.time_s, rover.true_pose, rover.true_velocity, rover.energy_j, facts

    first = run(by_step=False)
    assert first[0] == 10.0
    assert run(by_step=False) == first
    assert run(by_step=True) == first
