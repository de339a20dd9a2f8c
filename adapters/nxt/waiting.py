"""What came by the relay while the brick was at work: kept in order until it has time."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from adapters.mops.message import Message, MopsError, encode
from adapters.nxt.claims import Claims
from adapters.nxt.record import Asked, Link, Record, RecordError
from adapters.nxt.words import Words, same
from executive.reasons import Reason
from executive.reports import Stage

MOST_WAITING: Final = 32


class Waiting:
    """Commands that are received and wait for the brick, on the disk.

    Args:
        record: where they stand.
        words: tells the relay.
        claims: what the executive carries out, for which they wait as well.
        send: sends the brick a command; returns False where it cannot.
    """

    def __init__(
        self, record: Record, words: Words, claims: Claims, send: Callable[[Message], bool]
    ) -> None:
        """Have what the record has."""
        self._record = record
        self._words = words
        self._claims = claims
        self._send = send
        self._stopped = False

    @property
    def must_wait(self) -> bool:
        """Whether the brick has no time for what comes now.

        Raises:
            RecordError: that cannot be read.
        """
        return self._at_work or bool(self._record.waiting())

    def put(self, command: Message) -> None:
        """Take a command in, or refuse it where too many wait.

        Raises:
            RecordError: it cannot be written down.
        """
        self._end_what_was_stopped()
        if len(self._record.waiting()) >= MOST_WAITING:
            text = f"BUSY: {MOST_WAITING} commands wait for the brick"
            self._words.reject((Link.RELAY,), command, text, Reason.QUEUE_FULL)
            return
        received = self._words.reply(command, Stage.RECEIVED)
        try:
            encode(self._stopped_reply(command))
        except MopsError as error:
            self._words.refuse(f"relay link: no reply fits to what would wait: {error}")
            return
        self._record.remember(Asked(command, (Link.RELAY,), received, waits=True))
        self._words.notify(Link.RELAY, received)

    def go_on(self, there: bool) -> None:
        """Send the brick what has waited longest, if it is there and has time."""
        try:
            self._end_what_was_stopped()
            waiting = self._record.waiting()
            if there and waiting and not self._at_work:
                self._send_first(waiting)
                waiting = self._record.waiting()
            self._words.counts.waiting = len(waiting)
        except RecordError as error:
            self._words.refuse(f"what waits goes on waiting: {error}")

    def stop(self) -> None:
        """End all that waits; as long as that cannot be written down, nothing of it is sent."""
        self._stopped = True
        try:
            self._end_what_was_stopped()
        except RecordError as error:
            self._words.refuse(f"what is stopped goes on waiting: {error}")

    @property
    def _at_work(self) -> bool:
        return self._claims.under_way or bool(self._record.owed())

    def _send_first(self, waiting: Sequence[Asked]) -> None:
        for asked in waiting:
            claim = self._record.claim(asked.command)
            if claim is not None and same(claim.command, asked.command):
                self._claims.came_first(claim, asked)
                continue
            self._record.remember(replace(asked, waits=False))
            if not self._send(asked.command):
                self._record.remember(asked)
            return

    def _end_what_was_stopped(self) -> None:
        if not self._stopped:
            return
        for asked in self._record.waiting():
            reply = self._stopped_reply(asked.command)
            self._record.remember(replace(asked, replied=reply, waits=False))
            for link in asked.links:
                self._words.notify(link, reply)
        self._stopped = False

    def _stopped_reply(self, command: Message) -> Message:
        text = "stopped before the brick had it"
        return self._words.reply(command, Stage.CANCELLED, text, Reason.STOPPED)
