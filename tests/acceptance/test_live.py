"""The thesis's tests (7.1), over real processes: MAL on TCP in, ROS topics out, and back."""

import subprocess
import sys
from pathlib import Path

import pytest

ROVER = Path(sys.executable).with_name("rover")
LIMIT_S = 120


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("name", ["telemetry", "locomotion", "camera", "files", "video"])
@pytest.mark.usefixtures("ros_domain")
def test_holds_in_real_time(name: str) -> None:
    played = subprocess.run(
        [ROVER, "scenario", name, "--live", "--verbose"],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert played.returncode == 0, played.stdout + played.stderr
    assert "FAILS" not in played.stdout
    assert "1 × real time" in played.stdout
