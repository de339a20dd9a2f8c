"""The thesis's tests (7.1), over real processes: MAL on TCP in, ROS topics out, and back."""

import asyncio
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from sim.scenario.expect_commands import LifecycleExpectation
from sim.scenario.live import run_in_setup
from sim.scenario.model import QueryParameters, RunMode, Scenario
from sim.scenario.outcome import judge
from sim.scenario.reading import load_scenario
from sim.scenario.record import Scheduled
from sim.scenario.scene import live_scene

ROVER = Path(sys.executable).with_name("rover")
LIMIT_S = 240
LAST_S = 120.0
"""Of a scenario on a machine that has much to do."""
SETTLING_S = 2.0
"""As long as the longest period of telemetry in them: the first value after a time is there."""


def patient(scenario: Scenario) -> Scenario:
    """Return a scenario in which commands may take their time, to which lock step holds them.

    Played briefly, it ends once every while is over in which something is expected.
    """
    expected = tuple(
        _untimed(each) if isinstance(each, LifecycleExpectation) else each
        for each in scenario.expect
    )
    timed = [each for each in expected if isinstance(each, Scheduled) and not each.at_end]
    over = tuple(
        _over(each, f"over-{number}", SETTLING_S + getattr(each, "for_s", 0.0))
        for number, each in enumerate(timed)
    )
    timeline = (*scenario.timeline, *over)
    return replace(scenario, duration_s=LAST_S, timeline=timeline, expect=expected)


def _untimed(expected: LifecycleExpectation) -> LifecycleExpectation:
    """Return an expectation without a time; a stop may report its progress, each second."""
    if expected.command == "stop" and expected.stages is not None:
        return replace(expected, within_s=None, stages=None, ends=expected.stages[-1])
    return replace(expected, within_s=None)


def _over(timed: Scheduled, label: str, later_s: float) -> QueryParameters:
    """Return an entry of a timeline that is so much later than something."""
    if timed.after is None:
        return QueryParameters(query=label, at_s=(timed.at_s or 0.0) + later_s)
    after = replace(timed.after, delay_s=timed.after.delay_s + later_s)
    return QueryParameters(query=label, after=after)


@pytest.mark.busy
@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("name", ["locomotion", "telemetry", "video", "camera", "files"])
@pytest.mark.usefixtures("ros_domain", "warm_children")
def test_hold_over_real_processes(name: str, tmp_path: Path) -> None:
    """One at a time: a rover and its processes take most of a core."""
    scenario = patient(load_scenario(name, RunMode.DIRECT))
    with live_scene(scenario, tmp_path, relay=False) as scene:
        record = asyncio.run(run_in_setup(scene, scenario, RunMode.DIRECT, brief=True))
    assert [str(found) for found in judge(scenario, record) if not found.passed] == []


FAULTS = """\
title: Faults begin and end while the rover is out
duration: 9
settings: {faults: {odometry_stale: {above: 0.3}}}
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


@pytest.mark.busy
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
    assert not re.search(r"^FAILED", done.stdout, re.MULTILINE)
