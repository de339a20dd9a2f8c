"""An executive in simulated time with its relay link, and what stands where rover-relay does."""

from contextlib import suppress

from adapters.mops import Message, MopsError, fingerprint, messages_in
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from executive.commands.catalogue import Request
from executive.values.ports import Downlink
from executive.values.reports import Identity
from tests.relay.rover.ends import DICTIONARY
from tests.stress.mops_aboard import Wire
from tests.support.kinematic import Bench


def request_message(request: Request, number: int) -> Message:
    return DICTIONARY.command(request, Identity("MOE", number), "JACKAL")


class RelayedBench(Bench):
    """An executive that hears the strings of the relay."""

    def downlinks(self) -> list[Downlink]:
        self.wire = Wire()
        self.link = ExecutiveRelayLink(self.wire, self.ledger, DICTIONARY, "JACKAL")
        return [*super().downlinks(), self.link]

    def receive(self, text: str) -> None:
        """Take a string of commands."""
        self.link.serve(self.executive.submit)
        with suppress(MopsError):
            self.link.command(text)
        self.executive.serve_inbox()

    def store(self) -> None:
        """Say that all that was told is on the disk, as rover-relay does."""
        message = list(self.wire.output)
        self.wire.output.clear()
        for text in message:
            self.link.on_confirmed(fingerprint(text))

    @property
    def reported(self) -> list[Message]:
        """What was told and is not said to be on the disk."""
        texts = (text for text in self.wire.output if "|TELEMETRY|" not in text)
        return [each for text in texts for each in messages_in(text, print)]
