"""A small storm over real processes: both sides die, and every message is there once."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROVER = Path(sys.executable).with_name("rover")
LIMIT_S = 240


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
def test_a_small_storm_loses_and_doubles_nothing(tmp_path: Path) -> None:
    figures, kept = tmp_path / "figures.json", tmp_path / "kept"
    kept.mkdir()
    small = ("--messages", "200", "--kills", "2", "--loss", "0.1", "--seed", "3")
    stormed = subprocess.run(
        [ROVER, "bench", "relay", *small, "--keep", kept, "--json", figures],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert stormed.returncode == 0, stormed.stdout + stormed.stderr
    rows = {row["name"]: row["value"] for row in json.loads(figures.read_text())}
    assert (rows["relay: orbiter killed"], rows["relay: rover-relay killed"]) == (1, 1)
    assert rows["relay: datagrams lost"] > 0
    assert {path.name for path in kept.glob("*-1.log")} == {"orbiter-1.log", "relay-1.log"}
