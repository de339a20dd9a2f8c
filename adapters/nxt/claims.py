"""What the executive carries out, and the relay's copies of that."""

from dataclasses import replace

from adapters.mops.message import Message
from adapters.mops.reports import is_last
from adapters.nxt.record import Asked, Claim, Link, Record
from adapters.nxt.words import Words, command_of, same
from executive.reasons import Reason
from executive.reports import Stage

_Key = tuple[str, int | None]


class Claims:
    """Has one command done once where the executive does it in parts and the relay has it whole.

    Args:
        record: what was asked and claimed.
        words: tells links.

    Raises:
        RecordError: from every method that takes a message, if nothing can be read or written.
    """

    def __init__(self, record: Record, words: Words) -> None:
        """Know of nothing under way."""
        self._record = record
        self._words = words
        self._begun: set[_Key] = set()
        self._stopped: set[_Key] = set()

    @property
    def under_way(self) -> bool:
        """Whether the executive is amid what it claimed: between two parts the brick is its own."""
        return bool(self._begun)

    def let_go(self) -> None:
        """Keep nothing for the executive: all was stopped, or one of the two is gone."""
        self._begun.clear()

    def stop(self, stop: Message) -> None:
        """Tell the executive that the relay stops the brick, and so all that it has claimed."""
        self._words.notify(Link.DIRECT, self._words.reply(stop, Stage.STARTED))
        self._stopped = {_key(claim.command) for claim in self._record.unended_claims()}

    def begin(self, part: Message) -> bool:
        """The executive asks the brick for a part of what it may have claimed.

        Returns:
            Whether it may: not where the relay has stopped that meanwhile.
        """
        if _key(part) in self._stopped:
            text = "the relay has stopped it"
            reply = self._words.reply(part, Stage.CANCELLED, text, Reason.STOPPED)
            self._words.notify(Link.DIRECT, reply)
            return False
        claim = self._record.claim(part)
        if part.moe_inputs_counter is not None and claim is not None and not claim.ended:
            self._begun.add(_key(part))
        return True

    def claim(self, command: Message) -> None:
        """The executive carries a command out; the relay may have been first."""
        claim = self._record.claim(command)
        if claim is None or not same(claim.command, command):
            if claim is not None and claim.wanted is not None:
                self._words.is_same(Link.RELAY, command, claim.wanted)
            claim = Claim(command)
            self._record.put(claim)
        first = self._record.relayed(command)
        if first is not None:
            self.came_first(claim, first)

    def came_first(self, claim: Claim, first: Asked) -> bool:
        """Tell the executive what became of what it claims by the relay, which was first.

        What the brick refused or never had it has not done: the executive may, and the relay hears
        of it.

        Returns:
            Whether it is the relay's.
        """
        if not same(claim.command, first.command):
            text = f"this number is that of another {first.command.command}"
            self._words.reject((Link.DIRECT,), claim.command, text, Reason.DUPLICATE)
        elif first.refused or first.waits:
            self._record.put(replace(claim, wanted=first.command))
            self._record.forget(first)
            return False
        elif first.replied is not None:
            self._words.notify(Link.DIRECT, replace(first.replied, moe_inputs_counter=None))
        return True

    def report(self, report: Message) -> None:
        """The executive reports on what it has claimed."""
        if is_last(report):
            for known in (self._begun, self._stopped):
                known.discard(_key(command_of(report)))
        claim = self._record.claim(command_of(report))
        if claim is None or claim.ended:
            return
        claim = replace(claim, reported=report)
        self._record.put(claim)
        self.tell_relay(claim)

    def want(self, claim: Claim, command: Message) -> None:
        """The relay's copy of what the executive carries out."""
        if self._words.is_same(Link.RELAY, claim.command, command):
            claim = replace(claim, wanted=command)
            self._record.put(claim)
            self.tell_relay(claim)

    def tell_relay(self, claim: Claim) -> None:
        """Tell the relay what the executive reports, if both are there."""
        if claim.wanted is not None and claim.reported is not None:
            counter, outputs = claim.wanted.moe_inputs_counter, claim.reported.outputs[:3]
            told = replace(claim.reported, moe_inputs_counter=counter, outputs=outputs)
            self._words.notify(Link.RELAY, told)


def _key(command: Message) -> _Key:
    return command.source, command.moe_inputs_id
