"""The thesis's tests (7.1), over real processes: MAL on TCP in, ROS topics out, and back."""

import subprocess
import sys
from pathlib import Path

import pytest

ROVER = Path(sys.executable).with_name("rover")
LIMIT_S = 240


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [("locomotion", "video"), ("telemetry", "camera", "files")], ids="-".join
)
@pytest.mark.usefixtures("ros_domain")
def test_hold_over_real_processes(names: tuple[str, ...]) -> None:
    """Scenarios are played at once, to save time."""
    playing = [
        subprocess.Popen(
            [ROVER, "scenario", name, "--live", "--verbose"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for name in names
    ]
    try:
        for scenario in playing:
            output, _ = scenario.communicate(timeout=LIMIT_S)
            assert scenario.returncode == 0, output
            assert "FAILS" not in output
    finally:
        for scenario in playing:
            scenario.kill()
            scenario.communicate()
