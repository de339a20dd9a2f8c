"""`RosClientLink`: commands of ROS clients on topics and actions, and the reports on them.

Any node of the ROS domain can send them; the core decides by the setting `ros.commands`. A stop is
open to all.
"""

import json
import logging
import time
from collections.abc import Callable, Sequence
from typing import Final

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from adapters.recording import plain_of
from adapters.ros.context import steady_timer
from adapters.ros.conversions import MessageError
from adapters.ros.goal_requests import number_of_pose, pose_request
from adapters.ros.goal_servers import GoalServers
from adapters.ros.node import ExecutiveNode
from adapters.ros.parameters import Topic, declare_optional_text
from adapters.ros.robot_model import latched_qos
from executive.commands import ROS_LINK, ROS_SOURCE, Command, PreemptionPolicy, Stop
from executive.core.recording import ReportSent
from executive.core.ros_clients import OFF
from executive.core.runner import Executive
from executive.settings import RosCommands
from executive.values.parameters import ParameterValue
from executive.values.reasons import Reason
from executive.values.reports import (
    FileEvent,
    Identity,
    PlanUpdate,
    Report,
    ReportKind,
    Severity,
    Stage,
)

NAV2_GOAL_TOPIC: Final = "goal_pose"
"""Topic of goals that Nav2's bt_navigator subscribes to itself."""
REPORT_DEPTH: Final = 100
DEPTH: Final = 10
POLL_S: Final = 0.1
RATE_HZ: Final = 10.0
BURST: Final = 20
"""Commands of ROS clients are refused above this rate, after this number at once."""
MAX_TEXT_LENGTH: Final = 4096
ReadCommandText = Callable[[str, Identity, str], Command]
"""Returns the command of a text with an identity and a link, or raises ValueError."""
_LOG = logging.getLogger(__name__)


class Admission:
    """Limits the rate of commands or events, on one thread."""

    def __init__(self, rate_hz: float, burst: int, clock_s: Callable[[], float] = time.monotonic):
        self._rate_hz, self._burst, self._clock_s = rate_hz, burst, clock_s
        self._left, self._at_s = float(burst), clock_s()

    def admit(self) -> bool:
        """Return whether the limit permits another one now."""
        now_s = self._clock_s()
        self._left += (now_s - self._at_s) * self._rate_hz
        self._left, self._at_s = min(self._left, float(self._burst)), now_s
        permits = self._left >= 1.0
        self._left -= permits
        return permits


