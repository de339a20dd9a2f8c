"""`BrickReplies` records each reply of the brick, then sends it to every link of the command."""

from collections.abc import Sequence
from dataclasses import replace

from adapters.mocup.brick.camera_head_monitor import CameraHeadMonitor, PointingResult
from adapters.mocup.brick.ownership import Ownership
from adapters.mocup.brick.record import BrickCommand, BrickLink, BrickRecord
from adapters.mocup.brick.reply_publisher import CancelCause, ReplyPublisher, command_of
from adapters.mops import Message, MopsError, is_last
from executive.record import LedgerError
from executive.values.reasons import Reason
from executive.values.reports import Stage


class BrickReplies:
    """Records replies and forwards them to every link that sent the command.

    The relay receives EXECUTED for a camera command once telemetry confirms the angles.
    """

    def __init__(
        self,
        record: BrickRecord,
        out: ReplyPublisher,
        ownership: Ownership,
        head: CameraHeadMonitor,
        stop: int,
    ) -> None:
        self._record = record
        self._out = out
        self._ownership = ownership
        self._head = head
        self._stop = stop
        self._expected: Sequence[Message] = ()
        self._overdue: Sequence[Message] = ()
        self._causes: dict[Message, CancelCause] = {}
        self._stopped: Sequence[Message] = ()
        self._unrecorded: dict[Message, Message] = {}

    def on_reply(self, reply: Message) -> None:
        """Process a reply of the brick; one that answers no command goes to both links."""
        if reply.executed and reply.code == self._stop:
            self.expect(self._stopped)
            self._stopped = ()
        with self._out.contained(f"reply {reply}"):
            self._on_reply(self._record.find(command_of(reply)), reply)

    def _on_reply(self, stored: BrickCommand | None, reply: Message) -> None:
        if stored is None or stored.command.code != reply.code:
            self._out.counts.unsolicited += 1
            # The relay repeats a stop that could not be recorded until it is recorded.
            for link in (BrickLink.DIRECT,) if reply.code == self._stop else BrickLink:
                self._out.notify(link, reply)
        elif stored.ended and reply.code == self._stop:
            self._out.counts.replies += 1  # to a repeated stop
        elif stored.ended or stored.waits:
            when = "after it had ended" if stored.ended else "before it was sent"
            self._out.refuse(f"reply {reply} of the brick {when}")
        else:
            self._out.counts.replies += 1
            by_relay = BrickLink.RELAY in stored.links
            if reply.executed and by_relay and self._head.defer_reply(stored.command, reply):
                self.answer(stored, self._out.reply(stored.command, Stage.STARTED))
                return
            if is_last(reply):
                self._head.forget(stored.command)
            self.answer(stored, reply)

    def on_stop(self) -> None:
        """Record the commands that the present stop ends, or drops before they are sent."""
        with self._out.contained("commands that a stop ends"):
            self._stopped = [each.command for each in self._record.unanswered()]

    def on_disconnected(self, why: str) -> bool:
        """End all unanswered commands as failed.

        Returns:
            Whether there were any, so that the brick may be moving.
        """
        self._causes.clear()
        self._record_again()
        owed = True
        with self._out.contained("unanswered commands"):
            unanswered = self._record.unanswered()
            owed = not all(self._head.is_deferred(entry.command) for entry in unanswered)
            for entry in unanswered:
                reply = self._out.reply(entry.command, Stage.FAILED, why)
                self.answer(entry, replace(reply, received=entry.replied is not None))
        self._head.clear()
        return owed

    def on_telemetry(self, telemetry: Message) -> bool:
        """Process telemetry; return whether it shows that a command is executed."""
        pointed = self._head.on_telemetry(telemetry)
        self._end_pointing(pointed)
        return bool(pointed)

    def _end_pointing(self, pointed: Sequence[PointingResult]) -> None:
        for each in pointed:
            with self._out.contained(f"end of {each.command}"):
                entry = self._record.find(each.command)
                if entry is None or entry.ended:
                    continue
                reply, why = each.reply, Reason.PAN_TILT_DEADLINE
                if each.fault:
                    reply = self._out.reply(each.command, Stage.FAILED, each.fault, why)
                self.answer(entry, reply)

    def set_cancel_cause(self, commands: Sequence[BrickCommand], cause: CancelCause) -> None:
        """Set the cause to report when the brick reports these commands as cancelled."""
        self._causes |= {entry.command: cause for entry in commands}

    def expire(self) -> None:
        """Fail the commands without their expected reply after one or two polls."""
        self._record_again()
        overdue, self._overdue, self._expected = self._overdue, self._expected, ()
        with self._out.contained("unanswered commands"):
            for entry in [self._record.find(command) for command in overdue]:
                deferred = entry is not None and self._head.is_deferred(entry.command)
                if entry is not None and not entry.ended and not deferred:
                    text = "the brick was stopped and sent no final reply"
                    self.answer(entry, self._out.reply(entry.command, Stage.FAILED, text))
        self._end_pointing(self._head.overdue())

    def expect(self, commands: Sequence[Message]) -> None:
        """Expect final replies to these commands soon, as a stop ends all; they may be lost."""
        self._expected = (*self._expected, *commands)

    def _record_again(self) -> None:
        """Retry the replies that could not be recorded."""
        for command, reply in list(self._unrecorded.items()):
            with self._out.contained(f"a reply to {command}"):
                entry = self._record.find(command)
                if entry is not None:
                    self.answer(entry, reply)

    def answer(self, stored: BrickCommand, reply: Message) -> None:
        """Record a reply and then forward it, so that an end is never revoked.

        A final reply to the relay that cannot be recorded is forwarded once it is recorded.
        """
        reply = self._unrecorded.pop(stored.command, reply)
        cause = self._causes.pop(stored.command, None) if is_last(reply) else None
        if cause is not None and reply.outputs[:1] == (Stage.CANCELLED.name,):
            reply = self._out.cancelled(stored.command, cause)
        stored = replace(stored, replied=reply)
        try:
            self._record.save(stored)
        except (MopsError, LedgerError) as error:
            self._out.refuse(f"a reply to {stored.command} is not recorded: {error}")
            if stored.ended:
                self._unrecorded[stored.command] = reply
            if stored.ended and BrickLink.RELAY in stored.links:
                return
        for link in stored.links:
            self._out.notify(link, reply)
        if stored.links == (BrickLink.RELAY,):
            with self._out.contained(f"a reply to {stored.command} is not reported"):
                claim = self._record.claim(stored.command)
                if claim is not None:
                    self._ownership.relay_was_first(claim, stored)
