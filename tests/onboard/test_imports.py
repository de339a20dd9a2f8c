"""Imports of the executive's process: each package costs memory aboard, and time at a restart."""

import re
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.support.processes import LISTENS, Running

ABSENT: Final = {
    "adapters.bundle": "the bundle agent is in rover-relay",
    "adapters.console": "the ground's",
    "adapters.mops": "of the relay link, which is served with --relay only",
    "adapters.relay": "of the relay link, which is served with --relay only",
    "aiohttp": "the console's",
    "alembic": "the console's",
    "casadi": "of controller mpc only; 40 MB",
    "cryptography": "of the bundle agent's keys",
    "http": "by urllib.request, which nothing aboard uses",
    "jinja2": "of reports on the ground",
    "matplotlib": "of plots on the ground",
    "mujoco": "the simulation's",
    "numpy.fft": "numpy is there for the arrays of ROS messages only",
    "numpy.ma": "numpy is there for the arrays of ROS messages only",
    "numpy.random": "numpy is there for the arrays of ROS messages only",
    "pandas": "of campaigns",
    "prometheus_client": "of --metrics only",
    "PIL": "of cameras with raw images only",
    "py_trees.display": "of drawings, by pydot",
    "pydot": "of drawings",
    "pyparsing": "of pydot",
    "rich": "of terminals",
    "sim": "the simulation's",
    "sqlalchemy": "the console's",
    "urllib.request": "nothing aboard opens a URL",
    "xml.sax": "imports urllib.request",
}
"""Packages that must not be imported, each with its reason."""
IMPORTED: Final = re.compile(r"^import time:.*\| +(\S+)$", re.MULTILINE)


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
def test_packages_without_a_use_aboard_are_absent(tmp_path: Path) -> None:
    line = ("-X", "importtime", "-m", "adapters.onboard.process", "--port", "0")
    process = Running(tmp_path / "log", sys.executable, *line, "--data", str(tmp_path / "data"))
    try:
        process.output(LISTENS)
        assert process.end() == 0, process.text
    finally:
        process.clean_up()
    imported = set(IMPORTED.findall(process.text))
    assert {"rclpy", "executive.core.runner"} <= imported
    found = {name for name in ABSENT if any(f"{each}.".startswith(f"{name}.") for each in imported)}
    assert not found, {name: ABSENT[name] for name in found}
