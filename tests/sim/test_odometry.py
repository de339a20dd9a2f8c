"""Odometry drifts as a good skid-steered rover's does, and no more."""

from collections.abc import Callable
from math import hypot, pi
from statistics import median

import pytest
from numpy.random import default_rng

from executive.values.facts import Odometry
from executive.values.geometry import Pose, Velocity, wrap_rad
from sim.rover.jackal import SimulatedJackal, SimulatedOdometry, WheelOdometry
from sim.rover.world import SoilShape, World
from tests.sim.driving import readings, travel, turn

FLAT = World()
ROUGH = World(ground=SoilShape(amplitude_m=0.08, feature_m=4.0, seed=7))
UNAWARE = SimulatedOdometry(slip_offset_m=0, slip_gain=0)


def straight(rover: SimulatedJackal) -> None:
    travel(rover, 3.0, 0.5)


def far(rover: SimulatedJackal) -> None:
    travel(rover, 8.0)


def square(rover: SimulatedJackal) -> None:
    for _ in range(4):
        travel(rover, 2.0)
        turn(rover, pi / 2)


def round_and_round(rover: SimulatedJackal) -> None:
    turn(rover, 8 * pi)


def turn_drive_turn(rover: SimulatedJackal) -> None:
    turn(rover, 1.2)
    travel(rover, 3.0)
    turn(rover, -2.0)


def drift(
    world: World, run: Callable[[SimulatedJackal], None], settings: SimulatedOdometry | None = None
) -> tuple[float, float]:
    """Return the median errors of place (m) and heading (rad) over five sets of sensors."""
    positions_m, headings_rad = [], []
    for seed in range(5):
        rover = SimulatedJackal(world, seed, odometry=settings)
        run(rover)
        true, readings = rover.true_pose, rover.odometry.pose
        positions_m.append(hypot(true.x_m - readings.x_m, true.y_m - readings.y_m))
        headings_rad.append(abs(wrap_rad(true.heading_rad - readings.heading_rad)))
    return median(positions_m), median(headings_rad)


@pytest.mark.parametrize(
    ("world", "run", "distance_m", "heading_rad"),
    [
        (FLAT, straight, 0.008, 0.005),
        (FLAT, square, 0.035, 0.012),
        (FLAT, round_and_round, 0.02, 0.02),
        (FLAT, turn_drive_turn, 0.01, 0.005),
        (ROUGH, far, 0.05, 0.007),
        (ROUGH, square, 0.11, 0.012),
        (ROUGH, round_and_round, 0.2, 0.02),
    ],
)
def test_drifts_within_bounds(
    world: World, run: Callable[[SimulatedJackal], None], distance_m: float, heading_rad: float
) -> None:
    drifted_m, drifted_rad = drift(world, run)
    assert 0 < drifted_m < distance_m
    assert 0 < drifted_rad < heading_rad


def test_a_turn_carries_odometry_away_that_knows_no_side_slip() -> None:
    aware_m, _ = drift(FLAT, turn_drive_turn)
    unaware_m, _ = drift(FLAT, turn_drive_turn, UNAWARE)
    assert unaware_m > 3 * aware_m


def test_is_published_at_fifty_hertz_one_period_late() -> None:
    rover = SimulatedJackal(FLAT)
    stamps_s = []
    for _ in range(200):
        rover.drive(Velocity(0.5, 0.2))
        rover.advance(0.005)
        for fact in rover.facts():
            if isinstance(fact, Odometry):
                stamps_s.append(fact.stamp_s)
                assert rover.time_s - fact.stamp_s == pytest.approx(0.02)
    assert stamps_s == pytest.approx([0.02 * n for n in range(1, 50)])


def test_reports_speed_and_lean() -> None:
    rover = SimulatedJackal(World(slope_rad=0.1))
    received = readings(rover, Odometry, Velocity(0.5, 0), 2.0)
    assert received[-1].velocity.travel_mps == pytest.approx(0.5, abs=0.05)
    assert received[-1].pose.pitch_rad == pytest.approx(-0.1, abs=0.02)
    assert received[-1].pose.z_m - received[0].pose.z_m == pytest.approx(0.09, abs=0.02)
    assert received[-1].pose.x_m == pytest.approx(rover.true_pose.x_m, abs=0.04)


def test_the_heading_of_a_standing_rover_does_not_creep() -> None:
    rover = SimulatedJackal(FLAT, seed=0)  # its gyro's constant error is 0.33° a minute
    rover.advance(1.0)
    began_rad = rover.odometry.pose.heading_rad
    rover.advance(60.0)
    assert rover.odometry.pose.heading_rad == began_rad


@pytest.mark.parametrize(
    ("wheel_mps", "gyro_radps"),
    [(0.0, 0.05), (0.01, 0.004)],
    ids=["pushed round on standing wheels", "turned slowly by its wheels"],
)
def test_a_turn_is_no_standstill(wheel_mps: float, gyro_radps: float) -> None:
    odometry = WheelOdometry(SimulatedOdometry(), Pose(), default_rng(0))
    for period in range(500):
        wheels_mps = (-wheel_mps, wheel_mps, -wheel_mps, wheel_mps)
        odometry.advance(0.02 * period, 0.02, wheels_mps, gyro_radps, Pose())
    assert odometry.pose.heading_rad == pytest.approx(500 * 0.02 * gyro_radps, abs=0.003)
