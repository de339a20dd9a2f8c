"""`PolledAction`: a client of a ROS action; its answers wait until they are polled.

rclpy's `ActionClient` wakes the executor at each feedback message, which Nav2 publishes at 100 Hz,
and hides the goals of other clients. This one uses the services and topics of the action directly
(design.ros2.org, "Actions").
"""

from collections.abc import Callable
from math import inf
from typing import Any, Final
from uuid import uuid4

from action_msgs.msg import GoalStatus
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_action_status_default
from unique_identifier_msgs.msg import UUID

from adapters.ros.parameters import Topic
from adapters.ros.subscription import TopicSubscription, Unwaited

MAX_UNANSWERED: Final = 32
"""Maximum number of requests without an answer; answers to older ones are ignored."""
CANCEL_FOR_S, CANCEL_RETRY_S = 10.0, 1.0
"""Duration and period of a cancel of all goals without an answer; a discovery takes less."""
CANCEL_ANSWER_S: Final = 0.5
"""Maximum wait of a new goal for that answer: the cancel may include it."""
ACTIVE: Final = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)


class PolledAction:
    """A client of one action. All callbacks are called by `poll`.

    Args:
        node: creates the clients and subscriptions.
        kind: class of the action.
        name: name of the action.
        on_status: called with this action and, for the goal of each client by its UUID, status and
            time of acceptance, ns on the clock of the server.
        on_feedback: called with the UUID of a goal and its newest feedback.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        name: str,
        on_status: Callable[["PolledAction", dict[bytes, tuple[int, int]]], None],
        on_feedback: Callable[[bytes, Any], None],
    ) -> None:
        impl, base = kind.Impl, f"{name}/_action"
        self.kind, self.name = kind, node.resolve_topic_name(name)
        self._on_status, self._on_feedback = on_status, on_feedback
        self._cancel_until_s = self._cancelled_s = -inf
        self._send = _PolledClient(node, impl.SendGoalService, f"{base}/send_goal")
        self._result = _PolledClient(node, impl.GetResultService, f"{base}/get_result")
        self._cancel = _PolledClient(node, impl.CancelGoalService, f"{base}/cancel_goal")
        newest = QoSProfile(depth=1)  # type: ignore[no-untyped-call]
        feedback = Topic(f"{base}/feedback", impl.FeedbackMessage, newest)
        status = Topic(f"{base}/status", impl.GoalStatusMessage, qos_profile_action_status_default)
        self._polled = (
            TopicSubscription(node, status, self._take_status, polled=True),
            TopicSubscription(node, feedback, self._take_feedback, polled=True),
        )

    @property
    def ready(self) -> bool:
        """Whether a server is known; still true for up to 20 s after it was killed."""
        return self._send.ready and self._result.ready and self._cancel.ready

    def send(self, goal: Any, on_answer: Callable[[bool], None]) -> bytes:
        """Send a goal under a new UUID, which is returned; the answer is whether it is accepted."""
        uuid = uuid4().bytes
        request = self.kind.Impl.SendGoalService.Request(goal_id=_uuid(uuid), goal=goal)
        self._send.call(request, lambda answer: on_answer(answer.accepted))
        return uuid

    def request_result(self, uuid: bytes, on_result: Callable[[int, Any], None]) -> None:
        """Request status and result of a goal, answered at its end."""
        request = self.kind.Impl.GetResultService.Request(goal_id=_uuid(uuid))
        self._result.call(request, lambda answer: on_result(answer.status, answer.result))

    def cancel(self, uuid: bytes) -> None:
        """Cancel a goal."""
        request = self.kind.Impl.CancelGoalService.Request()
        request.goal_info.goal_id = _uuid(uuid)
        self._cancel.call(request, lambda _: None)

    def cancel_all(self, now_s: float) -> None:
        """Cancel the goals of all clients now; `poll` repeats it until a server answers."""
        self._cancel_until_s, self._cancelled_s = now_s + CANCEL_FOR_S, -inf
        self._send_cancel(now_s)

    def _send_cancel(self, now_s: float) -> None:
        due = self._cancelled_s + CANCEL_RETRY_S <= now_s < self._cancel_until_s
        if due and self.ready:
            self._cancelled_s = now_s
            self._cancel.call(self.kind.Impl.CancelGoalService.Request(), self.end_cancel)

    def end_cancel(self, *_: object) -> None:
        """Repeat no cancel of all goals."""
        self._cancel_until_s = -inf

    def is_cancelling(self, now_s: float) -> bool:
        """Return whether a cancel of all goals may still arrive at the server."""
        return now_s < min(self._cancel_until_s, self._cancelled_s + CANCEL_ANSWER_S)

    def poll(self, now_s: float) -> None:
        """Process answers and statuses: the goals of all clients before the end of a goal."""
        self._send_cancel(now_s)
        self._send.poll()
        for each in self._polled:
            each.poll()
        self._cancel.poll()
        self._result.poll()

    def _take_status(self, message: Any) -> None:
        statuses = {}
        for each in message.status_list:
            stamp = each.goal_info.stamp
            at_ns = stamp.sec * 10**9 + stamp.nanosec
            statuses[bytes(each.goal_info.goal_id.uuid)] = each.status, at_ns
        self._on_status(self, statuses)

    def _take_feedback(self, message: Any) -> None:
        self._on_feedback(bytes(message.goal_id.uuid), message.feedback)


class _PolledClient:
    """A client of a service; its answers wait until `poll`."""

    def __init__(self, node: Node, kind: Any, name: str) -> None:
        self._client = node.create_client(kind, name, callback_group=Unwaited())
        self._response = kind.Response
        self._waiting: dict[int, Callable[[Any], None]] = {}

    @property
    def ready(self) -> bool:
        return self._client.service_is_ready()

    def call(self, request: Any, on_answer: Callable[[Any], None]) -> None:
        with self._client.handle:
            number = self._client.handle.send_request(request)
        self._waiting[number] = on_answer
        if len(self._waiting) > MAX_UNANSWERED:
            del self._waiting[next(iter(self._waiting))]

    def poll(self) -> None:
        while True:
            with self._client.handle:
                header, answer = self._client.handle.take_response(self._response)
            if header is None:
                return
            on_answer = self._waiting.pop(header.request_id.sequence_number, None)
            if on_answer is not None:
                on_answer(answer)


def _uuid(octets: bytes) -> UUID:
    return UUID(uuid=list(octets))
