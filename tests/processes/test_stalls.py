"""What fails while the machine stands still is played once more; what just fails is not."""

import sys
from pathlib import Path

import pytest

from tests.support.patience import CONFIG
from tests.support.processes import run_to_end
from tests.support.stalls import STALL_S

HOOK = """
from tests.support import stalls
from tests.support.stalls import pytest_runtest_protocol as pytest_runtest_protocol

stalls.STALL_S = {bound_s}
"""
TEST = """
import os, subprocess
import pytest

played = []

@pytest.fixture
def again():
    played.append("set up")

@pytest.mark.ros
def test_that_fails_the_first_time(again):
    stop = f"kill -STOP {os.getpid()}; sleep 0.6; kill -CONT {os.getpid()}"
    subprocess.run(stop, shell=True)
    played.append("called")
    assert len(played) == 4
"""


@pytest.mark.parametrize(
    ("bound_s", "status", "text"), [(1000.0, 1, "1 failed"), (STALL_S, 0, "1 passed")]
)
def test_only_a_stall_excuses_a_failure(
    tmp_path: Path, bound_s: float, status: int, text: str
) -> None:
    (tmp_path / "conftest.py").write_text(HOOK.format(bound_s=bound_s))
    (tmp_path / "test_it.py").write_text(TEST)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = ros\n")
    command = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q")
    done = run_to_end(*command, cwd=tmp_path, PYTHONPATH=str(CONFIG.parent))
    assert done.returncode == status, done.stdout + done.stderr
    assert text in done.stdout
