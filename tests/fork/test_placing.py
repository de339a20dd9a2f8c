"""`PlacedRover` is where the recorded rover was: to the last bit, or as near as can be known."""

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Final

import pytest
import yaml

from executive.core.recording import FactObserved, Item
from executive.settings import load_settings
from executive.values.facts import Odometry
from executive.values.geometry import STANDING, Pose, Velocity
from sim.fork.model import Placing
from sim.fork.placing import PlacedRover
from sim.fork.seam import RecordedMotion
from sim.rover import World
from sim.rover.simulation import Simulation
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.reading import read_scenario
from tests.fork.following import follow

SCENARIO: Final = """
title: Faults, cargo, a picture, a stop and a crash
duration: 7.2
seed: 5
world:
  ground: {amplitude: 0.2, size: 10.0}
  rocks: [{x: 1.5, y: 0.3, radius: 0.2, height: 0.1}]
settings: {sensors: {second_odometry: {rate_hz: 10}}}
timeline:
  - {at: 0.4, cargo: 4}
  - {at: 1, command: {moveForward: {distance: 3}}, label: ahead}
  - {at: 1.2, command: {setCameraAngles: {pan: 45deg}}, label: camera}
  - {at: 1.4, inject: {odometry_late: {by: 0.1}}}
  - {at: 1.7, clear: odometry_late}
  - {at: 1.9, inject: low_friction}
  - {at: 2.33, command: stop}
  - {at: 2.5, clear: low_friction}
  - {at: 3, command: resume}
  - {at: 3.1, command: {rotateBy: {angle: 60deg}}}
  - {at: 3.6, crash: 0.6}
  - {at: 5, command: takePicture}
  - {at: 5.2, command: {moveForward: {distance: 1}}}
expect:
  - {command: ahead, ends: CANCELLED}
"""


@pytest.fixture(scope="module")
def items(tmp_path_factory: pytest.TempPathFactory) -> list[Item]:
    """Return a recording in memory."""
    found: list[Item] = []
    scenario = read_scenario(yaml.safe_load(SCENARIO), Path("placing.yaml"))
    run_in_lock_step(scenario, tmp_path_factory.mktemp("run"), SimpleNamespace(put=found.append))
    return found


@pytest.mark.parametrize("at_s", [0.35, 1.55, 2.34, 3.9, 6.0])
def test_a_recorded_state_is_continued_bit_for_bit(
    items: list[Item], at_s: float, tmp_path: Path
) -> None:
    found = follow(items, at_s, tmp_path)
    assert found.placing is Placing.STATE
    assert len(found.recorded) > 10
    assert found.simulated == found.recorded


def test_a_rover_put_at_the_true_pose_moves_on_as_recorded(
    items: list[Item], tmp_path: Path
) -> None:
    found = follow(items, 2.2, tmp_path, exact=False)
    assert found.placing is Placing.TRUE_POSE
    off_m = [
        a.point.distance_m(b.point) for a, b in zip(found.recorded, found.simulated, strict=True)
    ]
    assert off_m[0] < 0.002
    assert max(off_m[:20]) < 0.02


def test_a_real_rover_is_put_at_its_odometry(items: list[Item], tmp_path: Path) -> None:
    found = follow(items, 1.8, tmp_path, exact=False, has_truth=False)
    assert found.placing is Placing.ODOMETRY
    moved_m = [
        each[0].point.distance_m(each[19].point) for each in (found.recorded, found.simulated)
    ]
    assert moved_m[1] == pytest.approx(moved_m[0], abs=0.02)


def test_a_push_before_the_fork_is_not_in_its_odometry() -> None:
    motion = RecordedMotion(1.0)
    motion.truths.extend([(1.0, Pose(0.5)), (1.05, Pose(0.52, 0.8))])
    for stamp_s in (1.0, 1.02):
        fact = Odometry(stamp_s, Pose(0.5 * stamp_s), Velocity(0.5, 0.0))
        motion.observe(stamp_s + 0.02, fact, STANDING, True)
    assert [each.pose.y_m for each in motion.measured(1.04, 0.0)] == [0.0]


def test_odometry_of_another_clock_continues_in_stamp_and_pose() -> None:
    rover, ahead_s = PlacedRover(load_settings("jackal"), Simulation(World()), exact=False), 1e6
    recorded = [
        Odometry(10 + 0.02 * k + ahead_s - 0.02, Pose(0.01 * k, 3.0), Velocity(0.5, 0.0))
        for k in range(50)
    ]
    for number, fact in enumerate(recorded):
        rover.drive(Velocity(0.5, 0.0))
        rover.enter(FactObserved(10 + 0.02 * number, 0.0, fact))
    assert rover.start(11.0) is Placing.ODOMETRY
    rover.drive(Velocity(0.5, 0.0))
    rover.advance(0.2)
    found = [each for each in rover.facts() if isinstance(each, Odometry)]
    stamps_s = [each.stamp_s for each in (recorded[-1], *found)]
    steps_s = [b - a for a, b in pairwise(stamps_s)]
    assert min(steps_s) > 0.0
    assert max(steps_s) < 0.061
    expected_m = recorded[-1].pose.x_m + 0.5 * (found[0].stamp_s - stamps_s[0])
    assert found[0].pose.x_m == pytest.approx(expected_m, abs=0.003)
    assert found[-1].pose.y_m == pytest.approx(3.0, abs=0.01)
