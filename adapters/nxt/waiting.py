"""What came by the relay while the brick was at work: kept in order until it has time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from adapters.mops.message import Message, MopsError, encode
from adapters.nxt.claims import Claims
from adapters.nxt.record import Asked, Link, Record, RecordError
from adapters.nxt.words import Words, same
from executive.reasons import Reason
from executive.reports import Stage

MOST_WAITING: Final = 32


@dataclass(frozen=True, slots=True)
class _End:
    """Why all that waits is not sent."""

    text: str
    reason: Reason | None = None


_STOPPED: Final = _End("stopped before the brick had it", Reason.STOPPED)
_GONE: Final = _End("the brick went away before it had it")


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
        self._ending: _End | None = None

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
        self._end_what_is_to_end()
        if len(self._record.waiting()) >= MOST_WAITING:
            text = f"BUSY: {MOST_WAITING} commands wait for the brick"
            self._words.reject((Link.RELAY,), command, text, Reason.QUEUE_FULL)
            return
        received = self._words.reply(command, Stage.RECEIVED)
        try:
            for end in (_STOPPED, _GONE):
                encode(self._end_of(command, end))
        except MopsError as error:
            self._words.refuse(f"relay link: no reply fits to what would wait: {error}")
            return
        self._record.remember(Asked(command, (Link.RELAY,), received, waits=True))
        self._words.notify(Link.RELAY, received)

    def go_on(self, there: bool) -> None:
        """Send the brick what has waited longest, if it is there and has time."""
        try:
            self._end_what_is_to_end()
            waiting = self._record.waiting()
            if there and waiting and not self._at_work:
                self._send_first(waiting)
                waiting = self._record.waiting()
            self._words.counts.waiting = len(waiting)
        except RecordError as error:
            self._words.refuse(f"what waits goes on waiting: {error}")

    def stop(self) -> None:
        """End all that waits; as long as that cannot be written down, nothing of it is sent."""
        self._end_all(_STOPPED)

    def lost(self) -> None:
        """End all that waits, as the brick is gone: when it is back, it is not to obey old ones."""
        self._end_all(_GONE)

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

    def _end_all(self, end: _End) -> None:
        self._ending = self._ending or end
        try:
            self._end_what_is_to_end()
        except RecordError as error:
            self._words.refuse(f"what is to end goes on waiting: {error}")

    def _end_what_is_to_end(self) -> None:
        if self._ending is None:
            return
        for asked in self._record.waiting():
            reply = self._end_of(asked.command, self._ending)
            self._record.remember(replace(asked, replied=reply, waits=False))
            for link in asked.links:
                self._words.notify(link, reply)
        self._ending = None

    def _end_of(self, command: Message, end: _End) -> Message:
        return self._words.reply(command, Stage.CANCELLED, end.text, end.reason)
