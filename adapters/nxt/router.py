"""Whose message goes where: between two links and one brick (thesis 6.2). No ROS, no USB.

A command goes to the brick once, by whichever link it comes first, and its replies by every link
that sent it. Behind the direct link stands the executive: it claims each command that it carries
out, asks the brick for parts of it under the command's number with a counter, and reports on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Protocol

from adapters.mops.dictionary import Spelling
from adapters.mops.message import Message, MopsError, encode
from adapters.mops.reports import refusal_of
from adapters.mops.stream import MopsStream, messages_in
from adapters.nxt.record import Asked, Claim, Link, Record, RecordError
from executive.reasons import Reason
from executive.reports import Stage

GONE: Final = "the brick is gone"
RESTARTED: Final = "rover-nxt was restarted: what the brick did meanwhile nobody knows"


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

    One that comes again gets the last reply again, and from then on its link hears of it too; only
    a stop is passed on every time, and before it is written down.

    Attributes:
        spelling: which codes are telemetry and a stop.
        name: the brick's, by which messages are for it or from it.
        exits: where messages leave.
        tell: called with one line on each message that is not passed on.
        record: what was asked and claimed.
        counts: for diagnostics.
    """

    spelling: Spelling
    name: str
    exits: Exits
    tell: Callable[[str], None]
    record: Record
    counts: Counts = field(default_factory=Counts)

    def __post_init__(self) -> None:
        """Begin at the border of a message."""
        self._heard = MopsStream(self._refuse)

    def command(self, link: Link, text: str) -> None:
        """Take whole messages from a link."""
        for message in messages_in(text, self._refuse):
            try:
                self._take(link, message)
            except RecordError as error:
                self._refuse(f"{link.value} link: {message}: {error}")

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

    def lost(self, why: str = GONE) -> None:
        """Tell everyone who waits that the brick is gone; what it does now nobody knows."""
        self._heard = MopsStream(self._refuse)
        try:
            waiting = self.record.unended()
        except RecordError as error:
            self._refuse(str(error))
            return
        for asked in waiting:
            refusal = refusal_of(asked.command, self.name, why)
            outputs = (Stage.FAILED.name, *refusal.outputs[1:])
            received = asked.replied is not None
            self._answer(asked, replace(refusal, outputs=outputs, received=received))

    def _take(self, link: Link, message: Message) -> None:
        if link is Link.DIRECT and message.source == self.name:
            self._report(message)
        elif message.dest != self.name:
            self._refuse(f"{link.value} link: {message} is for {message.dest}")
        elif link is Link.DIRECT and message.received:
            self._claim(replace(message, received=False))
        elif message.code == self.spelling.commands["stop"].code:
            self._stop(link, message)
        elif message.moe_inputs_id is None or not self._known(link, message):
            self._pass_on(Asked(message, (link,)))

    def _claim(self, command: Message) -> None:
        """The executive carries a command out; the relay may have been first."""
        if self.record.claim(command) is None:
            self.record.put(Claim(command))
        first = self.record.relayed(command)
        if first is not None and first.replied is not None:
            self._settle(first.replied)

    def _report(self, report: Message) -> None:
        """The executive reports on what it has claimed."""
        claim = self.record.claim(_command_of(report))
        if claim is not None:
            self.record.put(replace(claim, reported=report))
            if claim.wanted is not None:
                self._pass_back(report, claim.wanted)

    def _stop(self, link: Link, stop: Message) -> None:
        if not self._sent(Asked(stop, (link,))):
            return
        known = None if stop.moe_inputs_id is None else self.record.asked(stop)
        if known is None:
            self.record.remember(Asked(stop, (link,)))
        elif self._is_same(link, known.command, stop):
            self.record.remember(Asked(stop, _with(known.links, link)))

    def _known(self, link: Link, command: Message) -> bool:
        """Answer a command that has come before; return False for a new one."""
        relayed = self.record.relayed(command)
        claim = self.record.claim(command) if link is Link.RELAY and relayed is None else None
        if claim is not None:
            if self._is_same(link, claim.command, command):
                self.record.put(replace(claim, wanted=command))
                if claim.reported is not None:
                    self._pass_back(claim.reported, command)
            return True
        asked = self.record.asked(command)
        if link is Link.DIRECT and command.moe_inputs_counter is not None and asked is None:
            if relayed is not None and relayed.ended and relayed.replied is not None:
                self._settle(relayed.replied)
            return relayed is not None
        asked = asked or self.record.family(command)
        if asked is None:
            return False
        if self._is_same(link, asked.command, command):
            if link not in asked.links:
                asked = replace(asked, links=_with(asked.links, link))
                self.record.remember(asked)
            if asked.replied is not None:
                self._notify(link, asked.replied)
        return True

    def _is_same(self, link: Link, known: Message, command: Message) -> bool:
        """Return whether a number stands for what it stood for; tell the link if it does not."""
        if (known.code, known.inputs) == (command.code, command.inputs):
            self.counts.repeats += 1
            return True
        text = f"this number is that of another {known.command}"
        self._reject((link,), command, text, Reason.DUPLICATE)
        return False

    def _pass_on(self, asked: Asked) -> None:
        try:
            self.record.remember(asked)
        except RecordError as error:
            text = f"it cannot be written down: {error}"
            self._reject(asked.links, asked.command, text, Reason.LEDGER_FAILED)
            return
        if not self._sent(asked):
            self.record.forget(asked)

    def _sent(self, asked: Asked) -> bool:
        if self.exits.to_brick(encode(asked.command)):
            self.counts.commands += 1
            return True
        text = "the brick is not there or does not keep up"
        self._reject(asked.links, asked.command, text)
        return False

    def _reply(self, reply: Message) -> None:
        try:
            asked = self.record.asked(_command_of(reply))
        except RecordError as error:
            self._refuse(f"reply {reply}: {error}")
            return
        if asked is None or asked.command.code != reply.code:
            self.counts.unasked += 1
            for link in Link:
                self._notify(link, reply)
        elif asked.ended:
            self._refuse(f"the brick says {reply} after it had ended")
        else:
            self.counts.replies += 1
            self._answer(asked, reply)

    def _answer(self, asked: Asked, reply: Message) -> None:
        for link in asked.links:
            self._notify(link, reply)
        try:
            self.record.remember(replace(asked, replied=reply))
            claimed = Link.RELAY in asked.links and self.record.claim(asked.command) is not None
        except (MopsError, RecordError) as error:
            self._refuse(f"a reply to {asked.command} is not kept: {error}")
            return
        if claimed and Link.DIRECT not in asked.links:
            self._settle(reply)

    def _settle(self, reply: Message) -> None:
        """Tell the executive what became of a command that the relay had brought first."""
        self._notify(Link.DIRECT, replace(reply, moe_inputs_counter=None))

    def _pass_back(self, report: Message, wanted: Message) -> None:
        """Tell the relay what the executive reports."""
        counter = wanted.moe_inputs_counter
        outputs = report.outputs[:3]
        self._notify(Link.RELAY, replace(report, moe_inputs_counter=counter, outputs=outputs))

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


def _command_of(reply: Message) -> Message:
    """Return a message with the source and numbers of the command that a reply is on."""
    return replace(reply, source=reply.dest, dest=reply.source)


def _with(links: tuple[Link, ...], link: Link) -> tuple[Link, ...]:
    return links if link in links else (*links, link)
