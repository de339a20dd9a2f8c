"""`ReplyPublisher`: replies to links in the brick's name; `RouterPorts`: the router's output."""

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
    """Output of the router. No method may block."""

    def to_brick(self, octets: bytes, visit: int) -> bool:
        """Send a message to the brick; return False if it is refused.

        Args:
            octets: a whole message.
            visit: number of the connection that the message is meant for.
        """
        ...

    def stop_brick(self, octets: bytes) -> bool:
        """Send a stop ahead of all queued messages, which are dropped; return False if it fails."""
        ...

    def notify(self, link: BrickLink, message: Message) -> None:
        """Publish a notification on a link."""
        ...

    def publish_telemetry(self, message: Message) -> None:
        """Publish the measurements of the brick."""
        ...


@dataclass(slots=True)
class RouterCounts:
    """Counters since the start.

    Attributes:
        commands, repeats: from the links; repeats are not forwarded.
        replies, unsolicited, telemetry: from the brick.
        refused: messages, and invalid pieces, that were not forwarded.
        dropped_octets, dropped_pieces: invalid input from the links and the brick.
        queued: commands of the relay that are queued now.
        dead_man: stops of the brick because every sender of its motions was silent.
    """

    commands: int = 0
    repeats: int = 0
    replies: int = 0
    unsolicited: int = 0
    telemetry: int = 0
    refused: int = 0
    dropped_octets: int = 0
    dropped_pieces: int = 0
    queued: int = 0
    dead_man: int = 0


MAX_UNCONFIRMED: Final = 1000
"""Maximum number of replies that are retransmitted; older ones are dropped."""
ABSENT: Final = "the brick is not connected or too slow"


@dataclass(frozen=True, slots=True)
class CancelCause:
    """Cause of an end that was not commanded by number."""

    text: str
    reason: Reason | None = None


@dataclass(frozen=True, slots=True)
class ReplyPublisher:
    """Sends replies to links in the name of the brick.

    Attributes:
        name: name of the brick, as source or destination of messages.
        log: called with one line for each message that is not forwarded.
        counts: counters for diagnostics.
        unconfirmed: replies that `rover-relay` has not acknowledged as stored, by fingerprint.
    """

    name: str
    ports: RouterPorts
    log: Callable[[str], None]
    counts: RouterCounts
    unconfirmed: dict[int, Message] = field(default_factory=dict)

    def notify(self, link: BrickLink, message: Message) -> None:
        """Publish a notification on a link, if it is short enough for a message."""
        try:
            encode(message)
        except MopsError as error:
            self.refuse(f"{link.value} link: no reply possible: {error}")
        else:
            if link is BrickLink.RELAY:
                self.unconfirmed[fingerprint(str(message))] = message
                if len(self.unconfirmed) > MAX_UNCONFIRMED:
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
        """Count and log a message that is not forwarded."""
        self.counts.refused += 1
        self.log(line)

    @contextmanager
    def contained(self, what: str) -> Iterator[None]:
        """Count and log a failure of the record, and continue."""
        try:
            yield
        except LedgerError as error:
            self.refuse(f"{what}: {error}")

    def reply(
        self, command: Message, stage: Stage, text: str = "", reason: Reason | None = None
    ) -> Message:
        """Return a reply in the form of a brick that has received the command."""
        refusal = refusal_of(command, self.name, text, reason)
        return replace(refusal, outputs=(stage.name, *refusal.outputs[1:]), received=True)

    def cancelled(self, command: Message, cause: CancelCause) -> Message:
        """Return the reply that cancels a command that was received and not executed."""
        return self.reply(command, Stage.CANCELLED, cause.text, cause.reason)

    def is_same(self, link: BrickLink, known: Message, command: Message) -> bool:
        """Return whether two commands with one number are equal; refuse the second if not."""
        if same(known, command):
            self.counts.repeats += 1
            return True
        text = f"this number is used by another {known.command}"
        self.reject((link,), command, text, Reason.DUPLICATE)
        return False


def same(one: Message, other: Message) -> bool:
    """Return whether two messages have the same request."""
    return (one.code, one.inputs) == (other.code, other.inputs)


def command_of(reply: Message) -> Message:
    """Return a message with the source and numbers of the command that a reply answers."""
    return replace(reply, source=reply.dest, dest=reply.source)
