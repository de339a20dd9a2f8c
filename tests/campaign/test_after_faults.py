"""A few runs of the campaign `after_faults`: a pose that a fault disproved is not relied on."""

from functools import cache
from pathlib import Path

import pytest

from executive.settings import Sensor
from sim.campaign.model import FaultDraw, Grid, Named
from sim.campaign.reading import load_campaign
from sim.rover.faults import FaultTarget, declared_faults
from sim.scenario.changes import Override
from sim.scenario.model import RunMode
from sim.scenario.outcome import RunMetrics, run_once
from sim.scenario.reading import load_scenario

CAMPAIGNS = ("after_faults", "after_sensor_faults")
NEAR_M, NEAR_RAD = 0.15, 0.1
"""The tolerance of a motion, but for its share of the distance."""


load = cache(load_campaign)


@cache
def alternatives(key: str) -> dict[str, str]:
    """Return names and values of a grid of the campaign."""
    varied = {each.key: each.distribution for each in load(CAMPAIGNS[0]).vary}
    grid = varied[key]
    assert isinstance(grid, Grid)
    named = [each for each in grid.grid if isinstance(each, Named)]
    return {each.name: str(each.value) for each in named}


def play(folder: Path, scene: str, sensors: str, crash: str, fault: str) -> RunMetrics:
    """Play a run as the campaign does, of a fault from 4 s to 5.5 s unless it tells its time."""
    scenario = f"after_fault_{scene}"
    changes = (
        Override("crash", alternatives("crash")[crash]),
        Override("inject", f"{{{fault if ' at: ' in fault else f'{fault}, at: 4, for: 1.5'}}}"),
        Override("settings.sensors", alternatives("settings.sensors")[sensors]),
    )
    loaded = load_scenario(scenario, RunMode.LOCK_STEP, changes)
    return run_once(scenario, loaded, folder).figures


@pytest.mark.parametrize(
    ("scene", "sensors", "crash", "fault"),
    [
        ("moving", "odometry", "resumed", "odometry_jump: {by: 0.5}"),
        ("standing", "fused", "during", "odometry_drift: {rate: 0.3}"),
        ("standing", "wheels", "none", "gyro_bias: {rate: 0.2}"),
        ("moving", "second", "ended", "gyro_dead: {shared: true}"),
        ("standing", "second", "before", "pushed: {by: 0.5}"),
        ("moving", "wheels", "during", "gyro_dead, at: 4.86, for: 2.4"),
    ],
)
def test_a_motion_to_a_pose_that_a_fault_has_disproved_is_not_executed(
    tmp_path: Path, scene: str, sensors: str, crash: str, fault: str
) -> None:
    figures = play(tmp_path, scene, sensors, crash, fault)
    assert figures.false_executed == 0
    assert (figures.pose_error_m or 0) > NEAR_M or (figures.pose_error_rad or 0) > NEAR_RAD
    assert figures.executed_after_fix == 1


def test_a_fault_that_leaves_the_pose_right_leaves_motions_as_they_are(tmp_path: Path) -> None:
    figures = play(tmp_path, "moving", "second", "ended", "left_wheels_stuck")
    assert figures.detection_s is not None
    assert figures.pose_error_m is not None
    assert figures.pose_error_m < NEAR_M
    assert figures.executed_before_fix == figures.executed_after_fix == 1
    assert figures.false_executed == 0


def test_each_fault_is_in_one_of_the_campaigns() -> None:
    drawn = {
        fault.name
        for campaign in map(load, CAMPAIGNS)
        for each in campaign.vary
        if isinstance(each.distribution, Grid)
        for fault in each.distribution.grid
        if isinstance(fault, FaultDraw)
    }
    drawn |= {"none"}
    sensors = "".join(alternatives("settings.sensors").values())
    absent = {FaultTarget.BRICK, *(each for each in Sensor if each.value not in sensors)}
    there = {each.name for each in declared_faults() if each.needs not in absent}
    assert drawn == there | {"none"}
