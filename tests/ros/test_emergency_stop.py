"""The robot's own emergency stop: reported by it, and activated by a stop of the executive."""

from pathlib import Path

import pytest
from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from adapters.ros import ParameterError
from adapters.ros.rover import LOCK_QOS
from executive.commands import Mode
from executive.commands.catalogue import Command, Request, Resume, Stop
from executive.commands.lifecycle import Accepted, SubmitResult
from executive.values.reports import Identity
from tests.ros.test_node import Bench, started

pytestmark = pytest.mark.ros


def parameters(key: str, **given: object) -> list[str]:
    return [word for name, value in given.items() for word in ("-p", f"{key}.{name}:={value}")]


STATE = parameters("emergency_stop", topic="stopped", reliability="reliable", depth=1)
TOPIC = parameters("emergency_stop_output", topic="halt", reliability="reliable", depth=1)


class Services:
    """A robot's services, and its state, which it publishes at each call."""

    def __init__(self, node: Node, bench: Bench) -> None:
        self.calls: list[str] = []
        self.pressed = False
        self._state = node.create_publisher(Bool, "stopped", 1)
        node.create_service(Trigger, "halt", self._halt)
        node.create_service(Trigger, "go", self._go)
        bench.until(lambda: bench.met(self._state.topic_name), "the state is heard")

    def report(self, active: bool) -> None:
        self._state.publish(Bool(data=active))

    def _halt(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        self.calls.append("halt")
        self.report(True)
        answer.success = True
        return answer

    def _go(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        self.calls.append("go")
        answer.success, answer.message = not self.pressed, "a button is pressed"
        self.report(self.pressed)
        return answer


def submit(bench: Bench, number: int, request: Request) -> SubmitResult:
    return bench.submit(Command(Identity("test", number), request, "direct"))


def events(bench: Bench) -> list[str]:
    return [each.text for each in bench.executive.reports()]


def gaps(bench: Bench) -> str:
    (found,) = (
        value.value
        for status in bench.health[-1].status
        for value in status.values
        if value.key == "not monitored"
    )
    return str(found)


def test_its_state_may_be_false_where_it_is_active(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain > 0
    with started(tmp_path, 0.05, *STATE, *parameters("emergency_stop", active="false")) as bench:
        enabled = bench.rover.create_publisher(Bool, "stopped", 1)
        bench.until(lambda: bench.met(enabled.topic_name), "the state is heard")
        bench.until(lambda: bool(bench.health), "health")
        assert "the robot's emergency stop (no state received)" in gaps(bench)
        enabled.publish(Bool(data=True))
        bench.health.clear()
        bench.until(lambda: bool(bench.health), "health")
        bench.until(lambda: "emergency stop" not in gaps(bench), "that it is monitored")
        enabled.publish(Bool(data=False))
        bench.until(lambda: bench.executive.mode is Mode.SAFE, "SAFE")
        enabled.publish(Bool(data=True))
        bench.until(lambda: not bench.executive.status.emergency_stop, "its release")
        assert bench.executive.mode is Mode.SAFE, "until it is resumed"


@pytest.mark.parametrize("active", [True, False])
def test_a_stop_holds_a_topic_until_it_is_resumed(
    ros_domain: int, tmp_path: Path, active: bool
) -> None:
    assert ros_domain > 0
    polarity = parameters("emergency_stop_output", active=str(active).lower())
    with started(tmp_path, 0.05, *TOPIC, *polarity) as bench:
        received: list[bool] = []

        def receive(message: Bool) -> None:
            received.append(message.data)

        halt = bench.rover.create_subscription(Bool, "halt", receive, LOCK_QOS)
        bench.until(lambda: bench.met(halt.topic_name), "the topic is heard")
        assert not received, "without a stop nothing is published"
        submit(bench, 1, Stop())
        bench.until(lambda: len(received) > 5, "the stop, all the time")
        assert set(received) == {active}
        assert isinstance(submit(bench, 2, Resume()), Accepted)
        bench.until(lambda: received[-1] is not active, "its release")


def test_a_set_bool_service_is_called_with_each_state(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain > 0
    halt = parameters("emergency_stop_output", service="halt")
    with started(tmp_path, 0.05, *halt) as bench:
        received: list[bool] = []

        def serve(request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
            received.append(request.data)
            answer.success = len(received) > 1
            return answer

        submit(bench, 1, Stop())
        bench.until(lambda: any("does not exist" in each for each in events(bench)), "an alarm")
        bench.rover.create_service(SetBool, "halt", serve)
        bench.until(lambda: received == [True, True], "the stop, until it is accepted")
        submit(bench, 2, Resume())
        bench.until(lambda: received == [True, True, False], "its release")


def test_trigger_services_stop_and_release(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain > 0
    halt = parameters("emergency_stop_output", service="halt", release="go")
    with started(tmp_path, 0.05, *STATE, *halt) as bench:
        robot = Services(bench.rover, bench)
        robot.report(True)
        bench.until(lambda: bench.executive.mode is Mode.SAFE, "SAFE by the robot")
        robot.report(False)
        bench.until(lambda: not bench.executive.status.emergency_stop, "its release")
        assert isinstance(submit(bench, 1, Resume()), Accepted)
        bench.until(lambda: bench.executive.mode is Mode.IDLE, "IDLE")
        assert robot.calls == [], "the robot is not stopped because it has stopped"

        submit(bench, 2, Stop())
        bench.until(lambda: robot.calls == ["halt"], "the stop")
        bench.until(lambda: bench.executive.mode is Mode.STOPPED, "STOPPED")
        assert isinstance(submit(bench, 3, Resume()), Accepted), "its state does not hinder it"
        bench.until(lambda: robot.calls == ["halt", "go"], "its release")
        assert bench.executive.mode is Mode.IDLE

        submit(bench, 4, Stop())
        robot.pressed = True
        bench.until(lambda: len(robot.calls) == 3, "the stop")
        submit(bench, 5, Resume())
        bench.until(lambda: bench.executive.mode is Mode.SAFE, "SAFE by the button")
        refusal = "go refuses: a button is pressed"
        bench.until(lambda: any(refusal in each for each in events(bench)), "an alarm")


def test_a_topic_and_a_service_are_refused(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain > 0
    both = (*TOPIC, *parameters("emergency_stop_output", service="halt"))
    with (
        pytest.raises(ParameterError, match="has a topic and a service: remove one"),
        started(tmp_path, 0.05, *both),
    ):
        pass
