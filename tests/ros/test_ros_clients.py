"""ROS clients in another process: texts, goals and actions, once each, canceled, refused."""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import pi
from pathlib import Path
from uuid import uuid4

import pytest
from geometry_msgs.msg import Point

from tests.suite import CHECKOUT
from tests.support.ground import call_ground
from tests.support.processes import LISTENS, Running
from tests.support.ros_client import RosClient, asset, pose_of, ros_client

pytestmark = [pytest.mark.busy, pytest.mark.ros, pytest.mark.slow]

SUCCEEDED, CANCELLED, ABORTED = 4, 5, 6


@contextmanager
def executive(folder: Path, settings: Path) -> Iterator[tuple[Running, str]]:
    """Run the executive on a folder, until it listens."""
    command = ("-m", "adapters.onboard.process", "--port", "0", "--asset", str(settings))
    log = folder / f"executive-{time.monotonic_ns()}.log"
    data = ("--data", str(folder / "data"))
    process = Running(log, sys.executable, *command, *data, cwd=CHECKOUT)
    try:
        yield process, process.output(LISTENS)
    finally:
        process.clean_up()


@pytest.mark.usefixtures("ros_domain", "nav2_msgs")
def test_texts_goals_and_actions_are_executed_and_wrong_ones_answered(tmp_path: Path) -> None:
    with ros_client() as client, executive(tmp_path, asset(tmp_path, "when_free")) as (process, _):
        client.publish_text('{"id": 4242, "command": "moveForward 0.2"}')
        assert client.ended(4242)["stage"] == "EXECUTED"
        for wrong, what in (
            ('{"id": 7, "command": "moveForward"}', "Missing argument"),
            ('{"id": 8, "command": "fly 3"}', "No such command"),
        ):
            client.publish_text(wrong)
            number = 7 if "7" in wrong else 8
            refused = client.ended(number)
            assert refused["stage"] == "REJECTED"
            assert what in refused["text"]
        client.poses.publish(pose_of(0.5, 0.1))
        client.until(lambda: client.rover.pose.y_m > 0.06, "the goal of RViz")
        client.until(lambda: client.reports[-1]["stage"] == "EXECUTED", "its end")

        feedback: list[object] = []
        ahead = client.goal("navigate_to_pose", pose=pose_of(0.8, 0.2, pi / 6))
        handle = client.send("navigate_to_pose", ahead, feedback=feedback.append)
        done = client.result(handle)
        assert (done.status, done.result.error_code) == (SUCCEEDED, 0)
        assert "odometry" in done.result.error_msg
        assert abs(client.rover.pose.x_m - 0.8) < 0.05
        assert 0 < len(feedback) <= 60
        for name, goal in (
            ("navigate_through_poses", {"poses": [pose_of(0.9, 0.25), pose_of(1.0, 0.3, 0.4)]}),
            (
                "follow_waypoints",
                {"poses": [pose_of(9.0, 9.0), pose_of(1.2, 0.4, 0.4)], "goal_index": 1},
            ),
            ("spin", {"target_yaw": 0.5}),
            ("backup", {"target": Point(x=0.2), "speed": 0.1}),
            ("drive_on_heading", {"target": Point(x=0.2), "speed": 0.1}),
        ):
            done = client.run(name, client.goal(name, **goal))
            assert (done.status, done.result.error_code) == (SUCCEEDED, 0), name
        for name, goal in (
            ("navigate_to_pose", {"pose": pose_of(float("nan"), 0.0)}),
            ("navigate_to_pose", {"pose": pose_of(1.0, 0.0, frame="elsewhere")}),
            ("drive_on_heading", {"target": Point(x=0.2), "speed": -0.1}),
        ):
            assert not client.send(name, client.goal(name, **goal)).accepted
        client.publish_text("stop")
        client.until(lambda: "stop" in client.reports[-1]["text"], "a stop")
        far = client.goal("navigate_to_pose", pose=pose_of(3.0, 0.0))
        assert not client.send("navigate_to_pose", far).accepted
        assert process.is_running
        assert "raised" not in process.text


