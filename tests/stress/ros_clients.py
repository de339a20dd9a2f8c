"""ROS clients at length: a flood of goals beside an operator's motion, cancels, kills.

ROS_CLIENTS sets how much of it, in percent. Figures are printed: run it with -rP.
"""

import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from statistics import median
from threading import Thread
from typing import Any, Final
from uuid import uuid4

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point
from unique_identifier_msgs.msg import UUID

from adapters.ros.client_link import BURST, RATE_HZ
from executive.commands import FollowPath, Waypoint
from executive.values.geometry import STANDING
from tests.ros.test_ros_clients import ABORTED, AHEAD, CANCELLED, NAME, SUCCEEDED, executive
from tests.support.ground import carry_out
from tests.support.processes import run_to_end
from tests.support.ros_client import RosClient, asset, pose_of, ros_client

pytestmark = pytest.mark.usefixtures("ros_domain", "nav2_msgs")

PERCENT: Final = int(os.environ.get("ROS_CLIENTS", "100"))
FLOOD_HZ: Final = 200.0
FLOOD_S: Final = max(20.0 * PERCENT / 100, 4.0)
CANCELS: Final = max(40 * PERCENT // 100, 5)
KILLS: Final = max(8 * PERCENT // 100, 1)
RECENT: Final = 12
"""Goals that are sent again at once: more would be a flood."""
MAX_LATE_S: Final = 0.5
"""Bound of the watchdog of an asset, above which a tick is reported as late."""


def diagnosed(client: RosClient) -> dict[str, float]:
    """Return a dict that has the maximum of each number of the executive's diagnostics."""
    found: dict[str, float] = {}

    def receive(message: DiagnosticArray) -> None:
        for status in message.status:
            for each in status.values:
                with suppress(ValueError):
                    found[each.key] = max(found.get(each.key, 0.0), float(each.value))

    client.node.create_subscription(DiagnosticArray, "/diagnostics", receive, 10)
    return found


def flood(send: Callable[[], object], duration_s: float) -> int:
    """Call a function 200 times a second; return how often."""
    begun_s, sent = time.monotonic(), 0
    while (now_s := time.monotonic() - begun_s) < duration_s:
        if sent < now_s * FLOOD_HZ:
            send()
            sent += 1
        else:
            time.sleep(0.001)
    return sent


def test_a_flood_is_refused_while_the_motion_of_an_operator_continues(tmp_path: Path) -> None:
    square = tuple(Waypoint(*each) for each in ((2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)))
    legs = round(FLOOD_S / 12.0) + 1
    settings = asset(tmp_path, "when_free")
    with ros_client() as client, executive(tmp_path, settings) as (process, uri):
        ends = diagnosed(client)
        outcomes: list[Any] = []
        path = FollowPath(square * legs)
        operator = Thread(target=lambda: outcomes.extend(carry_out(uri, path)))
        operator.start()
        client.until(lambda: client.rover.velocity.travel_mps, "the operator's motion")
        client.until(lambda: "longest tick period [s]" in ends, "diagnostics")
        time.sleep(3.0)
        before_s, before = ends["longest tick period [s]"], ends["overruns"]
        duration = f"{FLOOD_S:g}"
        flooded = run_to_end(sys.executable, "-m", "tests.stress.ros_clients", duration)
        sent, answered, accepted, texts = map(int, flooded.stdout.split())
        operator.join()
        assert answered > sent / 2  # DDS drops requests of a flood
        assert accepted == 0
        assert outcomes[0].executed, outcomes[0].reports[-1].text
        assert "TICK_LATE" not in process.text
        assert "ticks were late" not in process.text
        late_s, overruns = ends["longest tick period [s]"], ends["overruns"]
        load = os.getloadavg()[0]
        print(
            f"{sent} goals ({answered} answered) and {texts} texts at {FLOOD_HZ:g}/s refused:"
            f" longest tick period {late_s * 1e3:.0f} ms of 50 ms, {overruns:g} overruns,"
            f" load {load:.1f}; before {before_s * 1e3:.0f} ms, {before:g} overruns"
        )
        assert late_s < MAX_LATE_S
        time.sleep(BURST / RATE_HZ)
        assert client.run("spin", client.goal("spin", target_yaw=0.3)).status == SUCCEEDED


def test_cancels_are_answered_and_obeyed(tmp_path: Path) -> None:
    with ros_client() as client, executive(tmp_path, asset(tmp_path, "always")):
        answered_s, stationary_s = list[float](), list[float]()
        for each in range(CANCELS):
            far = client.goal("navigate_to_pose", pose=pose_of(5.0 * (-1.0) ** each, each % 3))
            handle = client.send("navigate_to_pose", far)
            time.sleep(0.2 + each % 7 / 10)
            begun_s = time.monotonic()
            future = client.call(handle.cancel_goal_async)
            client.until(future.done, "the answer to a cancel")
            answered_s.append(time.monotonic() - begun_s)
            client.until(lambda: client.rover.velocity == STANDING, "standstill")
            stationary_s.append(time.monotonic() - begun_s)
            assert client.result(handle).status == CANCELLED
        print(
            f"{CANCELS} cancels: answered after {median(answered_s) * 1e3:.1f} ms in the median,"
            f" {max(answered_s) * 1e3:.1f} ms at most; stationary after"
            f" {median(stationary_s):.2f} s, {max(stationary_s):.2f} s at most"
        )
        assert median(answered_s) <= 0.05
        assert max(stationary_s) <= 0.5 + 0.5  # braking from 1 m/s by 2 m/s^2


def test_no_goal_is_executed_twice_over_kills(tmp_path: Path) -> None:
    settings = asset(tmp_path, "when_free")
    known = dict[bytes, tuple[int, int]]()
    with ros_client() as client:
        for kill in range(KILLS):
            client.forget()
            with executive(tmp_path, settings) as (process, _):
                driven_m = client.driven_m
                for uuid, end in tuple(known.items())[-RECENT:]:
                    handle = client.send(NAME, client.goal(NAME, **AHEAD), uuid)
                    assert handle.accepted
                    done = client.result(handle)
                    assert (done.status, done.result.error_code) == end
                assert client.driven_m == driven_m
                for _ in range(3):
                    uuid = uuid4().bytes
                    handle = client.send(NAME, client.goal(NAME, **AHEAD), uuid)
                    assert client.result(handle).status == SUCCEEDED
                    known[uuid] = SUCCEEDED, 0
                uuid = uuid4().bytes
                goal = client.goal(NAME, target=Point(x=AHEAD["target"].x), speed=0.1)
                assert client.send(NAME, goal, uuid).accepted
                time.sleep(0.02 * kill)
                process.end(signal.SIGKILL)
                known[uuid] = ABORTED, 10_803
            client.until(lambda: client.rover.velocity.travel_mps == 0.0, "standstill")
        print(f"{len(known)} goals over {KILLS} kills, {client.driven_m:.2f} m")


def main() -> None:
    """Flood an executive, and print how many goals were sent, answered, accepted, then texts."""
    with ros_client(drives=False) as client:
        action, futures = client.action("navigate_to_pose"), list[Any]()
        goal = client.goal("navigate_to_pose", pose=pose_of(1.0, 1.0))

        def send() -> None:
            uuid = UUID(uuid=list(uuid4().bytes))
            futures.append(action.send_goal_async(goal, goal_uuid=uuid))

        sent = flood(send, float(sys.argv[1]))
        with suppress(AssertionError):
            client.until(lambda: all(each.done() for each in futures), "answers", 3.0)
        answers = [each.result() for each in futures if each.done()]
        texts = flood(lambda: client.publish_text("moveForward 0.1"), float(sys.argv[1]) / 4)
        print(sent, len(answers), sum(each.accepted for each in answers), texts)


if __name__ == "__main__":
    main()
