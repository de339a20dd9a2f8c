"""Who owns the brick: the executive's claims, and the relay's commands that wait for it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from adapters.mocup.brick.record import BrickCommand, BrickLink, BrickRecord, ExecutiveClaim
from adapters.mocup.brick.replies_out import CancelCause, ReplyPublisher, command_of, same
from adapters.mops import Message, MopsError, conditions_of, encode, is_last
from executive.commands.intake import expired
from executive.values.clock import Clock
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Stage

_Key = tuple[str, int | None]


class Ownership:
    """The executive's claims: a command that it carries out in parts is not done for the relay too.

    Raises:
        LedgerError: from every method that takes a message, if nothing can be read or written.
    """

    def __init__(self, record: BrickRecord, out: ReplyPublisher) -> None:
        self._record = record
        self._out = out
        self._begun: set[_Key] = set()
        self._stopped: set[_Key] = set()

    @property
    def executive_busy(self) -> bool:
        """Whether the executive is amid a claimed command, so that the brick is its own."""
        return bool(self._begun)

    def release(self) -> None:
        """Keep the brick for the executive no longer: all was stopped, or one of them is gone."""
        self._begun.clear()

    def stop(self, stop: Message) -> None:
        """Notify the executive of a stop by the relay, which ends all that it has claimed."""
        self._out.notify(BrickLink.DIRECT, self._out.reply(stop, Stage.STARTED))
        self._stopped = {_key(claim.command) for claim in self._record.unended_claims()}

    def begin(self, part: Message) -> bool:
        """Begin a part of a command for the executive.

        Returns:
            Whether it may: not where the relay has stopped that meanwhile.
        """
        if _key(part) in self._stopped:
            self._out.notify(BrickLink.DIRECT, self._out.cancelled(part, _BY_RELAY))
            return False
        claim = self._record.claim(part)
        if part.moe_inputs_counter is not None and claim is not None and not claim.ended:
            self._begun.add(_key(part))
        return True

    def claim(self, command: Message) -> None:
        """Record that the executive carries a command out; the relay may have been first."""
        claim = self._record.claim(command)
        if claim is None or not same(claim.command, command):
            if claim is not None and claim.wanted is not None:
                self._out.is_same(BrickLink.RELAY, command, claim.wanted)
            claim = ExecutiveClaim(command)
            self._record.save_claim(claim)
        first = self._record.asked_by_relay(command)
        if first is not None:
            self.relay_was_first(claim, first)

    def relay_was_first(self, claim: ExecutiveClaim, first: BrickCommand) -> bool:
        """Tell the executive what became of a claimed command that the relay brought first.

        What the brick refused or never had it has not done: the executive may. The relay receives
        its reports, unless it had the refusal.

        Returns:
            Whether it is the relay's.
        """
        if not same(claim.command, first.command):
            text = f"this number is that of another {first.command.command}"
            self._out.reject((BrickLink.DIRECT,), claim.command, text, Reason.DUPLICATE)
        elif first.refused:
            if first.command.moe_inputs_counter is not None:  # a part may have that counter
                plain = replace(first.command, moe_inputs_counter=None)
                self._record.save(replace(first, command=plain), instead=first)
            return False
        elif first.waits:
            self._record.save_claim(replace(claim, wanted=first.command), instead=first)
            return False
        elif first.replied is not None:
            self._out.notify(BrickLink.DIRECT, replace(first.replied, moe_inputs_counter=None))
        return True

    def report(self, report: Message) -> None:
        """Record a report of the executive on a claimed command, and pass it to the relay."""
        if is_last(report):
            for known in (self._begun, self._stopped):
                known.discard(_key(command_of(report)))
        claim = self._record.claim(command_of(report))
        if claim is None or claim.ended:
            return
        claim = replace(claim, reported=report)
        self._record.save_claim(claim)
        self.tell_relay(claim)

    def add_relay_copy(self, claim: ExecutiveClaim, command: Message) -> None:
        """Record the relay's copy of a claimed command, so that the relay hears of it."""
        if self._out.is_same(BrickLink.RELAY, claim.command, command):
            claim = replace(claim, wanted=command)
            self._record.save_claim(claim)
            self.tell_relay(claim)

    def tell_relay(self, claim: ExecutiveClaim) -> None:
        """Pass the executive's last report to the relay, if there are both a report and a copy."""
        if claim.wanted is not None and claim.reported is not None:
            counter, outputs = claim.wanted.moe_inputs_counter, claim.reported.outputs[:3]
            told = replace(claim.reported, moe_inputs_counter=counter, outputs=outputs)
            self._out.notify(BrickLink.RELAY, told)


def _key(command: Message) -> _Key:
    return command.source, command.moe_inputs_id


MOST_WAITING: Final = 32
SILENT_S: Final = 0.5
"""Whatever moves is stopped when who has moved it was not heard for so long."""


