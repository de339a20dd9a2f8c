"""The thesis's tests (7.1), over real processes: MAL on TCP in, ROS topics out, and back."""

import asyncio
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from sim.scenario.expect_commands import ExpectedLife
from sim.scenario.live import play_in
from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import judge
from sim.scenario.reading import load_scenario
from sim.scenario.scene import scene_of

ROVER = Path(sys.executable).with_name("rover")
LIMIT_S = 240
LATER_S = 6.0
"""By which all may be later on a slow machine."""


def patient(scenario: Scenario) -> Scenario:
    """Return a scenario in which commands may take their time, to which lock step holds them."""
    expected = (
        replace(each, within_s=None) if isinstance(each, ExpectedLife) else each
        for each in scenario.expect
    )
    return replace(scenario, lasts_s=scenario.lasts_s + LATER_S, expect=tuple(expected))


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("name", ["locomotion", "telemetry", "video", "camera", "files"])
@pytest.mark.usefixtures("ros_domain")
def test_hold_over_real_processes(name: str, tmp_path: Path) -> None:
    """One at a time: a rover and its processes take most of a core."""
    scenario = patient(load_scenario(name, RunMode.DIRECT))
    with scene_of(scenario, tmp_path, relay=False) as scene:
        record = asyncio.run(play_in(scene, scenario, RunMode.DIRECT))
    assert [str(found) for found in judge(scenario, record) if not found.holds] == []


FAULTS = """\
title: Faults begin and end while the rover is out
lasts: 9
settings: {faults: {odometry_stale: {beyond: 0.3}}}
world: {walls: [{x: 6, y: 2, to: {x: 6, y: -2}}]}
timeline:
  - {at: 0.5, command: {setTravelSpeed: {speed: 0.3}}}
  - {at: 1, command: {moveForward: {distance: 4}}, label: go}
  - {near: {x: 0.45, y: 0, within: 0.05}, inject: odometry_lost}
  - {after: go ENDED, clear: odometry_lost}
  - {at: 4, inject: link_lost}
  - {at: 4.5, command: {setTravelSpeed: {speed: 0.4}}, label: unheard}
  - {at: 5.5, clear: link_lost}
  - {at: 6.5, command: {setTravelSpeed: {speed: 0.5}}, label: heard}
expect:
  - {command: go, ends: FAILED, reason: ODOMETRY_STALE}
  - {command: unheard, stages: [], answers: [lost]}
  - {command: heard, ends: EXECUTED}
  - {mode: SAFE}
"""


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("live", [False, True])
def test_faults_begin_and_end_live_as_in_lock_step(tmp_path: Path, live: bool) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(FAULTS)
    done = subprocess.run(
        [ROVER, "scenario", path, "--verbose", *(["--live"] if live else [])],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "FAILS" not in done.stdout
