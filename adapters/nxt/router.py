"""Whose message goes where: between two links and one brick (thesis 6.2). No ROS, no USB.

A command goes to the brick once, by whichever link it comes first, and its replies by every link
that sent it. Behind the direct link stands the executive: it claims each command that it carries
out, asks the brick for parts of it under the command's number with a counter, and reports on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from adapters.mops.dictionary import Spelling
from adapters.mops.message import Message, MopsError, encode
from adapters.mops.reports import is_last, refusal_of
from adapters.mops.stream import MopsStream, messages_in
from adapters.nxt.exits import Counts, Exits
from adapters.nxt.record import Asked, Claim, Link, Record, RecordError
from executive.reasons import Reason
from executive.reports import Stage

GONE: Final = "the brick is gone"
RESTARTED: Final = "rover-nxt was restarted: what the brick did meanwhile nobody knows"
TOLD_AGAIN: Final = 50
"""Commands whose last words are told again to who begins to listen."""
_ABSENT: Final = "the brick is not there or does not keep up"


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
                text = f"it cannot be written down: {error}"
                if message.received:
                    self._refuse(f"{link.value} link: {message}: {text}")
                else:
                    self._reject((link,), message, text, Reason.LEDGER_FAILED)

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

    def again(self, link: Link) -> None:
        """Tell a link the last words on its commands: who begins to listen may have missed them."""
        try:
            for asked in self.record.latest(TOLD_AGAIN):
                if asked.replied is None:
                    continue
                if link in asked.links:
                    self._notify(link, asked.replied)
                elif link is Link.DIRECT and (claim := self.record.claim(asked.command)):
                    self._came_first(claim, asked)
            for claim in self.record.wanted(TOLD_AGAIN) if link is Link.RELAY else ():
                self._tell_relay(claim)
        except RecordError as error:
            self._refuse(str(error))

    def _take(self, link: Link, message: Message) -> None:
        direct = link is Link.DIRECT
        if direct and message.source == self.name and message.outputs:
            self._report(message)
        elif message.dest != self.name:
            self._refuse(f"{link.value} link: {message} is for {message.dest}")
        elif message.outputs or message.executed or (message.received and not direct):
            self._refuse(f"{link.value} link: {message} is no command")
        elif message.received:
            self._claim(replace(message, received=False))
        elif message.code == self.spelling.commands["stop"].code:
            self._stop(link, message)
        elif message.moe_inputs_id is None or not self._known(link, message):
            self._pass_on(Asked(message, (link,)))

    def _claim(self, command: Message) -> None:
        """The executive carries a command out; the relay may have been first."""
        claim = self.record.claim(command)
        if claim is None or not _same(claim.command, command):
            if claim is not None and claim.wanted is not None:
                self._is_same(Link.RELAY, command, claim.wanted)
            claim = Claim(command)
            self.record.put(claim)
        first = self.record.relayed(command)
        if first is not None:
            self._came_first(claim, first)

    def _came_first(self, claim: Claim, first: Asked) -> bool:
        """Tell the executive what became of what it claims by the relay, which was first.

        What the brick refused it has not done: the executive may, and the relay hears of it.

        Returns:
            Whether it is the relay's.
        """
        if not _same(claim.command, first.command):
            text = f"this number is that of another {first.command.command}"
            self._reject((Link.DIRECT,), claim.command, text, Reason.DUPLICATE)
        elif first.refused:
            self.record.put(replace(claim, wanted=first.command))
            self.record.forget(first)
            return False
        elif first.replied is not None:
            self._notify(Link.DIRECT, replace(first.replied, moe_inputs_counter=None))
        return True

    def _report(self, report: Message) -> None:
        """The executive reports on what it has claimed."""
        claim = self.record.claim(_command_of(report))
        if claim is None or (claim.reported is not None and is_last(claim.reported)):
            return
        claim = replace(claim, reported=report)
        self.record.put(claim)
        self._tell_relay(claim)

    def _stop(self, link: Link, stop: Message) -> None:
        if not self._sent(stop):
            self._reject((link,), stop, _ABSENT)
            return
        try:
            known = self._first(stop)
            if known is None or self._is_same(link, known.command, stop):
                before = self.record.asked(stop) if known else None
                links = () if before is None else before.links
                self.record.remember(Asked(stop, _with(links, link)))
        except RecordError as error:
            self._refuse(f"{link.value} link: {stop}: {error}")

    def _first(self, command: Message) -> Claim | Asked | None:
        if command.moe_inputs_id is None:
            return None
        return self.record.claim(command) or self.record.family(command)

    def _known(self, link: Link, command: Message) -> bool:
        """Answer a command that has come before; return False for a new one."""
        first, family = self.record.relayed(command), self.record.family(command)
        claim = self.record.claim(command)
        if link is Link.DIRECT and command.moe_inputs_counter is not None:
            if first is not None:
                return self._came_first(claim or Claim(first.command), first)
            family = self.record.asked(command)
        elif link is Link.RELAY and first is None and (claim or (family and family.is_part)):
            self._want(claim or Claim(command), command)
            return True
        asked = first or family
        if asked is None:
            return False
        if self._is_same(link, asked.command, command):
            if link not in asked.links:
                asked = replace(asked, links=_with(asked.links, link))
                self.record.remember(asked)
            if asked.replied is not None:
                self._notify(link, asked.replied)
        return True

    def _want(self, claim: Claim, command: Message) -> None:
        """The relay's copy of what the executive carries out."""
        if self._is_same(Link.RELAY, claim.command, command):
            claim = replace(claim, wanted=command)
            self.record.put(claim)
            self._tell_relay(claim)

    def _is_same(self, link: Link, known: Message, command: Message) -> bool:
        """Return whether a number stands for what it stood for; tell the link if it does not."""
        if _same(known, command):
            self.counts.repeats += 1
            return True
        text = f"this number is that of another {known.command}"
        self._reject((link,), command, text, Reason.DUPLICATE)
        return False

    def _pass_on(self, asked: Asked) -> None:
        self.record.remember(asked)
        if not self._sent(asked.command):
            self.record.forget(asked)
            self._reject(asked.links, asked.command, _ABSENT)

    def _sent(self, command: Message) -> bool:
        sent = self.exits.to_brick(encode(command))
        self.counts.commands += sent
        return sent

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
        """Write a reply down, and then tell it: a last one is never taken back."""
        asked = replace(asked, replied=reply)
        try:
            self.record.remember(asked)
        except (MopsError, RecordError) as error:
            self._refuse(f"a reply to {asked.command} is not kept: {error}")
        for link in asked.links:
            self._notify(link, reply)
        if asked.links == (Link.RELAY,):
            try:
                claim = self.record.claim(asked.command)
                if claim is not None:
                    self._came_first(claim, asked)
            except RecordError as error:
                self._refuse(f"a reply to {asked.command} is not told: {error}")

    def _tell_relay(self, claim: Claim) -> None:
        """Tell the relay what the executive reports, if both are there."""
        if claim.wanted is not None and claim.reported is not None:
            counter, outputs = claim.wanted.moe_inputs_counter, claim.reported.outputs[:3]
            told = replace(claim.reported, moe_inputs_counter=counter, outputs=outputs)
            self._notify(Link.RELAY, told)

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


def _same(one: Message, other: Message) -> bool:
    return (one.code, one.inputs) == (other.code, other.inputs)


def _command_of(reply: Message) -> Message:
    """Return a message with the source and numbers of the command that a reply is on."""
    return replace(reply, source=reply.dest, dest=reply.source)


def _with(links: tuple[Link, ...], link: Link) -> tuple[Link, ...]:
    return links if link in links else (*links, link)