STOPPED: Final = CancelCause("stopped before the brick had it", Reason.STOPPED)
GONE: Final = CancelCause("the brick went away before it had it")
SILENT: Final = {
    BrickLink.DIRECT: CancelCause(
        f"the executive was silent for {SILENT_S:g} s", Reason.INTERRUPTED
    ),
    BrickLink.RELAY: CancelCause(f"rover-relay was silent for {SILENT_S:g} s", Reason.INTERRUPTED),
}
"""Why what came by a link ends when who sends by it is gone."""
_BY_RELAY: Final = CancelCause("the relay has stopped it", Reason.STOPPED)
_CAUSES: Final = (STOPPED, GONE, *SILENT.values())


class BrickQueue:
    """Commands that are received and wait for the brick, on the disk.

    They wait for what the executive carries out as well, and no longer than they live.

    Args:
        send: sends the brick a command; returns False where it cannot.
        reject: refuses a command of a link.
        clock: for their lifetimes.
    """

    def __init__(
        self,
        record: BrickRecord,
        out: ReplyPublisher,
        ownership: Ownership,
        send: Callable[[Message], bool],
        reject: Callable[[BrickLink, Message, str, Reason], None],
        clock: Clock,
    ) -> None:
        self._record = record
        self._out = out
        self._ownership = ownership
        self._send, self._reject = send, reject
        self._clock = clock
        self._arrived: dict[_Key, tuple[float, float]] = {}
        self._ending: CancelCause | None = None

    @property
    def must_wait(self) -> bool:
        """Whether the brick has no time for what comes now.

        Raises:
            LedgerError: that cannot be read.
        """
        return self._at_work or bool(self._record.waiting())

    def put(self, command: Message) -> None:
        """Take a command in, or refuse it where too many wait.

        Raises:
            LedgerError: it cannot be written down.
        """
        self._end_what_is_to_end()
        if len(self._record.waiting()) >= MOST_WAITING:
            text = f"BUSY: {MOST_WAITING} commands wait for the brick"
            self._reject(BrickLink.RELAY, command, text, Reason.QUEUE_FULL)
            return
        received = self._out.reply(command, Stage.RECEIVED)
        try:
            for cause in _CAUSES:
                encode(self._out.cancelled(command, cause))
        except MopsError as error:
            self._out.refuse(f"relay link: no reply fits to what would wait: {error}")
            return
        self._record.save(BrickCommand(command, (BrickLink.RELAY,), received, waits=True))
        self._arrived[_key(command)] = (self._clock.utc_s(), self._clock.now_s())
        self._out.notify(BrickLink.RELAY, received)

    def go_on(self, there: bool) -> None:
        """Send the brick what has waited longest, if it is there and has time."""
        with self._out.contained("what waits goes on waiting"):
            self._end_what_is_to_end()
            waiting = self._record.waiting()
            if there and waiting and not self._at_work:
                self._send_first(waiting)
                waiting = self._record.waiting()
            self._out.counts.waiting = len(waiting)
            if not waiting:
                self._arrived.clear()

    def end(self, cause: CancelCause) -> None:
        """End all that waits; as long as that cannot be written down, nothing of it is sent."""
        self._ending = self._ending or cause
        with self._out.contained("what is to end goes on waiting"):
            self._end_what_is_to_end()

    @property
    def _at_work(self) -> bool:
        return self._ownership.executive_busy or bool(self._record.unanswered())

    def _send_first(self, waiting: Sequence[BrickCommand]) -> None:
        for asked in waiting:
            claim = self._record.claim(asked.command)
            if claim is not None and same(claim.command, asked.command):
                self._ownership.relay_was_first(claim, asked)
                continue
            late = self._late(asked.command)
            if late is not None:
                reply = self._out.reply(asked.command, Stage.EXPIRED, late.text, late.reason)
                self._record.save(replace(asked, replied=reply, waits=False))
                for link in asked.links:
                    self._out.notify(link, reply)
                continue
            self._record.save(replace(asked, waits=False))
            if not self._send(asked.command):
                self._record.save(asked)
            return

    def _late(self, command: Message) -> Refusal | None:
        """Return why it is too late for a command, or None; after a restart by UTC alone."""
        utc_s, now_s = self._clock.utc_s(), self._clock.now_s()
        arrived_utc_s, arrived_s = self._arrived.get(_key(command), (utc_s, now_s))
        return expired(conditions_of(command), utc_s, arrived_utc_s, now_s - arrived_s)

    def _end_what_is_to_end(self) -> None:
        if self._ending is None:
            return
        for asked in self._record.waiting():
            reply = self._out.cancelled(asked.command, self._ending)
            self._record.save(replace(asked, replied=reply, waits=False))
            for link in asked.links:
                self._out.notify(link, reply)
        self._ending = None
