"""An executive with its relay link over real topics, and what stands where rover-relay does."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from geometry_msgs.msg import TwistStamped
from std_msgs.msg import String, UInt64

from adapters.mops import Message, MopsError, fingerprint, load_dictionary, messages_in, report_of
from adapters.onboard.housekeeping import ExecutiveHousekeeping
from adapters.onboard.service import executive_on
from adapters.ros import declare_topic, ros_node, single_threaded
from executive.commands import Mode
from executive.commands.catalogue import Command, Request
from executive.commands.lifecycle import SubmitResult
from executive.core.runner import Executive
from executive.record import Ledger, Synchronous
from executive.settings import config_folder, load_settings
from executive.values.reports import Identity, Report, Stage

LIMIT_S = 60.0
DICTIONARY = load_dictionary()
STAGES = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


def reports_in(message: Message) -> Iterator[Report]:
    with suppress(MopsError):
        yield report_of(message, DICTIONARY, 0.0)


class Relay:
    """What stands where rover-relay does: hears, and says what it keeps."""

    def __init__(self, stack: ExitStack) -> None:
        self.received: list[str] = []
        self.stores = True
        self.node = stack.enter_context(
            ros_node("relay", "jackal", parameters=config_folder() / "jackal.ros.yaml")
        )
        self._executor = stack.enter_context(single_threaded(self.node))
        topics = [
            declare_topic(self.node, key, key, kind)
            for key, kind in (
                ("relay_command", String),
                ("relay_notification", String),
                ("relay_notification_ack", UInt64),
                ("relay_stop", String),
                ("cmd_vel", TwistStamped),
            )
        ]
        self._command = self.node.create_publisher(String, topics[0].name, topics[0].qos)
        self._stored = self.node.create_publisher(UInt64, topics[2].name, topics[2].qos)
        self._stop = self.node.create_publisher(String, topics[3].name, topics[3].qos)
        self.velocities: list[TwistStamped] = []
        self._moved = self.node.create_subscription(
            TwistStamped, topics[4].name, self.velocities.append, topics[4].qos
        )
        self._reported = self.node.create_subscription(
            String, topics[1].name, self._on_reported, topics[1].qos
        )

    @property
    def joined(self) -> bool:
        publishers: tuple[int, ...] = (
            self._command.get_subscription_count(),
            self._stored.get_subscription_count(),
            self._stop.get_subscription_count(),
            self._moved.get_publisher_count(),
        )
        return all(publishers)

    @property
    def alone(self) -> bool:
        return self.node.count_subscribers(self._reported.topic_name) == 1

    def leave(self) -> None:
        """Listen no more."""
        self.node.destroy_subscription(self._reported)

    def spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.005)

    def send(self, text: str) -> None:
        self._command.publish(String(data=text))

    def stop(self, text: str) -> None:
        self._stop.publish(String(data=text))

    def store(self, text: str) -> None:
        self._stored.publish(UInt64(data=fingerprint(text)))

    @property
    def strings_of_reports(self) -> list[str]:
        return [text for text in self.received if "|TELEMETRY|" not in text]

    @property
    def messages(self) -> list[Message]:
        return [each for text in self.received for each in messages_in(text, pytest.fail)]

    @property
    def reports(self) -> list[Report]:
        return [report for message in self.messages for report in reports_in(message)]

    @property
    def refused(self) -> list[Message]:
        return [message for message in self.messages if message.outputs[:1] == ("REJECTED",)]

    def stages(self, number: int) -> list[Stage | None]:
        return [r.stage for r in self.reports if r.identity == Identity("MOE", number)]

    def _on_reported(self, text: String) -> None:
        self.received.append(text.data)
        if self.stores:
            self.store(text.data)


class Aboard:
    """An executive with its relay link, and who listens."""

    def __init__(self, folder: Path, relays: ExitStack) -> None:
        self._folder, self._relays = folder, relays
        self.relay = Relay(relays)
        self._housekeeping = ExecutiveHousekeeping(folder)
        self._process = ExitStack()
        self.executive = self._start()
        self.join()

    def _start(self) -> Executive:
        parameters = config_folder() / "jackal.ros.yaml"
        node = self._process.enter_context(ros_node("executive", "jackal", parameters=parameters))
        self._executor = self._process.enter_context(single_threaded(node))
        ledger = Ledger(self._folder / "ledger.sqlite", Synchronous.NORMAL)
        served = executive_on(
            node,
            load_settings("jackal"),
            ledger,
            self._folder / "files",
            [],
            relayed=True,
            housekeeping=self._housekeeping,
        )
        return self._process.enter_context(served)

    def join(self) -> None:
        before = len(self.relay.received)
        self.until(lambda: self.relay.joined and len(self.relay.received) > before, "they meet")

    def end(self) -> None:
        self._process.close()

    def forget(self) -> None:
        """Take the ledger away."""
        for path in self._folder.glob("ledger.sqlite*"):
            path.unlink()

    def restart(self) -> None:
        self.end()
        self.executive = self._start()

    def until(self, done: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}\n{self.relay.received}"
            self._executor.spin_once(timeout_sec=0.005)
            self.relay.spin()

    def until_without_core(self, done: Callable[[], bool], what: str) -> None:
        """Wait while the core's thread does nothing."""
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}"
            self.relay.spin()

    def request(self, request: Request, number: int) -> Message:
        message = DICTIONARY.command(request, Identity("MOE", number), "JACKAL")
        self.relay.send(str(message))
        return message

    def send_housekeeping(self) -> None:
        """Measure the housekeeping, as the direct link has done every few seconds."""
        self._housekeeping.measure(self.executive)

    def mode(self) -> Mode:
        return self.executive.mode

    def reported(self, number: int, stage: Stage) -> None:
        self.until(lambda: stage in self.relay.stages(number), f"{stage} of {number}")

    def direct(self, request: Request, number: int) -> None:
        answers: list[SubmitResult] = []
        command = Command(Identity("MOE", number), request, "direct")
        self.executive.submit(command, answers.append)
        self.until(lambda: bool(answers), "an answer")
