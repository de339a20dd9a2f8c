"""`RosClientLink`: commands of ROS clients on topics and actions, and the reports on them.

Any node of the ROS domain can send them; the core decides by the setting `ros.commands`. A stop is
open to all: it is submitted before the rest of its message is read.
"""

import json
import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from adapters.ros.context import steady_timer
from adapters.ros.conversions import MessageError
from adapters.ros.goal_requests import number_of_pose, pose_request
from adapters.ros.goal_servers import GoalServers
from adapters.ros.node import ExecutiveNode
from adapters.ros.parameters import Topic, declare_optional_text
from adapters.ros.robot_model import latched_qos
from executive.commands import ROS_LINK, ROS_SOURCE, Command, PreemptionPolicy, Stop
from executive.commands.lifecycle import Rejected, SubmitResult
from executive.core.ros_clients import OFF
from executive.core.runner import Executive
from executive.settings import RosCommands, Settings
from executive.values.parameters import ParameterValue
from executive.values.reasons import Reason, Refusal
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, Severity, Stage

COMMAND_TOPIC: Final = "~/command"
REPORT_TOPIC: Final = "~/report"
GOAL_TOPIC: Final = "~/goal_pose"
NAV2_GOAL_TOPIC: Final = "goal_pose"
"""Topic of goals that Nav2's bt_navigator subscribes to itself."""
REPORT_DEPTH: Final = 100
DEPTH: Final = 10
POLL_S: Final = 0.1
NAV2_GOAL_EVENT_S: Final = 10.0
"""Minimum time between two events on goals of Nav2's own topic."""
RATE_HZ: Final = 10.0
BURST: Final = 20
"""Commands of ROS clients are refused above this rate, after this number at once."""
MAX_TEXT_LENGTH: Final = 4096
STOP: Final = "stop"
TEXT_KEY: Final = "words"
UNREPORTED: Final = frozenset({Reason.DUPLICATE, Reason.BAD_IDENTIFIER, Reason.LEDGER_FAILED})
"""Refusals without a report of the core: the number is that of another command, or is lost."""
ReadCommandText = Callable[[str, Identity, str], Command]
"""Returns the command of a text with an identity and a link, or raises ValueError."""
_LOG = logging.getLogger(__name__)


