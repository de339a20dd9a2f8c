"""`Ownership`: which commands the executive claims; `BrickQueue`: the relay's waiting commands."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from adapters.mocup.brick.record import BrickCommand, BrickLink, BrickRecord, ExecutiveClaim
from adapters.mocup.brick.reply_publisher import CancelCause, ReplyPublisher, command_of, same
from adapters.mops import Message, MopsError, conditions_of, encode, is_last
from executive.commands.intake import check_lifetime
from executive.values.clock import Clock
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Stage

_Key = tuple[str, int | None]


class Ownership:
    """The executive's claims: prevent a second execution of claimed commands for the relay.

    Raises:
        LedgerError: from every method with a message, if the record cannot be read or written.
    """

    def __init__(self, record: BrickRecord, out: ReplyPublisher) -> None:
        self._record = record
        self._out = out
        self._begun: set[_Key] = set()
        self._stopped: set[_Key] = set()

    @property
    def executive_busy(self) -> bool:
        """Whether the executive is executing a claimed command, which reserves the brick."""
        return bool(self._begun)

    def release(self) -> None:
        """End the executive's reservation of the brick, after a stop or the loss of either side."""
        self._begun.clear()

    def stop(self, stop: Message) -> None:
        """Notify the executive of a stop over the relay, which ends all claimed commands."""
        self._out.notify(BrickLink.DIRECT, self._out.reply(stop, Stage.STARTED))
        self._stopped = {_key(claim.command) for claim in self._record.unended_claims()}

    def begin(self, part: Message) -> bool:
        """Begin a part of a command for the executive; return False if the relay stopped it."""
        if _key(part) in self._stopped:
            self._out.notify(BrickLink.DIRECT, self._out.cancelled(part, _BY_RELAY))
            return False
        claim = self._record.claim(part)
        if part.moe_inputs_counter is not None and claim is not None and not claim.ended:
            self._begun.add(_key(part))
        return True

    def claim(self, command: Message) -> None:
        """Record that the executive carries out a command; the relay may have sent it earlier."""
        claim = self._record.claim(command)
        if claim is None or not same(claim.command, command):
            if claim is not None and claim.wanted is not None:
                self._out.is_same(BrickLink.RELAY, command, claim.wanted)
            claim = ExecutiveClaim(command)
            self._record.save_claim(claim)
        first = self._record.find_from_relay(command)
        if first is not None:
            self.relay_was_first(claim, first)

    def relay_was_first(self, claim: ExecutiveClaim, first: BrickCommand) -> bool:
        """Notify the executive of the result of a claimed command that the relay sent first.

        A command that the brick refused or never received is not executed: the executive may
        execute it. The relay then receives the executive's reports, unless it has the refusal.

        Returns:
            Whether the command belongs to the relay.
        """
        if not same(claim.command, first.command):
            text = f"this number is used by another {first.command.command}"
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
        """Record a report of the executive on a claimed command, and forward it to the relay."""
        if is_last(report):
            for known in (self._begun, self._stopped):
                known.discard(_key(command_of(report)))
        claim = self._record.claim(command_of(report))
        if claim is None or claim.ended:
            return
        claim = replace(claim, reported=report)
        self._record.save_claim(claim)
        self.forward_to_relay(claim)

    def add_relay_copy(self, claim: ExecutiveClaim, command: Message) -> None:
        """Record the relay's copy of a claimed command, so that the relay receives its reports."""
        if self._out.is_same(BrickLink.RELAY, claim.command, command):
            claim = replace(claim, wanted=command)
            self._record.save_claim(claim)
            self.forward_to_relay(claim)

    def forward_to_relay(self, claim: ExecutiveClaim) -> None:
        """Forward the executive's last report to the relay, if a report and a copy exist."""
        if claim.wanted is not None and claim.reported is not None:
            counter, outputs = claim.wanted.moe_inputs_counter, claim.reported.outputs[:3]
            reply = replace(claim.reported, moe_inputs_counter=counter, outputs=outputs)
            self._out.notify(BrickLink.RELAY, reply)


def _key(command: Message) -> _Key:
    return command.source, command.moe_inputs_id


MAX_QUEUED: Final = 32
HEARTBEAT_TIMEOUT_S: Final = 0.5
"""Heartbeat timeout of the commanding process; then the brick stops. Chosen, not measured."""


