"""The ports of the router, its replies to links, and its counters."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Final, Protocol

from adapters.mocup.brick.record import BrickLink
from adapters.mops import Message, MopsError, encode, fingerprint, refusal_of
from executive.record import LedgerError
from executive.values.reasons import Reason
from executive.values.reports import Stage


class RouterPorts(Protocol):
    """Where messages leave the router. No method may block."""

    def to_brick(self, octets: bytes, visit: int) -> bool:
        """Send a message to the brick; return False where it cannot take it.

        Args:
            octets: a whole message.
            visit: the time that the brick is there for which it is meant.
        """
        ...

    def stop_brick(self, octets: bytes) -> bool:
        """Send a stop before all that waits, which is dropped; return False where it cannot be."""
        ...

    def notify(self, link: BrickLink, message: Message) -> None:
        """Publish a notification on a link."""
        ...

    def telemetry(self, message: Message) -> None:
        """Publish what the brick measures."""
        ...


@dataclass(slots=True)
class RouterCounts:
    """Counters since the start.

    Attributes:
        commands, repeats: from the links; what comes again is not passed on.
        replies, unasked, telemetry: from the brick.
        refused: messages, and pieces that are none, that went nowhere.
        dropped_octets, dropped_pieces: what was no message, from the links and the brick.
        waiting: commands of the relay that wait for the brick now.
        dead_man: how often the brick was stopped because nobody was left who had moved it.
    """

    commands: int = 0
    repeats: int = 0
    replies: int = 0
    unasked: int = 0
    telemetry: int = 0
    refused: int = 0
    dropped_octets: int = 0
    dropped_pieces: int = 0
    waiting: int = 0
    dead_man: int = 0


MOST_UNCONFIRMED: Final = 1000
"""Replies that are retransmitted at most; the oldest are dropped."""
ABSENT: Final = "the brick is not there or does not keep up"


@dataclass(frozen=True, slots=True)
class CancelCause:
    """Why something ends that nobody has cancelled by its number."""

    text: str
    reason: Reason | None = None


@dataclass(frozen=True, slots=True)
class ReplyPublisher:
    """Replies to links in the name of the brick.

    Attributes:
        name: the brick's, by which messages are for it or from it.
        ports: where messages leave.
        tell: called with one line on each message that is not passed on.
        counts: for diagnostics.
        unconfirmed: by fingerprint, what `rover-relay` has not confirmed to have on its disk.
    """

    name: str
    ports: RouterPorts
    tell: Callable[[str], None]
    counts: RouterCounts
    unconfirmed: dict[int, Message] = field(default_factory=dict)

    def notify(self, link: BrickLink, message: Message) -> None:
        """Publish a notification on a link, if it is short enough for a message."""
        try:
            encode(message)
        except MopsError as error:
            self.refuse(f"{link.value} link: there is no reply: {error}")
        else:
            if link is BrickLink.RELAY:
                self.unconfirmed[fingerprint(str(message))] = message
                if len(self.unconfirmed) > MOST_UNCONFIRMED:
                    del self.unconfirmed[next(iter(self.unconfirmed))]
            self.ports.notify(link, message)

    def reject(
        self, links: Sequence[BrickLink], command: Message, text: str, reason: Reason | None = None
    ) -> None:
        """Reply to links that a command is refused."""
        self.refuse(f"{links[-1].value} link: {command}: {text}")
        for link in links:
            self.notify(link, refusal_of(command, self.name, text, reason))

    def refuse(self, line: str) -> None:
        """Count and log a message that is not passed on."""
        self.counts.refused += 1
        self.tell(line)

    @contextmanager
    def contained(self, what: str) -> Iterator[None]:
        """Count and log a failure of the record, and go on."""
        try:
            yield
        except LedgerError as error:
            self.refuse(f"{what}: {error}")

    def reply(
        self, command: Message, stage: Stage, text: str = "", reason: Reason | None = None
    ) -> Message:
        """Return a reply as a brick would give it to a command that it has received."""
        refusal = refusal_of(command, self.name, text, reason)
        return replace(refusal, outputs=(stage.name, *refusal.outputs[1:]), received=True)

    def cancelled(self, command: Message, cause: CancelCause) -> Message:
        """Return the reply that ends a command that was received and not done."""
        return self.reply(command, Stage.CANCELLED, cause.text, cause.reason)

    def is_same(self, link: BrickLink, known: Message, command: Message) -> bool:
        """Return whether two commands under one number are the same; refuse the second if not."""
        if same(known, command):
            self.counts.repeats += 1
            return True
        text = f"this number is that of another {known.command}"
        self.reject((link,), command, text, Reason.DUPLICATE)
        return False


def same(one: Message, other: Message) -> bool:
    """Return whether two messages ask for the same."""
    return (one.code, one.inputs) == (other.code, other.inputs)


def command_of(reply: Message) -> Message:
    """Return a message with the source and numbers of the command that a reply is on."""
    return replace(reply, source=reply.dest, dest=reply.source)
