"""Whose message goes where: between two links and one brick (thesis 6.2). No ROS, no USB."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Final, Protocol

from adapters.mops.dictionary import Spelling
from adapters.mops.message import Message, MopsError, encode
from adapters.mops.reports import is_last, refusal_of
from adapters.mops.stream import MopsStream, messages_in
from executive.reasons import Reason
from executive.reports import Stage

REMEMBERED: Final = 1024


class Link(Enum):
    """A way in and out."""

    DIRECT = "direct"
    RELAY = "relay"


class Exits(Protocol):
    """Where messages leave the router. None of them may block."""

    def to_brick(self, octets: bytes) -> bool:
        """Send octets to the brick; return False where it cannot take them."""
        ...

    def notify(self, link: Link, message: Message) -> None:
        """Give a link a notification."""
        ...

    def telemetry(self, message: Message) -> None:
        """Publish what the brick measures."""
        ...


@dataclass(frozen=True, slots=True)
class Key:
    """What tells a command from every other; its replies carry it back."""

    source: str
    moe_inputs_id: int | None
    moe_inputs_counter: int | None


@dataclass(slots=True)
class _Asked:
    command: Message
    links: list[Link]
    replied: Message | None = None

    @property
    def ended(self) -> bool:
        return self.replied is not None and is_last(self.replied)


@dataclass(slots=True)
class Counts:
    """What passed since the start, and what did not."""

    commands: int = 0
    repeats: int = 0
    replies: int = 0
    unasked: int = 0
    telemetry: int = 0
    refused: int = 0


@dataclass
class Router:
    """Checks, remembers and passes on. Used by one thread.

    A command goes to the brick once. One that comes again, by whichever link, gets the last reply
    again, and from then on its link hears of it too; only a stop is passed on every time.

    Attributes:
        spelling: which codes are telemetry and a stop.
        name: the brick's, by which messages are for it or from it.
        exits: where messages leave.
        tell: called with one line on each message that is not passed on.
        counts: for diagnostics.
    """

    spelling: Spelling
    name: str
    exits: Exits
    tell: Callable[[str], None]
    counts: Counts = field(default_factory=Counts)
    _asked: dict[Key, _Asked] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin at the border of a message."""
        self._heard = MopsStream(self._refuse)

    def command(self, link: Link, text: str) -> None:
        """Take whole messages from a link."""
        for message in messages_in(text, self._refuse):
            if message.dest == self.name:
                self._pass_on(link, message)
            else:
                self._refuse(f"{link.value} link: {message} is for {message.dest}")

    def heard(self, octets: bytes) -> None:
        """Take octets from the brick, cut anywhere."""
        for message in self._heard.feed(octets):
            if message.source != self.name:
                self._refuse(f"the brick says {message}, which is from {message.source}")
            elif message.code == self.spelling.telemetry.code:
                self.counts.telemetry += 1
                self.exits.telemetry(message)
            else:
                self._reply(message)

    def lost(self) -> None:
        """Tell everyone who waits that the brick is gone; what it does now nobody knows."""
        self._heard = MopsStream(self._refuse)
        for asked in self._asked.values():
            if not asked.ended:
                refusal = refusal_of(asked.command, self.name, "the brick is gone")
                outputs = (Stage.FAILED.name, *refusal.outputs[1:])
                received = asked.replied is not None
                self._answer(asked, replace(refusal, outputs=outputs, received=received))

    def _pass_on(self, link: Link, command: Message) -> None:
        key = Key(command.source, command.moe_inputs_id, command.moe_inputs_counter)
        known = self._asked.get(key)
        if known is None or command.moe_inputs_id is None:
            known = self._remember(key, _Asked(command, [link]))
        elif (known.command.code, known.command.inputs) != (command.code, command.inputs):
            text = f"this number is that of another {known.command.command}"
            self._reject([link], command, text, Reason.DUPLICATE)
            return
        else:
            self.counts.repeats += 1
            if link not in known.links:
                known.links.append(link)
            if command.code != self.spelling.commands["stop"].code:
                if known.replied is not None:
                    self._notify(link, known.replied)
                return
        if self.exits.to_brick(encode(command)):
            self.counts.commands += 1
            return
        del self._asked[key]
        self._reject(known.links, command, "the brick is not there or does not keep up")

    def _remember(self, key: Key, asked: _Asked) -> _Asked:
        self._asked.pop(key, None)
        self._asked[key] = asked
        if len(self._asked) > REMEMBERED:
            del self._asked[next(iter(self._asked))]
        return asked

    def _reply(self, reply: Message) -> None:
        asked = self._asked.get(Key(reply.dest, reply.moe_inputs_id, reply.moe_inputs_counter))
        if asked is not None:
            self.counts.replies += 1
            self._answer(asked, reply)
            return
        self.counts.unasked += 1
        for link in Link:
            self._notify(link, reply)

    def _answer(self, asked: _Asked, reply: Message) -> None:
        asked.replied = reply
        for link in asked.links:
            self._notify(link, reply)

    def _reject(
        self, links: Sequence[Link], command: Message, text: str, reason: Reason | None = None
    ) -> None:
        self._refuse(f"{links[-1].value} link: {command}: {text}")
        for link in links:
            self._notify(link, refusal_of(command, self.name, text, reason))

    def _notify(self, link: Link, message: Message) -> None:
        try:
            encode(message)
        except MopsError as error:
            self._refuse(f"{link.value} link: there is no reply: {error}")
        else:
            self.exits.notify(link, message)

    def _refuse(self, line: str) -> None:
        self.counts.refused += 1
        self.tell(line)
