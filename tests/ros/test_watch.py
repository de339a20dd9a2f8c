"""`rover watch` beside a running executive, and beside none."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.processes import executive, run_to_end, running

pytestmark = pytest.mark.ros

ROVER = str(Path(sys.executable).with_name("rover"))


def watch(*arguments: str) -> subprocess.CompletedProcess[str]:
    return run_to_end(ROVER, "watch", *arguments, COLUMNS="100")


@pytest.fixture(scope="module")
def domain(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Give the domain of an executive without a rover."""
    with executive(tmp_path_factory.mktemp("executive")):
        yield module_ros_domain


def test_once_prints_the_tree_and_the_reason_of_standstill(domain: int) -> None:
    done = watch("--once", "--domain-id", str(domain))
    assert done.returncode == 0, done.stderr
    top, tree = done.stdout.split("\n\n")
    head, why, monitoring, *_ = top.splitlines()
    root, *branches = tree.splitlines()
    assert head.split()[:3] == ["jackal", "IDLE", "tick"]
    assert why == "standing: no odometry"
    assert monitoring.startswith("not monitored: slip (no second odometry)")
    assert root.startswith("? rover")
    assert any("priority stop" in branch for branch in branches)


@pytest.mark.usefixtures("domain")
def test_live_ends_with_ctrl_c(tmp_path: Path) -> None:
    with running(tmp_path / "log", "rover", "watch") as process:
        process.output("standing: no odometry")
        assert process.end(signal.SIGINT) == 130
        assert "Traceback" not in process.text


@pytest.mark.usefixtures("domain")
def test_without_an_executive_it_shows_how_to_start_one() -> None:
    done = watch("--once", "--asset", "nobody")
    assert done.returncode == 3
    assert "rover-executive --asset nobody" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_name_that_ros_does_not_take_is_refused() -> None:
    done = watch("--once", "--asset", "no name")
    assert done.returncode == 2
    assert "is not a valid ROS name" in done.stderr
