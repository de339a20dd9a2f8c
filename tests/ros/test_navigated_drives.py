"""A rover with a navigation in another process: honest, failing, killed."""

import shutil
import signal
from collections.abc import Iterator
from math import dist
from pathlib import Path

import pytest

from executive.values.reasons import Reason
from tests.support.ground import until_located
from tests.support.navigated_rover import (
    Track,
    end_of,
    move,
    navigated,
    navigation,
    start_move,
)
from tests.support.probe import Probe, probing
from tests.support.processes import executive, simulation

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.usefixtures("nav2_msgs")]


@pytest.fixture
def probe(
    ros_domain: int, patient: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Probe]:
    """Give a probe beside a simulated Jackal with a navigation behind its mux."""
    assert ros_domain > 0
    config = tmp_path / "config"
    shutil.copytree(patient, config)
    navigated(config)
    monkeypatch.setenv("ROVER_CONFIG", str(config))
    with simulation(tmp_path, "--camera", "rays"), probing() as probe:
        yield probe


def test_a_navigation_drives_fails_and_is_killed(probe: Probe, tmp_path: Path) -> None:
    with executive(tmp_path) as (_, uri):
        until_located(uri)
        with navigation(tmp_path / "honest.log", "honest"):
            outcome = move(uri, 1.2, 0.4)
            assert outcome.executed, outcome
            at = probe.fresh_truth().pose.pose.position
            assert dist((at.x, at.y), (1.2, 0.4)) < 0.06
        with navigation(tmp_path / "aborts.log", "aborts"):
            outcome = move(uri, 3.0, 0.4)
            assert outcome.reports[-1].reason is Reason.NAVIGATION_FAILED
            assert "ComputePathToPose NO_VALID_PATH 208" in outcome.reports[-1].text
        with navigation(tmp_path / "killed.log", "honest") as process:
            number = start_move(uri, 4.0, 0.4)
            probe.advanced(0.5)
            track = Track(probe)
            process.end(signal.SIGKILL)
            stationary_s, moved_m = track.stationary()
            assert stationary_s < 1.0
            assert moved_m < 0.6
            last = end_of(uri, number)
            assert last.reason is Reason.NAVIGATION_TIMEOUT
            assert track.moved_m() < 0.01