@pytest.mark.usefixtures("ros_domain", "nav2_msgs")
def test_a_cancel_ends_one_command_and_an_authority_is_not_taken(tmp_path: Path) -> None:
    settings = asset(tmp_path, "always", "authority: {needed: true}")
    with ros_client() as client, executive(tmp_path, settings) as (process, uri):
        assert call_ground(uri, lambda moe: moe.authority_of("MOE").request()).holder == "MOE"
        spin = client.goal("spin", target_yaw=0.3)
        assert not client.send("spin", spin).accepted
        client.until(lambda: client.reports[-1]["reason"] == "NO_AUTHORITY", "the refusal")
        assert call_ground(uri, lambda moe: moe.authority.status()).holder == "MOE"
        call_ground(uri, lambda moe: moe.authority_of("MOE").release())
        answered_s: list[float] = []
        for each in range(3):
            far = client.goal("navigate_to_pose", pose=pose_of(5.0 * (-1.0) ** each, 0.0))
            handle = client.send("navigate_to_pose", far)
            client.until(lambda: client.rover.velocity != client.rover.sent[0], "it moves")
            time.sleep(0.4)
            begun_s = time.monotonic()
            future = client.call(handle.cancel_goal_async)
            client.until(future.done, "the answer to a cancel")
            answered_s.append(time.monotonic() - begun_s)
            done = client.result(handle)
            stationary_s = time.monotonic() - begun_s
            assert done.status == CANCELLED
            assert done.result.error_code == 10_000 + 807
            assert client.rover.velocity.travel_mps == 0.0
            print(f"cancelled in {answered_s[-1] * 1e3:.1f} ms, ended in {stationary_s:.2f} s")
        assert sorted(answered_s)[1] <= 0.05
        assert client.run("spin", spin).status == SUCCEEDED  # no stop is latched
        assert call_ground(uri, lambda moe: moe.authority.status()).holder == "ROS"
        far = client.goal("navigate_to_pose", pose=pose_of(5.0, 0.0))
        feedback: list[object] = []
        handle = client.send("navigate_to_pose", far, feedback=feedback.append)
        future = client.call(handle.get_result_async)
        client.until(lambda: len(feedback) > 2, "feedback; the result is requested before it")
        process.end(signal.SIGTERM)
        client.until(future.done, "the result of the last goal")
        done = future.result()
        assert (done.status, done.result.error_code) == (ABORTED, 10_000 + 803)


@pytest.mark.usefixtures("ros_domain", "nav2_msgs")
def test_ten_goals_sent_four_times_each_are_ten_motions_over_a_kill(tmp_path: Path) -> None:
    settings = asset(tmp_path, "when_free")
    uuids, interrupted = [uuid4().bytes for _ in range(10)], uuid4().bytes
    with ros_client() as client:
        with executive(tmp_path, settings) as (process, _):
            for uuid in uuids[:5]:
                send_four_times(client, uuid)
            assert client.send(NAME, client.goal(NAME, **AHEAD), interrupted).accepted
            client.until(lambda: client.rover.velocity.travel_mps > 0.0, "it moves")
            process.end(signal.SIGKILL)
        client.until(lambda: client.rover.velocity.travel_mps == 0.0, "it stands")
        driven_m = client.driven_m
        client.forget()
        with executive(tmp_path, settings):
            for uuid in (*uuids[:5], interrupted):
                again = client.send(NAME, client.goal(NAME, **AHEAD), uuid)
                assert again.accepted
                done = client.result(again)  # the recorded end
                expected = (SUCCEEDED, 0) if uuid != interrupted else (ABORTED, 10_000 + 803)
                assert (done.status, done.result.error_code) == expected
            other = client.goal(NAME, target=Point(x=0.2), speed=0.1)
            assert not client.send(NAME, other, uuids[0]).accepted
            assert client.driven_m == driven_m
            for uuid in uuids[5:]:
                send_four_times(client, uuid)
    executed = {each["id"] for each in client.reports if each["stage"] == "EXECUTED"}
    assert len(executed) == len(uuids)
    assert client.driven_m == pytest.approx(1.0, abs=0.25)


NAME = "drive_on_heading"
AHEAD = {"target": Point(x=0.1), "speed": 0.1}


def send_four_times(client: RosClient, uuid: bytes) -> None:
    """Send a goal four times under one UUID; it is accepted once."""
    goal = client.goal(NAME, **AHEAD)
    handles = [client.send(NAME, goal, uuid) for _ in range(4)]
    assert [each.accepted for each in handles] == [True, False, False, False]
    assert client.result(handles[0]).status == SUCCEEDED
