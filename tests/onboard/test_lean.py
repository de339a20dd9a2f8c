"""What the process aboard must not load: each of these is megabytes, for as long as it runs."""

import os
import subprocess
import sys

LOADED = """
import sys
from adapters.onboard import process
from adapters.onboard.lean import do_without_openssl
do_without_openssl()
import adapters.onboard.service
print(*sorted(name for name, module in sys.modules.items() if module is not None))
"""
TOO_MUCH = {"_ssl", "ssl", "_hashlib", "click", "rich", "PIL", "http", "mujoco", "hypothesis"} | {
    "adapters.mal.consumer",  # for who has a service layer above, or is asked for other rovers
    "adapters.mrs.fleet.fleet_link",
}


def test_the_process_aboard_loads_nothing_that_it_can_do_without() -> None:
    unmeasured = {k: v for k, v in os.environ.items() if not k.startswith("COVERAGE")}
    said = subprocess.run(
        [sys.executable, "-c", LOADED], check=True, capture_output=True, text=True, env=unmeasured
    )
    loaded = set(said.stdout.split())
    assert "rclpy" in loaded
    assert loaded.isdisjoint(TOO_MUCH)
