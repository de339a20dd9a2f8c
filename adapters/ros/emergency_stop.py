"""The robot's own emergency stop (e-stop): its state is a fact; an executive's stop activates it.

While the executive activates it, its state does not show whether a button of the robot is pressed:
it counts as inactive until it is released, which only a resume does.
"""

from collections.abc import Callable
from functools import partial
from math import inf
from typing import Any, Final

from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from adapters.ros.parameters import (
    ParameterError,
    Topic,
    declare_flag,
    declare_optional_text,
    declare_optional_topic,
)
from executive.values.clock import Clock

OUTPUT: Final = "emergency_stop_output"
RETRY_S: Final = 0.5
"""Time after which a service is called again that did not answer, or refused to stop."""
RELEASE_S: Final = 1.0
"""Time for the robot to report the release; until then its state counts as inactive."""
Alarm = Callable[[str], None]


class RobotEmergencyStop:
    """Reports the state of the robot's emergency stop, and activates it while a stop is in force.

    Args:
        node: declares the parameters, and creates a topic or services.
        state: topic of its state; None if the robot does not publish it.
        clock: the core's clock.
        observe: called with each change of the state.
        alarm: called if the robot refuses a service, or does not answer.

    Raises:
        ParameterError: a parameter is missing or invalid.
    """

    def __init__(
        self,
        node: Node,
        state: Topic | None,
        clock: Clock,
        observe: Callable[[bool], None],
        alarm: Alarm,
    ) -> None:
        self._clock, self._observe, self._alarm = clock, observe, alarm
        self._active_if = state is not None and _polarity(node, "emergency_stop")
        self._output = _output(node, clock, self._on_refusal)
        self._state: bool | None = None
        self._reported: bool | None = None
        self._held, self._ours_until_s = False, -inf

    def on_state(self, message: Bool) -> None:
        """Process a message of the robot."""
        self._state = message.data == self._active_if
        if not (self._state or self._held):
            self._ours_until_s = -inf
        self._report()

    def update(self, held: bool) -> None:
        """Activate it while a stop is in force that only a resume ends, then release it.

        Called once a tick, and after commands.
        """
        if self._output is None:
            return
        if held is not self._held:
            self._held = held
            self._ours_until_s = inf if held else self._clock.now_s() + RELEASE_S
        self._output(held)
        self._report()

    def _report(self) -> None:
        active = self._state and self._clock.now_s() >= self._ours_until_s
        if active is not None and active is not self._reported:
            self._observe(active)
            self._reported = active

    def _on_refusal(self, text: str) -> None:
        if not self._held:
            self._ours_until_s = -inf
        self._alarm(f"emergency stop of the robot: {text}")


class _ServiceOutput:
    """Calls a service at a stop and at its release: a stop again until the robot accepts it."""

    def __init__(self, node: Node, name: str, clock: Clock, refused: Alarm) -> None:
        self._clock, self._refused = clock, refused
        release = declare_optional_text(node, f"{OUTPUT}.release", "service that ends the stop")
        if release:
            self._calls = [
                (node.create_client(Trigger, each), Trigger.Request()) for each in (release, name)
            ]
        else:
            active, client = _polarity(node, OUTPUT), node.create_client(SetBool, name)
            self._calls = [(client, SetBool.Request(data=each)) for each in (not active, active)]
        self._held, self._done, self._attempts, self._due_s = False, True, 0, -inf

    def __call__(self, held: bool) -> None:
        now_s = self._clock.now_s()
        if held is not self._held:
            self._held, self._done, self._attempts, self._due_s = held, False, 0, now_s
        if self._done or now_s < self._due_s:
            return
        client, request = self._calls[held]
        self._due_s, self._attempts = now_s + RETRY_S, self._attempts + 1
        if ready := client.service_is_ready():
            answer: Any = client.call_async(request)
            answer.add_done_callback(partial(self._on_answer, held))
        if self._attempts == 2:
            problem = "does not answer" if ready else "does not exist"
            self._refused(f"service {client.srv_name} {problem}")

    def _on_answer(self, held: bool, answer: Any) -> None:
        response = answer.result()
        if held is not self._held or self._done:
            return
        self._done = response.success or not held
        if not response.success and self._attempts == 1:
            text = response.message or "without a reason"
            self._refused(f"service {self._calls[held][0].srv_name} refuses: {text}")


def _output(node: Node, clock: Clock, refused: Alarm) -> Callable[[bool], None] | None:
    """Return what activates and releases the stop, called at each tick; None without an output."""
    topic = declare_optional_topic(node, OUTPUT, "emergency stop by the executive", Bool)
    service = declare_optional_text(node, f"{OUTPUT}.service", "service that stops the robot")
    if topic is not None and service:
        raise ParameterError(f"parameter {OUTPUT} has a topic and a service: remove one")
    if topic is None:
        return _ServiceOutput(node, service, clock, refused) if service else None
    active, publisher = _polarity(node, OUTPUT), node.create_publisher(Bool, topic.name, topic.qos)
    before = [False]

    def publish(held: bool) -> None:
        if held or before[0]:
            publisher.publish(Bool(data=held == active))
        before[0] = held

    return publish


def _polarity(node: Node, key: str) -> bool:
    """Return the value that means an active stop; true without the key."""
    return declare_flag(node, f"{key}.active", "value of an active stop", default=True)