class RosClientLink:
    """Serves ROS clients, and publishes every report; implements `executive.values.ports.Downlink`.

    Args:
        node: its ROS parameter `goal_pose.topic` names the topic of goals.
        read_text: reads a text of the topic of commands; None if only a stop is accepted.
    """

    def __init__(self, node: Node, read_text: ReadCommandText | None) -> None:
        self._node, self._read_text = node, read_text
        self._reports = node.create_publisher(String, "~/report", latched_qos(REPORT_DEPTH))
        goals = declare_optional_text(node, "goal_pose.topic", "goals of RViz")
        self._goal_topic = node.resolve_topic_name(goals or "~/goal_pose")
        self._texts, self._goals = Admission(RATE_HZ, BURST), Admission(RATE_HZ, BURST)
        self._flood_events, self._nav2_events = Admission(1.0, 1), Admission(0.1, 1)
        self._servers: GoalServers | None = None

    def serve(self, executive: Executive, served: ExecutiveNode) -> None:
        """Submit commands from now on; texts are read on the thread of the service `~/e_stop`."""
        self._executive, self._frames = executive, served.target_frames
        qos = QoSProfile(depth=DEPTH)  # type: ignore[no-untyped-call]
        commands = Topic("~/command", String, qos)
        served.subscribe_apart(commands, self._on_command, beside_stop=True)
        if executive.settings.ros.commands is RosCommands.OFF:
            return
        served.subscribe(Topic(self._goal_topic, PoseStamped, qos), self._on_goal_pose)
        if self._node.resolve_topic_name(NAV2_GOAL_TOPIC) != self._goal_topic:
            served.subscribe(Topic(NAV2_GOAL_TOPIC, PoseStamped, qos), self._on_nav2_goal)
        self._servers = GoalServers(
            self._node, executive, self._frames, served.contained, self._admit_goal, self.refuse
        )
        steady_timer(self._node, POLL_S, served.contained(self._servers.poll))

    def close(self) -> None:
        """End the action servers."""
        servers, self._servers = self._servers, None
        if servers is not None:
            servers.close()

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Publish reports, and pass them on to the goals of actions."""
        for report in reports:
            self._reports.publish(_message(report))
            if self._servers is not None:
                self._servers.on_report(report)

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Ignored: the parameters have topics of the rover."""

    def send_file_event(self, event: FileEvent) -> None:
        """Ignored: files use the direct link."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Ignored: the commands of a plan have reports."""

    def refuse(self, number: int | None, reason: Reason, text: str) -> None:
        """Publish a refusal that the core does not report, with sequence 0; from any thread."""
        _LOG.warning("%s:%s refused: %s", ROS_SOURCE, number, text)
        identity = None if number is None else Identity(ROS_SOURCE, number)
        kind, severity, stage = ReportKind.COMMAND, Severity.WARNING, Stage.REJECTED
        report = Report(0, time.time(), kind, severity, text, identity, stage, reason=reason)
        self._reports.publish(_message(report))

    def _on_command(self, message: String) -> None:
        """Submit the command of a text, or of JSON with a number and a text."""
        number, text, wrong = None, message.data[:MAX_TEXT_LENGTH], ""
        try:
            number, text = _command_of(message.data)
        except ValueError as error:
            wrong = str(error)
        identity = Identity(ROS_SOURCE, number or fresh_number())
        if _is_stop(text):
            self._submit(Command(identity, Stop(), ROS_LINK))
        elif not self._texts.admit():
            self._refuse_flood()
        elif wrong:
            self.refuse(None, Reason.OUT_OF_RANGE, wrong)
        elif self._read_text is None:
            self.refuse(number, OFF.reason, OFF.text)
        else:
            try:
                self._submit(self._read_text(text, identity, ROS_LINK))
            except ValueError as error:
                self.refuse(number, Reason.OUT_OF_RANGE, f"{text[:80]!r}: {error}")

    def _on_goal_pose(self, goal: PoseStamped) -> None:
        """Submit the motion to a pose; a repeat of a message with a stamp is the same command."""
        if not self._admit_goal():
            return
        stamp = goal.header.stamp
        number = number_of_pose(goal) if stamp.sec or stamp.nanosec else fresh_number()
        try:
            request = pose_request(goal, self._frames)
        except MessageError as error:
            self.refuse(number, Reason.OUT_OF_RANGE, f"{self._goal_topic}: {error}")
            return
        identity, replace = Identity(ROS_SOURCE, number), PreemptionPolicy.REPLACE
        self._submit(Command(identity, request, ROS_LINK, preemption=replace))

    def _on_nav2_goal(self, _: PoseStamped) -> None:
        """Report a goal on Nav2's own topic, which drives past the executive."""
        if self._nav2_events.admit():
            theirs = self._node.resolve_topic_name(NAV2_GOAL_TOPIC)
            self._executive.report_event(
                Severity.WARNING,
                f"a goal was published on {theirs}, the topic of Nav2, and is no command of the"
                f" executive: publish it on {self._goal_topic} (RViz: topic of 2D Goal Pose)",
            )

    def _admit_goal(self) -> bool:
        admits = self._goals.admit()
        if not admits:
            self._refuse_flood()
        return admits

    def _refuse_flood(self) -> None:
        if self._flood_events.admit():
            text = f"ROS clients send more than {RATE_HZ:g} commands a second: some are refused"
            self.refuse(None, Reason.QUEUE_FULL, text)

    def _submit(self, command: Command) -> None:
        self._executive.submit(command, lambda _: None)  # the core reports its refusal


def fresh_number() -> int:
    """Return a new command number, from the time in microseconds."""
    return round(time.time() * 1e6)


def _is_stop(text: str) -> bool:
    """Return whether a text is a stop, in any case, with or without `rover` before it."""
    typed = [each for each in text.lower().split()[:3] if each not in {"rover", "command"}]
    return typed[:1] == ["stop"]


def _command_of(text: str) -> tuple[int | None, str]:
    """Return number and text of a message; raise ValueError if it has none."""
    if len(text) > MAX_TEXT_LENGTH:
        raise ValueError(f"{len(text)} characters: at most {MAX_TEXT_LENGTH}")
    if not text.lstrip().startswith("{"):
        return None, text
    try:
        raw = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not JSON: {error}") from error
    number, command = raw.get("id"), raw.get("command", raw.get("words"))
    form = '{"id": 4242, "command": "moveForward 0.2"}, id from 1 to 2^63 - 1 or left out'
    valid = type(number) is int and 0 < number < 1 << 63
    if not isinstance(command, str) or not (valid or number is None or _is_stop(command)):
        raise ValueError(f"expected {form}")
    return (number if valid else None), command


def _message(report: Report) -> String:
    """Return the JSON text of a report: as recorded, and with the number of its reason."""
    plain, identity = plain_of(ReportSent(report))["report"], report.identity
    plain["source"] = identity and identity.source
    plain["id"] = identity and identity.command_id
    plain["code"] = report.reason and report.reason.value
    return String(data=json.dumps(plain))
