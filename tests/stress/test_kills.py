"""Real processes are killed by -9, each once at least, and the client knows the truth."""

import subprocess
import sys
from pathlib import Path

import pytest

ROVER = Path(sys.executable).with_name("rover")
LIMIT_S = 240


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
def test_a_client_knows_what_the_ledger_says_whatever_was_killed(tmp_path: Path) -> None:
    killed = subprocess.run(
        [ROVER, "bench", "kills", "--kills", "3", "--seed", "5", "--keep", tmp_path],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert killed.returncode == 0, killed.stdout + killed.stderr
    logs = {path.name for path in tmp_path.glob("*-2.log")}
    assert logs == {"broker-2.log", "client-2.log", "executive-2.log"}
