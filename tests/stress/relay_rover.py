"""`python -m tests.stress.relay_rover FOLDER`: who is at the ROS topics in place of an executive.

It is not killed, and writes down each command that comes. It has the ledger and the relay link of
`rover-executive`; every command is done at once, and one report says so. A command that the ledger
knows is not done again: its report is told again.
"""

import logging
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from rclpy.node import Node
from std_msgs.msg import String

from adapters.mops import LINK, load_dictionary
from adapters.mops.codec import END
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from adapters.relay.rover.executive_topics import ExecutiveRelayTopics
from adapters.ros import MessageError, Topic, ros_node, single_threaded
from executive.commands.catalogue import Command
from executive.commands.lifecycle import Duplicate, SubmitResult
from executive.record import Ledger, Synchronous
from executive.settings import config_folder
from executive.values.reports import Report, ReportKind, Severity, Stage
from tests.stress.journal import Journal
from tests.stress.relay_traffic import ASSET, NAME, ROVER_LEDGER, TOPIC_JOURNAL

LISTENS: Final = "the rover listens"
_LOG: Final = logging.getLogger(__name__)


class Rover:
    """Takes commands and tells reports; the `CommandDequeued` of its topics."""

    def __init__(self, node: Node, folder: Path) -> None:
        self._node = node
        self._journal = Journal(folder / TOPIC_JOURNAL)
        self._ledger = Ledger(folder / ROVER_LEDGER, Synchronous.NORMAL)
        self._taken: list[tuple[Command, Callable[[SubmitResult], None]]] = []
        topics = ExecutiveRelayTopics(node)
        self._link = ExecutiveRelayLink(topics, self._ledger, load_dictionary(), NAME)
        self._link.serve(self._submit)
        topics.serve(self._link, self)

    def subscribe(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Have what takes messages called; a string is written down before."""
        contained = self.contained(callback)

        def take(message: Any) -> None:
            if isinstance(message, String):
                for command in message.data.split(END)[:-1]:
                    self._journal.write(command + END)
            contained(message)
            self._do()

        self._node.create_subscription(topic.type, topic.name, take, topic.qos)

    subscribe_apart = subscribe

    def contained(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Return a callback that refuses what is no message."""

        def call(*arguments: object) -> None:
            try:
                callback(*arguments)
            except MessageError as error:
                _LOG.warning("message refused: %s", error)

        return call

    def _submit(
        self,
        command: Command,
        answer: Callable[[SubmitResult], None],
        prepare: Callable[[], None],
    ) -> None:
        prepare()
        self._taken.append((command, answer))

    def _do(self) -> None:
        taken, self._taken = self._taken, []
        for command, answer in taken:
            report = self._ledger.last_report(command.identity)
            if report is None:
                report = self._done(command)
                self._ledger.record(command)
                self._ledger.append_report(report)
            self._ledger.commit()
            self._link.send_reports((report,))
            answer(Duplicate(report))

    def _done(self, command: Command) -> Report:
        number, how = self._ledger.last_sequence + 1, (ReportKind.COMMAND, Severity.INFORMATIONAL)
        return Report(number, time.time(), *how, "", command.identity, Stage.EXECUTED, LINK)


def main(folder: Path) -> None:
    logging.basicConfig(level="INFO")
    with (
        ros_node("rover", ASSET, parameters=config_folder() / f"{ASSET}.ros.yaml") as node,
        single_threaded(node) as executor,
    ):
        Rover(node, folder)
        print(LISTENS, flush=True)
        while True:
            executor.spin_once()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