class Admission:
    """Limits a rate of commands; for one thread."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._left, self._at_s = float(BURST), clock_s()
        self._refused, self._reported_s = 0, -1.0

    def admit(self) -> bool:
        """Return whether a command that arrives now may be submitted."""
        now_s = self._clock_s()
        self._left = min(float(BURST), self._left + (now_s - self._at_s) * RATE_HZ)
        self._at_s = now_s
        if self._left >= 1.0:
            self._left -= 1.0
            return True
        self._refused += 1
        return False

    def take_refusal(self) -> Refusal | None:
        """Return the refusal of the commands that were not admitted, at most once a second."""
        if not self._refused or self._at_s - self._reported_s < 1.0:
            return None
        refused, self._refused, self._reported_s = self._refused, 0, self._at_s
        text = f"{refused} commands of ROS clients refused: more than {RATE_HZ:g} a second"
        return Refusal(Reason.QUEUE_FULL, text)


class RosClientLink:
    """Serves ROS clients, and publishes every report; implements `executive.values.ports.Downlink`.

    Args:
        node: its ROS parameter `goal_pose.topic` names the topic of goals.
        read_text: reads a text of the topic of commands; None if only a stop is accepted.
    """

    def __init__(self, node: Node, settings: Settings, read_text: ReadCommandText | None) -> None:
        self._node, self._settings, self._read_text = node, settings, read_text
        self._reports = node.create_publisher(String, REPORT_TOPIC, latched_qos(REPORT_DEPTH))
        goals = declare_optional_text(node, "goal_pose.topic", "goals of RViz")
        self._goal_topic = goals or GOAL_TOPIC
        self._goal_admission, self._text_admission = Admission(), Admission()
        self._executive: Executive | None = None
        self._servers: GoalServers | None = None
        self._frames: Any = {}
        self._last_goal: tuple[int, Identity] | None = None
        self._nav2_goal_s = -NAV2_GOAL_EVENT_S

    def serve(self, executive: Executive, served: ExecutiveNode) -> None:
        """Submit commands from now on; texts are read on the thread of the service `~/e_stop`."""
        self._executive, self._frames = executive, served.target_frames
        qos = QoSProfile(depth=DEPTH)  # type: ignore[no-untyped-call]
        commands = Topic(COMMAND_TOPIC, String, qos)
        served.subscribe_apart(commands, self._on_command, beside_stop=True)
        if self._settings.ros.commands is RosCommands.OFF:
            return
        served.subscribe(Topic(self._goal_topic, PoseStamped, qos), self._on_goal_pose)
        names = (self._node.resolve_topic_name(e) for e in (self._goal_topic, NAV2_GOAL_TOPIC))
        if len({*names}) > 1:
            served.subscribe(Topic(NAV2_GOAL_TOPIC, PoseStamped, qos), self._on_nav2_goal)
        admit, contained = self._goal_admission.admit, served.contained
        self._servers = GoalServers(
            self._node, executive, self._frames, contained, admit, self.refuse
        )
        steady_timer(self._node, POLL_S, served.contained(self._poll))

    def close(self) -> None:
        """End the action servers."""
        servers, self._servers = self._servers, None
        if servers is not None:
            servers.close()

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Publish reports, and pass them on to the goals of actions."""
        for report in reports:
            self._reports.publish(String(data=json.dumps(_plain(report))))
            last, stage = self._last_goal, report.stage
            if last is not None and report.identity == last[1] and stage and stage.terminal:
                self._last_goal = None
            if self._servers is not None:
                self._servers.on_report(report)

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Ignored: the parameters have topics of the rover."""

    def send_file_event(self, event: FileEvent) -> None:
        """Ignored: files use the direct link."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Ignored: the commands of a plan have reports."""

    def refuse(self, number: int | None, refusal: Refusal) -> None:
        """Publish the refusal of a command that the core did not report; from any thread."""
        _LOG.warning("%s:%s refused: %s", ROS_SOURCE, number, refusal.text)
        figures = [_figure(each.name, each.value, each.unit) for each in refusal.figures]
        self._reports.publish(
            String(
                data=json.dumps(
                    {
                        "sequence": None,
                        "utc_s": round(time.time(), 3),
                        "source": ROS_SOURCE,
                        "id": number,
                        "stage": Stage.REJECTED.name,
                        "reason": refusal.reason.name,
                        "code": refusal.reason.value,
                        "text": refusal.text,
                        "figures": figures,
                    }
                )
            )
        )

    def _on_command(self, message: String) -> None:
        """Submit the command of a text, or of JSON with a number and a text."""
        number, text, wrong = None, "", ""
        try:
            number, text = _command_of(message.data)
        except ValueError as error:
            wrong = str(error)
        identity = Identity(ROS_SOURCE, number or fresh_number())
        if text.split(maxsplit=1)[:1] == [STOP]:
            self._submit(Command(identity, Stop(), ROS_LINK))
            return
        if not self._text_admission.admit():
            if (refusal := self._text_admission.take_refusal()) is not None:
                self.refuse(None, refusal)
            return
        if wrong:
            self.refuse(None, Refusal(Reason.OUT_OF_RANGE, wrong))
        elif self._read_text is None:
            self.refuse(number, OFF)
        else:
            try:
                command = self._read_text(text, identity, ROS_LINK)
            except ValueError as error:
                self.refuse(number, Refusal(Reason.OUT_OF_RANGE, f"{text[:80]!r}: {error}"))
            else:
                self._submit(command)

    def _on_goal_pose(self, goal: PoseStamped) -> None:
        """Submit the motion to a pose; a repeat of a message is the same command.

        Without a stamp, a repeat is the same command only until that has ended.
        """
        stamped = bool(goal.header.stamp.sec or goal.header.stamp.nanosec)
        content = number_of_pose(goal)
        if not self._goal_admission.admit():
            return
        number = content if stamped else fresh_number()
        if not stamped and self._last_goal is not None and self._last_goal[0] == content:
            return
        try:
            request = pose_request(goal, self._frames)
        except MessageError as error:
            self.refuse(number, Refusal(Reason.OUT_OF_RANGE, f"{self._goal_topic}: {error}"))
            return
        identity = Identity(ROS_SOURCE, number)
        self._last_goal = content, identity
        self._submit(Command(identity, request, ROS_LINK, preemption=PreemptionPolicy.REPLACE))

    def _on_nav2_goal(self, _: PoseStamped) -> None:
        """Report a goal on Nav2's own topic, which drives past the executive."""
        now_s = time.monotonic()
        if self._executive is None or now_s - self._nav2_goal_s < NAV2_GOAL_EVENT_S:
            return
        self._nav2_goal_s = now_s
        theirs, own = map(self._node.resolve_topic_name, (NAV2_GOAL_TOPIC, self._goal_topic))
        self._executive.report_event(
            Severity.WARNING,
            f"a goal was published on {theirs}, the topic of Nav2, and is no command of the"
            f" executive: publish it on {own} (in RViz the topic of 2D Goal Pose)",
        )

    def _submit(self, command: Command) -> None:
        if self._executive is not None:
            self._executive.submit(command, partial(self._on_answer, command.identity))

    def _on_answer(self, identity: Identity, result: SubmitResult) -> None:
        if isinstance(result, Rejected) and result.refusal.reason in UNREPORTED:
            self.refuse(identity.command_id, result.refusal)

    def _poll(self) -> None:
        if (refusal := self._goal_admission.take_refusal()) is not None:
            self.refuse(None, refusal)
        if self._servers is not None:
            self._servers.poll()


def fresh_number() -> int:
    """Return a new command number, from the time in microseconds."""
    return round(time.time() * 1e6)


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
    form = f'{{"id": 4242, "{TEXT_KEY}": "moveForward 0.2"}}, or without id'
    number, command = raw.get("id"), raw.get(TEXT_KEY)
    if not isinstance(command, str) or not raw.keys() <= {"id", TEXT_KEY}:
        raise ValueError(f"expected {form}")
    valid = type(number) is int and 0 < number < 1 << 63
    if number is not None and not valid and command.split(maxsplit=1)[:1] != [STOP]:
        raise ValueError(f"id {str(number)[:40]} is no number of 1 to 2^63 - 1: expected {form}")
    return (number if valid else None), command


def _plain(report: Report) -> dict[str, Any]:
    """Return a report as plain data."""
    identity, cause, reason = report.identity, report.cause, report.reason
    return {
        "sequence": report.sequence,
        "utc_s": report.utc_s,
        "kind": report.kind.name,
        "severity": report.severity.name,
        "source": None if identity is None else identity.source,
        "id": None if identity is None else identity.command_id,
        "stage": None if report.stage is None else report.stage.name,
        "reason": None if reason is None else reason.name,
        "code": None if reason is None else reason.value,
        "text": report.text,
        "figures": [_figure(each.name, each.value, each.unit) for each in report.figures],
        "step": report.step,
        "step_count": report.step_count,
        "fault": report.fault,
        "cause": None if cause is None else str(cause),
    }


def _figure(name: str, value: float, unit: str) -> dict[str, Any]:
    """Return a figure as plain data; JSON has no infinity, which is a text."""
    return {"name": name, "value": value if isfinite(value) else str(value), "unit": unit}
