"""What becomes of what the brick was asked: its own replies, and what is told in its stead."""

from collections.abc import Sequence
from dataclasses import replace

from adapters.mops.message import Message, MopsError
from adapters.nxt.claims import Claims
from adapters.nxt.record import Asked, Link, Record, RecordError
from adapters.nxt.words import Words, command_of
from executive.reports import Stage


class Replies:
    """Writes replies down, and gives them to every link that sent the command.

    Args:
        record: what was asked.
        words: tells links.
        claims: hear what became of the relay's copies.
        stop: code of a stop.
    """

    def __init__(self, record: Record, words: Words, claims: Claims, stop: int) -> None:
        """Have no reply yet."""
        self._record = record
        self._words = words
        self._claims = claims
        self._stop = stop
        self._unsaid: Sequence[Message] = ()
        self._overdue: Sequence[Message] = ()

    def take(self, reply: Message) -> None:
        """Take what the brick says; what nobody asked for is for both links."""
        try:
            asked = self._record.asked(command_of(reply))
        except RecordError as error:
            self._words.refuse(f"reply {reply}: {error}")
            return
        if asked is None or asked.command.code != reply.code:
            self._words.counts.unasked += 1
            for link in Link:
                self._words.notify(link, reply)
        elif asked.ended or asked.waits:
            when = "after it had ended" if asked.ended else "before it was asked"
            self._words.refuse(f"the brick says {reply} {when}")
        else:
            self._words.counts.replies += 1
            self._answer(asked, reply)
            if reply.executed and reply.code == self._stop:
                self._expect_before(asked.command)

    def lost(self, why: str) -> None:
        """Tell everyone who waits for an answer that there is none."""
        try:
            owed = self._record.owed()
        except RecordError as error:
            self._words.refuse(str(error))
            return
        for asked in owed:
            received = asked.replied is not None
            reply = self._words.reply(asked.command, Stage.FAILED, why)
            self._answer(asked, replace(reply, received=received))

    def look(self) -> None:
        """End what the brick left unsaid for a look or two after it answered a later stop."""
        overdue, self._overdue, self._unsaid = self._overdue, self._unsaid, ()
        try:
            known = [self._record.asked(command) for command in overdue]
        except RecordError as error:
            self._words.refuse(str(error))
            return
        for asked in known:
            if asked is not None and not asked.ended:
                text = "the brick was stopped and did not say how this ended"
                self._answer(asked, self._words.reply(asked.command, Stage.FAILED, text))

    def _expect_before(self, stop: Message) -> None:
        """Expect at once what the brick owes for what a stop has ended; it may be lost."""
        try:
            owed = self._record.owed_before(stop)
        except RecordError as error:
            self._words.refuse(str(error))
        else:
            self._unsaid = (*self._unsaid, *(asked.command for asked in owed))

    def _answer(self, asked: Asked, reply: Message) -> None:
        """Write a reply down, and then tell it: a last one is never taken back."""
        asked = replace(asked, replied=reply)
        try:
            self._record.remember(asked)
        except (MopsError, RecordError) as error:
            self._words.refuse(f"a reply to {asked.command} is not kept: {error}")
        for link in asked.links:
            self._words.notify(link, reply)
        if asked.links == (Link.RELAY,):
            try:
                claim = self._record.claim(asked.command)
                if claim is not None:
                    self._claims.came_first(claim, asked)
            except RecordError as error:
                self._words.refuse(f"a reply to {asked.command} is not told: {error}")
