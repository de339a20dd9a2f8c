"""A Jackal below rover-sim with a navigation behind its mux, and the processes of all three."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import dist
from pathlib import Path
from typing import Final

from nav_msgs.msg import Odometry

from adapters.mrs.ground import CommandOutcome, MrsClient
from adapters.ros import stamp_s
from executive.commands.catalogue import MoveTo, Waypoint
from executive.settings import Controller, NavigationGate
from executive.values.reports import Report
from tests.support.ground import call_ground
from tests.support.probe import Probe
from tests.support.processes import Running

ODOMETRY: Final = "platform/odom/filtered"
MUX: Final = (
    ("external: {topic: cmd_vel, timeout: 0.5, priority: 1}",
     "external: {topic: cmd_vel, timeout: 0.5, priority: 2}\n"
     "    navigation: {topic: nav_vel, timeout: 0.5, priority: 1}"),
    ("e_stop: {topic: e_stop, timeout: 0.0, priority: 255}",
     "e_stop: {topic: e_stop, timeout: 0.0, priority: 255}\n"
     "    navigation: {topic: navigation_lock, timeout: 0.1, priority: 2}"),
)  # fmt: skip
LOCK: Final = "\nnavigation: {gate: lock, input: navigation, lock: navigation}\n"
MAX_STANDING_MPS, MAX_STANDING_RADPS = 0.03, 0.06
"""True speeds of a rover at standstill."""
LIMIT_S, POLL_S = 90.0, 0.2


def navigated(config: Path, gate: NavigationGate = NavigationGate.LOCK) -> None:
    """Change a copy of the configuration: the Jackal has a navigation behind a gate."""
    path = config / "jackal.yaml"
    text = path.read_text()
    if gate is NavigationGate.RELAY:
        path.write_text(f"{text}\nnavigation: {{gate: relay}}\n")
        return
    for before, after in MUX:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    path.write_text(text + LOCK)


@contextmanager
def navigation(log: Path, behaviour: str, *arguments: str) -> Iterator[Running]:
    """Run a navigation of tests, and wait until it serves."""
    module = ("-m", "tests.support.navigation_server", "--behaviour", behaviour)
    options = ("--stamped", "--odometry", ODOMETRY, *arguments)
    process = Running(log, sys.executable, *module, *options)
    try:
        process.output(f"navigation serves: {behaviour}")
        yield process
    finally:
        process.clean_up()


def start_move(uri: str, x_m: float, y_m: float, heading_rad: float | None = None) -> int:
    """Send moveTo by the navigation, and hang up; return its number."""
    request = MoveTo(Waypoint(x_m, y_m, heading_rad), Controller.NAVIGATION)

    async def submit(client: MrsClient) -> int:
        command = client.command(request)
        await client.submit(command)
        return command.identity.command_id

    return call_ground(uri, submit)


def move(uri: str, x_m: float, y_m: float, heading_rad: float | None = None) -> CommandOutcome:
    """Send moveTo by the navigation; return its outcome."""
    request = MoveTo(Waypoint(x_m, y_m, heading_rad), Controller.NAVIGATION)

    async def run(client: MrsClient) -> CommandOutcome:
        return await client.run(client.command(request))

    return call_ground(uri, run)


def end_of(uri: str, number: int) -> Report:
    """Wait for the last report of a command."""
    deadline_s = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline_s:
        for each in call_ground(uri, lambda client: client.get_notifications()):
            report = each.report
            ended = report.stage is not None and report.stage.terminal
            if ended and report.identity is not None and report.identity.command_id == number:
                return report
        time.sleep(POLL_S)
    raise TimeoutError(f"command {number} does not end")


class Track:
    """The true motion of a rover from a time on, by the stamps of the simulation."""

    def __init__(self, probe: Probe) -> None:
        self._probe = probe
        self._start = probe.fresh_truth()

    def stationary(self) -> tuple[float, float]:
        """Wait for a second of standstill; return its start, s, and the distance until then, m."""
        found: list[Odometry] = []

        def settled() -> bool:
            moving = [index for index, each in enumerate(self._probe.truth) if _moves(each)]
            found[:] = self._probe.truth[moving[-1] + 1 if moving else 0 :]
            return bool(found) and _stamp_s(found[-1]) - _stamp_s(found[0]) > 1.0

        self._probe.until(settled, "it is stationary")
        start, self._start = self._start, found[-1]
        return _stamp_s(found[0]) - _stamp_s(start), _distance_m(start, found[-1])

    def moved_m(self) -> float:
        """Return the distance from the start, or from the standstill."""
        return _distance_m(self._start, self._probe.fresh_truth())


def _moves(truth: Odometry) -> bool:
    twist = truth.twist.twist
    fast = abs(twist.linear.x) > MAX_STANDING_MPS or abs(twist.angular.z) > MAX_STANDING_RADPS
    return bool(fast)


def _stamp_s(truth: Odometry) -> float:
    return stamp_s(truth.header.stamp)


def _distance_m(one: Odometry, other: Odometry) -> float:
    start, end = (each.pose.pose.position for each in (one, other))
    return dist((start.x, start.y), (end.x, end.y))