STOPPED: Final = CancelCause("stopped before it reached the brick", Reason.STOPPED)
DISCONNECTED: Final = CancelCause("the brick disconnected before it was sent")
HEARTBEAT_LOST: Final = {
    BrickLink.DIRECT: CancelCause(
        f"no heartbeat of the executive for {HEARTBEAT_TIMEOUT_S:g} s", Reason.INTERRUPTED
    ),
    BrickLink.RELAY: CancelCause(
        f"no heartbeat of rover-relay for {HEARTBEAT_TIMEOUT_S:g} s", Reason.INTERRUPTED
    ),
}
"""Cause of the end of a link's commands when its sender is silent."""
_BY_RELAY: Final = CancelCause("stopped over the relay", Reason.STOPPED)
_CAUSES: Final = (STOPPED, DISCONNECTED, *HEARTBEAT_LOST.values())


class BrickQueue:
    """Received commands that wait for the brick, stored on disk.

    They also wait while the executive reserves the brick, and expire with their lifetime.

    Args:
        send: sends a command to the brick; returns False if it cannot.
        reject: refuses a command of a link.
        clock: clock of the lifetimes.
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
        """Whether the brick is busy, so that new commands are queued.

        Raises:
            LedgerError: the record cannot be read.
        """
        return self._at_work or bool(self._record.waiting())

    def put(self, command: Message) -> None:
        """Add a command, or refuse it if the queue is full.

        Raises:
            LedgerError: the command cannot be recorded.
        """
        self._end_pending()
        if len(self._record.waiting()) >= MAX_QUEUED:
            text = f"BUSY: {MAX_QUEUED} commands are queued"
            self._reject(BrickLink.RELAY, command, text, Reason.QUEUE_FULL)
            return
        received = self._out.reply(command, Stage.RECEIVED)
        try:
            for cause in _CAUSES:
                encode(self._out.cancelled(command, cause))
        except MopsError as error:
            self._out.refuse(f"relay link: not queued, the reply would be too long: {error}")
            return
        self._record.save(BrickCommand(command, (BrickLink.RELAY,), received, waits=True))
        self._arrived[_key(command)] = (self._clock.utc_s(), self._clock.now_s())
        self._out.notify(BrickLink.RELAY, received)

    def send_next(self, there: bool) -> None:
        """Send the first queued command to the brick, if it is connected and idle."""
        with self._out.contained("queued commands stay queued"):
            self._end_pending()
            waiting = self._record.waiting()
            if there and waiting and not self._at_work:
                self._send_first(waiting)
                waiting = self._record.waiting()
            self._out.counts.queued = len(waiting)
            if not waiting:
                self._arrived.clear()

    def end(self, cause: CancelCause) -> None:
        """End all queued commands; until that is recorded, none of them is sent."""
        self._ending = self._ending or cause
        with self._out.contained("commands to cancel stay queued"):
            self._end_pending()

    @property
    def _at_work(self) -> bool:
        return self._ownership.executive_busy or bool(self._record.unanswered())

    def _send_first(self, waiting: Sequence[BrickCommand]) -> None:
        for queued in waiting:
            claim = self._record.claim(queued.command)
            if claim is not None and same(claim.command, queued.command):
                self._ownership.relay_was_first(claim, queued)
                continue
            late = self._late(queued.command)
            if late is not None:
                reply = self._out.reply(queued.command, Stage.EXPIRED, late.text, late.reason)
                self._record.save(replace(queued, replied=reply, waits=False))
                for link in queued.links:
                    self._out.notify(link, reply)
                continue
            self._record.save(replace(queued, waits=False))
            if not self._send(queued.command):
                self._record.save(queued)
            return

    def _late(self, command: Message) -> Refusal | None:
        """Return the refusal of an expired command, or None; after a restart by UTC alone."""
        utc_s, now_s = self._clock.utc_s(), self._clock.now_s()
        arrived_utc_s, arrived_s = self._arrived.get(_key(command), (utc_s, now_s))
        return check_lifetime(conditions_of(command), utc_s, arrived_utc_s, now_s - arrived_s)

    def _end_pending(self) -> None:
        if self._ending is None:
            return
        for queued in self._record.waiting():
            reply = self._out.cancelled(queued.command, self._ending)
            self._record.save(replace(queued, replied=reply, waits=False))
            for link in queued.links:
                self._out.notify(link, reply)
        self._ending = None
