"""A recording as tables: times, columns, lists, figures that are not finite."""

import json
from contextlib import closing
from math import inf
from pathlib import Path

import pytest

from adapters.recording import RecordingError, RunFile, frames
from adapters.recording.messages import TOPICS
from executive.core.recording import CoreCall, CoreCalled, FactObserved
from executive.values.facts import LaserScan
from tests.stress.recording_mutants import recording_of


def test_each_topic_is_a_table_over_time(stuck: Path) -> None:
    tables = frames(stuck)
    assert set(tables) < set(TOPICS)
    odometry = tables["/in/odometry"]
    assert {"stamp_s", "pose.x_m", "velocity.travel_mps"} < set(odometry.columns)
    assert odometry.index.is_monotonic_increasing
    assert 0.0 <= odometry.index[0] < 0.1
    assert odometry.index[-1] == pytest.approx(8.0, abs=0.1)
    assert odometry["pose.x_m"].iloc[-1] == pytest.approx(1.76, abs=0.1)
    assert {"left_radps.0", "left_radps.1"} < set(tables["/in/joints"].columns)
    reports = tables["/out/report_sent"]
    failed = reports[reports["report.stage"] == "FAILED"]
    assert failed.index.to_list() == [pytest.approx(2.25)]
    assert failed["report.figures"].iloc[0][0]["name"]
    truth = tables["/truth/pose"]
    assert truth["pose.x_m"].iloc[-1] == pytest.approx(odometry["pose.x_m"].iloc[-1], abs=0.2)
    assert truth.index[-1] == pytest.approx(8.0, abs=0.1)


def test_topics_can_be_chosen(stuck: Path) -> None:
    assert set(frames(stuck, {"/out/velocity_commanded"})) == {"/out/velocity_commanded"}


def test_a_non_finite_value_is_a_number(tmp_path: Path) -> None:
    with closing(RunFile(tmp_path / "run.mcap")) as tape:
        tape.put(CoreCalled(1.0, 101.0, CoreCall.START))
        tape.put(FactObserved(2.0, 102.0, LaserScan(1.5, 0.0, 0.1, 0.1, 9.0, (1.0, inf))))
    scans = frames(tmp_path / "run.mcap")["/in/laser_scan"]
    assert scans.index.to_list() == [1.0]
    assert scans[["ranges_m.0", "ranges_m.1"]].to_numpy().tolist() == [[1.0, inf]]


def test_a_file_without_a_run_is_reported(tmp_path: Path) -> None:
    with closing(RunFile(tmp_path / "run.mcap")):
        pass
    with pytest.raises(RecordingError, match="contains no run"):
        frames(tmp_path / "run.mcap")


@pytest.mark.parametrize("utc_s", [10**400, "x", None, [], {}])
def test_an_invalid_time_is_reported(utc_s: object, tmp_path: Path) -> None:
    shapes = [["/in/tick", ["now_s", "utc_s", "call"]]]
    rows = [[0, 1.0, 2.0, "TICK"], [0, 1.5, utc_s, "TICK"]]
    path = tmp_path / "run.mcap"
    path.write_bytes(recording_of([json.dumps({"shapes": shapes, "rows": rows}).encode()]))
    with pytest.raises(RecordingError, match="message of /in/tick cannot be decoded"):
        frames(path)
