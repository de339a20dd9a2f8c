"""Action servers above an executive in simulated time: answers that fail, and lost frames."""

from collections.abc import Callable, Coroutine, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rclpy.action.server import RCLError
from rclpy.node import Node
from rclpy.serialization import serialize_message
from unique_identifier_msgs.msg import UUID

from adapters.ros import ros_node
from adapters.ros.goal_servers import Goal, GoalServers
from executive.settings import RosCommands, RosSettings, load_settings
from executive.values.facts import MapToOdom
from executive.values.geometry import Pose, TargetFrame
from executive.values.reasons import Reason
from tests.support.kinematic import Bench
from tests.support.ros_client import pose_of

pytestmark = pytest.mark.ros

FRAMES = {"odom": TargetFrame.ODOM, "map": TargetFrame.MAP}


class Served(Bench):
    """A bench with the action servers of a node above it; no client is needed."""

    def __init__(self, folder: Path, node: Node) -> None:
        settings = replace(load_settings("jackal"), ros=RosSettings(RosCommands.ALWAYS))
        super().__init__(folder, settings)
        self.refused: list[tuple[int, Reason, str]] = []
        self.raised: list[Exception] = []
        self.sent = 0
        self.servers = GoalServers(
            *(node, self.executive, FRAMES, self.contained, lambda: True),
            lambda *refusal: self.refused.append(refusal),
        )
        self.server = self.servers._servers[0]

    def contained(self, callback: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except RuntimeError as error:
                self.raised.append(error)

        return call

    def request(self, x_m: float, frame: str = "odom", uuid: int = 1) -> None:
        """Let the server take a goal, as an executor does."""
        kind = self.server.action_type
        goal = kind.Goal(pose=pose_of(x_m, 0.0, frame=frame))
        goal_id = UUID(uuid=list(uuid.to_bytes(16, "big")))
        message = kind.Impl.SendGoalService.Request(goal_id=goal_id, goal=goal)
        self.complete(self.server.execute({"goal": (None, message)}))

    def complete(self, coroutine: Coroutine[Any, Any, None]) -> None:
        for _ in range(100):
            try:
                coroutine.send(None)
            except StopIteration:
                return
            self.report()
        raise AssertionError("it never ends")

    def report(self, seconds: float = 0.05) -> None:
        self.run(seconds)
        reports = self.received.reports
        for each in reports[self.sent :]:
            self.servers.on_report(each)
        self.sent = len(reports)


@pytest.fixture
def served(ros_domain: int, nav2_msgs: None, tmp_path: Path) -> Iterator[Served]:
    assert ros_domain > 0
    assert nav2_msgs is None
    with ros_node("executive", "jackal") as node, Served(tmp_path, node) as served:
        yield served
        served.servers.close()


def test_feedback_without_a_map_can_be_published(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(served.server._handle), "send_goal_response", answer)
    served.executive.observe(MapToOdom(Pose()))
    served.request(1.0, "map")
    served.report()
    (goal,) = served.servers._goals.values()
    assert served.servers._feedback(goal, 1.0).distance_remaining == pytest.approx(1.0, abs=0.1)
    served.run(3.0)  # the transform is old
    feedback = served.servers._feedback(goal, 1.0)
    assert repr(feedback.distance_remaining) == "0.0"  # an int ends the process
    serialize_message(feedback)


def answer(*_: object) -> None:
    """Answer no one: there is no client."""


def test_a_goal_ends_if_its_client_closes_before_the_answer(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RCLError("the client closed")

    monkeypatch.setattr(type(served.server._handle), "send_goal_response", fail)
    served.request(0.2)
    served.report()
    (goal,) = served.servers._goals.values()
    assert goal.handle is not None
    assert goal.started_s is not None
    served.report(10.0)
    assert served.servers._goals == {}


def test_an_exception_rejects_a_goal_and_is_contained_in_a_cancel(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("out of memory")

    monkeypatch.setattr(type(served.server._handle), "send_goal_response", answer)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(served.executive, "submit", fail)
        served.request(1.0)
    ((_, reason, text),) = served.refused
    assert (reason, "out of memory" in text) == (Reason.ADAPTER_RAISED, True)
    assert served.servers._goals == {}
    served.request(1.0, uuid=2)
    (goal,) = served.servers._goals.values()
    monkeypatch.setattr(served.executive, "query", fail)
    served.servers._on_cancel(goal.handle)
    assert len(served.raised) == 1


def test_the_end_of_the_process_is_a_result_and_so_is_a_time_allowance(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[Any] = []
    server = served.server
    monkeypatch.setattr(type(server._handle), "send_goal_response", answer)
    monkeypatch.setattr(
        type(server._handle), "send_result_response", lambda _, __, response: sent.append(response)
    )
    cancels: list[object] = []
    query = served.executive.query

    def count(question: Any) -> None:
        cancels.append(question)
        query(question)

    monkeypatch.setattr(served.executive, "query", count)
    monkeypatch.setattr(Goal, "allowance_s", 1e-9)
    for uuid in (1, 2):
        served.request(2.0, uuid=uuid)
        goal_id = UUID(uuid=list(uuid.to_bytes(16, "big")))
        wanted = server.action_type.Impl.GetResultService.Request(goal_id=goal_id)
        served.complete(server._execute_get_result_request((None, wanted)))
        served.report(1.0)
        if uuid == 1:
            served.servers.poll()
            served.servers.poll()
            served.report()
            assert len(cancels) == 1
            assert sent == []  # it is not stationary yet
            served.report(2.0)
            served.servers.poll()
            (response,) = sent
            assert response.result.error_code == 10_000 + Reason.DRIVE_DEADLINE.value
            assert "time_allowance" in response.result.error_msg
            sent.clear()
    served.executive.close()
    for each in served.received.reports[served.sent :]:
        served.servers.on_report(each)
    (response,) = sent
    assert response.result.error_code == 10_000 + Reason.INTERRUPTED.value
