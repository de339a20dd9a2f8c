"""An executive in simulated time with its relay link, and what stands where rover-relay does."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

from rclpy.node import Node
from std_msgs.msg import String, UInt64

from adapters.mops import Message, fingerprint, messages_in
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from adapters.ros import MessageError, Topic, declare_topic
from executive.commands.catalogue import Request
from executive.ports import Downlink
from executive.reports import Identity
from tests.relay.rover.ends import DICTIONARY
from tests.stress.mops_aboard import Wire
from tests.support.kinematic import Bench


def asked(request: Request, number: int) -> Message:
    return DICTIONARY.command(request, Identity("MOE", number), "JACKAL")


class RelayedBench(Bench):
    """An executive that hears the strings of the relay; its link's `Served`."""

    def downlinks(self) -> list[Downlink]:
        self.wire = Wire()
        node = cast(Node, self.wire)
        stops, commands = (declare_topic(node, key, "") for key in ("relay_stop", "relay_command"))
        self.link = ExecutiveRelayLink(node, stops, commands, self.ledger, DICTIONARY, "JACKAL")
        return [*super().downlinks(), self.link]

    def subscribe(self, kind: type, topic: Topic, callback: Callable[[Any], None]) -> None:
        if kind is String:
            self.on_string = callback
        else:
            self.on_kept = callback

    subscribe_apart = subscribe

    def contained(self, callback: Callable[..., None]) -> Callable[..., None]:
        return callback

    def hear(self, text: str) -> None:
        """Take a string of commands."""
        self.link.serve(self.executive.submit, self)
        with suppress(MessageError):
            self.on_string(String(data=text))
        self.executive.turn()

    def keep(self) -> None:
        """Say that all that was told is on the disk, as rover-relay does."""
        said = list(self.wire.said)
        self.wire.said.clear()
        for text in said:
            self.on_kept(UInt64(data=fingerprint(text)))

    @property
    def told(self) -> list[Message]:
        """What was told and is not said to be on the disk."""
        texts = (text for text in self.wire.said if "|TELEMETRY|" not in text)
        return [each for text in texts for each in messages_in(text, print)]
