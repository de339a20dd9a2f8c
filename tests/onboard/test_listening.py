"""The executive listens from its first odometry on: no command is refused for discovery."""

import time
from math import inf
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from adapters.mal import MalUri
from adapters.onboard import process, service
from adapters.ros import ros_node, single_threaded
from executive.commands.catalogue import DriveFor
from tests.benchmarks.octets import Octets
from tests.benchmarks.onboard import substitute
from tests.support.processes import LIMIT_S, LISTENS, Running


def serve_patiently() -> None:
    """Start the executive as `rover-executive` does, but wait for odometry without end."""
    vars(service)["ODOMETRY_TIMEOUT_S"] = inf
    process.main()


@pytest.mark.ros
def test_commands_are_served_from_the_first_odometry_on(ros_domain: int, tmp_path: Path) -> None:
    arguments = ("--port", "0", "--data", str(tmp_path / "data"))
    executive = Running(tmp_path / "log", f"{__name__}:serve_patiently", *arguments)
    health: list[DiagnosticArray] = []
    try:
        with ros_node("witness", "jackal") as node, single_threaded(node) as executor:
            node.create_subscription(DiagnosticArray, "/diagnostics", health.append, 1)
            deadline_s = time.monotonic() + LIMIT_S
            while not health:
                executor.spin_once(timeout_sec=0.1)
                assert time.monotonic() < deadline_s, executive.text
        assert "listens" not in executive.text, "it ticks, and has no odometry"
        with substitute(ros_domain):
            uri = MalUri.parse(executive.output(LISTENS))
            with Octets(uri.port) as commands:
                assert commands.request(DriveFor(0.1, 0.0, 1.0))
    finally:
        executive.clean_up()
