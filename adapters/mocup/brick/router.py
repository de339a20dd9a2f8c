"""`Router` between both links and the brick: checks, records, forwards or refuses each message."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum, unique
from itertools import count
from typing import Final

from adapters.mocup.brick.camera_head_monitor import CameraHeadMonitor
from adapters.mocup.brick.ownership import (
    DISCONNECTED,
    HEARTBEAT_LOST,
    STOPPED,
    BrickQueue,
    Ownership,
)
from adapters.mocup.brick.record import BrickCommand, BrickLink, BrickRecord, ExecutiveClaim
from adapters.mocup.brick.replies import BrickReplies
from adapters.mocup.brick.reply_publisher import (
    ABSENT,
    ReplyPublisher,
    RouterCounts,
    RouterPorts,
)
from adapters.mops import (
    Dictionary,
    Message,
    MopsError,
    MopsStream,
    RelayAuthority,
    authority_of,
    conditions_of,
    encode,
    is_last,
    messages_in,
    refusal_of,
)
from executive.commands.intake import check_creation_time, check_lifetime
from executive.record import LedgerError
from executive.values.clock import Clock
from executive.values.reasons import Reason

AWAY: Final = "the brick is disconnected"
RESTARTED: Final = "rover-nxt was restarted: the result on the brick is unknown"
MAX_RESENT_REPLIES: Final = 50
"""Number of last replies that are resent to a new subscriber."""
UNKNOWN: Final = "its motion since the last contact is unknown"
SOURCE: Final = "NXT"
"""Source of the stops that this process itself sends to the brick."""
MAX_CLOCK_LEAD_S: Final = 10.0
"""Maximum lead of a command's creation time over this host's clock. Chosen, not measured."""
_NO_VISIT: Final = 0
_AUTHORITY_WAIT_POLLS: Final = 3
"""Polls after a start within which a running executive has published the authority."""
_LOG: Final = logging.getLogger(__name__)


@unique
class _Kind(Enum):
    """Type of a message from a link."""

    REPORT = "a report of the executive on a claimed command"
    CLAIM = "a claim of the executive"
    STOP = "a stop"
    AUTHORITY = "the authority, from the executive"
    COMMAND = "a command"
    OTHER_DESTINATION = "for another destination"
    NO_COMMAND = "not allowed from a link"


class Router:
    """Checks, records and forwards messages. Used by one thread.

    The sender of a repeated command receives the last reply again and all later ones. Only a stop
    is forwarded every time, and before it is recorded.

    Args:
        dictionary: decodes requests; gives the codes of telemetry and stop.
        name: name of the brick, as source or destination of messages.
        notify: called with one line for each message that is not forwarded.
        record: earlier commands, claims and authority.
        authority: authority for the relay's commands until the executive has published it.
        clock: clock of the lifetimes.

    Attributes:
        counts: counters for diagnostics.
        unconfirmed: replies to the relay that are not acknowledged, by fingerprint.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        name: str,
        ports: RouterPorts,
        notify: Callable[[str], None],
        record: BrickRecord,
        authority: RelayAuthority,
        clock: Clock,
    ) -> None:
        spelling = dictionary.spelling
        self.name = name
        self._clock = clock
        self.ports = ports
        self.record = record
        self.counts = RouterCounts()
        self._telemetry = spelling.telemetry.code
        self._keep_alive = spelling.keep_alive.code
        self._stop_code = spelling.commands["stop"]
        self._authority_code = spelling.authority.code
        self._granted = record.authority()
        self._authority = authority if self._granted is None else authority_of(self._granted)
        self._polls_to_wait = (
            _AUTHORITY_WAIT_POLLS if self._granted and self._authority.needed else 0
        )
        self._out = ReplyPublisher(name, ports, notify, self.counts)
        self.unconfirmed = self._out.unconfirmed
        self._ownership = Ownership(record, self._out)
        self._head = CameraHeadMonitor(dictionary, clock)
        self._replies = BrickReplies(
            record, self._out, self._ownership, self._head, self._stop_code
        )
        self._waiting = BrickQueue(
            record, self._out, self._ownership, self._send, self._reject, clock
        )
        self._visit = _NO_VISIT
        self._may_move = False
        self._silent: set[BrickLink] = set()
        self._overtaken = False
        self._numbers = count(round(clock.utc_s() * 1e6))
        self._brick_stream = MopsStream(self._out.refuse)
        self._link_streams = {link: MopsStream(self._out.refuse) for link in BrickLink}

    def is_stop(self, text: str) -> bool:
        """Return whether the messages of a text include a stop."""
        stops = f"{self._stop_code:03X}|" in text
        return stops and any(map(self._stops, messages_in(text, lambda _: None)))

    def process(self, link: BrickLink, text: str, overtaken: bool = False) -> bool:
        """Process whole messages from a link.

        Args:
            link: link that delivered them.
            text: the messages.
            overtaken: whether a later stop was processed first: they move nothing.

        Returns:
            Whether they were accepted. After a start the relay's messages, except stops, wait until
            an executive has published the authority, or is silent. Messages that cannot be recorded
            are not accepted either: the relay and the executive send them again, and a refusal
            that is not recorded would be followed by a second end.
        """
        if link is BrickLink.RELAY and self._polls_to_wait and not self.is_stop(text):
            return False
        self._silent.discard(link)
        self._overtaken = overtaken
        taken = True
        stream = self._link_streams[link]
        for message in stream.feed(text.encode("utf-8", "replace")):
            try:
                self._handle_message(link, message)
            except LedgerError as error:
                why, taken = f"it cannot be recorded: {error}", False
                if link is BrickLink.RELAY or message.received or self._stops(message):
                    self._out.refuse(f"{link.value} link: {message}: {why}")
                else:
                    self._out.reject((link,), message, why, Reason.LEDGER_FAILED)
        stream.cut()
        self._count_dropped()
        return taken

    def on_octets(self, octets: bytes) -> None:
        """Process octets from the brick, split at any position."""
        for message in self._brick_stream.feed(octets):
            if message.source != self.name:
                self._out.refuse(f"message {message} of the brick has the source {message.source}")
            elif message.code == self._telemetry:
                self.counts.telemetry += 1
                self.ports.publish_telemetry(message)
                if self._replies.on_telemetry(message):
                    self._send_next()
            elif message.code == self._keep_alive:
                self._out.refuse("the brick refuses KEEP_ALIVE: it does not stop by itself")
            else:
                self._replies.on_reply(message)
                if is_last(message):
                    self._send_next()
        self._count_dropped()

    def on_connected(self, visit: int) -> None:
        """Record that the brick is connected, with the number of the connection, from 1."""
        self._visit = visit
        if self._may_move:
            self._may_move = False
            self._halt(UNKNOWN)
        self._send_next()

    def on_disconnected(self, why: str = AWAY) -> None:
        """End all unanswered commands when the brick is disconnected; its motion is unknown.

        If it was connected before, queued commands end too; not after a restart of this process.
        """
        was_there, self._visit = self._visit != _NO_VISIT, _NO_VISIT
        self._brick_stream.cut()
        self._count_dropped()
        self._ownership.release()
        self._may_move = self._replies.on_disconnected(why) or self._may_move
        if was_there:
            self._waiting.end(DISCONNECTED)

    def on_host_silent(self, link: BrickLink) -> None:
        """Stop the brick if every sender of its unanswered commands is silent."""
        self._silent.add(link)
        cause = HEARTBEAT_LOST[link]
        if link is BrickLink.DIRECT:
            self._ownership.release()
        else:
            self._waiting.end(cause)
        with self._out.contained("the brick is stopped nevertheless"):
            owed = [
                each
                for each in self.record.unanswered()
                if each.links and not self._head.is_deferred(each.command)
            ]
            orphans = [each for each in owed if self._silent.issuperset(each.links)]
            if not orphans:
                self._send_next()
                return
            self._replies.set_cancel_cause(orphans, cause)
        self._halt(cause.text)

    def _halt(self, why: str) -> None:
        """Stop the brick without a command."""
        _LOG.warning("the brick is stopped: %s", why)
        self.counts.dead_man += 1
        code = self._stop_code
        stop = Message(code, SOURCE, self.name, "STOP", moe_inputs_id=next(self._numbers))
        if self._sent_stop(stop):
            with self._out.contained(f"{stop}"):
                self.record.save(BrickCommand(stop, ()))
                self._replies.expect((stop,))

    def poll(self) -> None:
        """Fail overdue commands and send queued ones; call about once a second."""
        self._replies.expire()
        self._polls_to_wait = max(self._polls_to_wait - 1, 0)
        self._send_next()

    def _send_next(self) -> None:
        self._waiting.send_next(self._visit != _NO_VISIT)

    def resend_last(self, link: BrickLink) -> None:
        """Resend the last replies to a link's commands, for a new subscriber."""
        with self._out.contained(f"{link.value} link: last replies are not resent"):
            for entry in self.record.latest(MAX_RESENT_REPLIES):
                if entry.replied is None:
                    continue
                if link in entry.links:
                    self._out.notify(link, entry.replied)
                elif link is BrickLink.DIRECT and (claim := self.record.claim(entry.command)):
                    self._ownership.relay_was_first(claim, entry)
            for claim in (
                self.record.claims_with_copy(MAX_RESENT_REPLIES) if link is BrickLink.RELAY else ()
            ):
                self._ownership.forward_to_relay(claim)

    def _handle_message(self, link: BrickLink, message: Message) -> None:
        match self._kind_of(link, message):
            case _Kind.REPORT:
                self._ownership.report(message)
                if is_last(message):
                    self._send_next()
            case _Kind.CLAIM:
                self._ownership.claim(replace(message, received=False))
            case _Kind.STOP:
                self._stop(link, message)
            case _Kind.AUTHORITY:
                self._learn(message)
            case _Kind.COMMAND:
                if message.moe_inputs_id is not None and self._answer_repeat(link, message):
                    return
                if link is BrickLink.DIRECT or self._authorize(message):
                    self._begin(link, message)
            case _Kind.OTHER_DESTINATION:
                self._out.refuse(f"{link.value} link: {message} is for {message.dest}")
            case _Kind.NO_COMMAND:
                self._out.refuse(f"{link.value} link: {message} is no command")

    def _kind_of(self, link: BrickLink, message: Message) -> _Kind:
        """Return the type of a message; the order matters, since a stop may match several."""
        direct = link is BrickLink.DIRECT
        if direct and message.source == self.name and message.outputs:
            return _Kind.REPORT
        if message.dest != self.name:
            return _Kind.OTHER_DESTINATION
        if direct and message.received and not message.outputs and not message.executed:
            return _Kind.CLAIM
        if self._stops(message):
            return _Kind.STOP
        if direct and message.code == self._authority_code:
            return _Kind.AUTHORITY
        answers = message.executed or message.received or (direct and message.outputs)
        if answers or message.code in (self._keep_alive, self._authority_code):
            return _Kind.NO_COMMAND
        return _Kind.COMMAND

    def _learn(self, message: Message) -> None:
        """Apply an authority message of the executive; it is valid until the next one."""
        try:
            self._authority, self._granted = authority_of(message), message
            self._polls_to_wait = 0
        except MopsError as fault:
            self._out.refuse(f"{message}: {fault}")
            return
        with self._out.contained("the authority is lost at a restart"):
            self.record.save_authority(message)

    def _authorize(self, command: Message) -> bool:
        """Return whether a command of the relay has authority and is in time; refuse it if not.

        A command under the orbiter's authority is reported to the executive: it renews the lease.
        """
        try:
            conditions = conditions_of(command)
        except MopsError as error:
            self._reject(BrickLink.RELAY, command, str(error))
            return False
        if conditions.precondition is not None:
            text = "the brick checks no preconditions: leave them out, or use the direct link"
            self._reject(BrickLink.RELAY, command, text, Reason.NOT_SUPPORTED)
            return False
        claimed = conditions.authority
        fault = self._authority.refusal_text(command.source, claimed)
        if fault:
            self._reject(BrickLink.RELAY, command, fault, Reason.NO_AUTHORITY)
            return False
        utc_s = self._clock.utc_s()
        late = check_creation_time(conditions, utc_s, MAX_CLOCK_LEAD_S) or check_lifetime(
            conditions, utc_s, utc_s
        )
        if late is not None:
            self._reject(BrickLink.RELAY, command, late.text, late.reason)
            return False
        if claimed is not None and self._granted is not None:
            grant = self._granted
            self._out.notify(BrickLink.DIRECT, replace(grant, source=grant.dest, dest=grant.source))
        return True

    def _begin(self, link: BrickLink, command: Message) -> None:
        """Forward a new command, or queue it if the brick is busy."""
        if self._overtaken or conditions_of(command).overtaken:
            reply = self._out.cancelled(command, STOPPED)
            if command.moe_inputs_id is not None:
                self.record.save(BrickCommand(command, (link,), reply))
            self._out.notify(link, reply)
            return
        if command.moe_inputs_id is None:
            self._pass_on(link, command)
            return
        if link is BrickLink.DIRECT:
            if not self._ownership.begin(command):
                return
        elif self._visit != _NO_VISIT and self._waiting.must_wait:
            self._waiting.put(command)
            return
        self._pass_on(link, command)

    def _pass_on(self, link: BrickLink, command: Message) -> None:
        entry = BrickCommand(command, (link,))
        if self._visit != _NO_VISIT:
            self.record.save(entry)
            if self._send(command):
                return
            if link is BrickLink.RELAY and command.moe_inputs_id is not None:
                self._replies.answer(entry, refusal_of(command, self.name, ABSENT))
                return
            self.record.forget(entry)
        self._reject(link, command, ABSENT)

    def _reject(
        self, link: BrickLink, command: Message, text: str, reason: Reason | None = None
    ) -> None:
        """Refuse a command; the relay's is recorded as ended, since it may be repeated."""
        if link is BrickLink.RELAY and command.moe_inputs_id is not None:
            refusal = refusal_of(command, self.name, text, reason)
            self.record.save(BrickCommand(command, (link,), refusal))
        self._out.reject((link,), command, text, reason)

    def _send(self, command: Message) -> bool:
        sent = self.ports.to_brick(encode(replace(command, outputs=())), self._visit)
        self.counts.commands += sent
        if sent:
            self._head.aim(command)
        return sent

    def _stops(self, message: Message) -> bool:
        """Return whether a message is a stop, and not a reply to one."""
        is_request = not message.outputs or message.source != self.name
        return message.code == self._stop_code and is_request and not message.executed

    def _sent_stop(self, stop: Message) -> bool:
        """Send a stop without inputs and outputs: the simplest form for any brick program."""
        sent = self.ports.stop_brick(encode(replace(stop, inputs=(), outputs=(), received=False)))
        self.counts.commands += sent
        if sent:
            self._replies.on_stop()
        return sent

    def _stop(self, link: BrickLink, stop: Message) -> None:
        sent = self._sent_stop(stop)
        if sent and link is BrickLink.RELAY:
            with self._out.contained(f"a part may follow {stop}"):
                self._ownership.stop(stop)
        self._ownership.release()
        self._waiting.end(STOPPED)
        self._record_stop(link, stop, sent)

    def _record_stop(self, link: BrickLink, stop: Message, sent: bool) -> None:
        """Record a stop that was sent, or refuse it; one that has ended keeps its last reply."""
        known = self._first_command(stop)
        if known is not None and not self._out.is_same(link, known.command, stop):
            return
        before = self.record.find(stop) if known else None
        if before is not None and before.ended:
            self._repeat(link, before)
        elif sent:
            links: Sequence[BrickLink] = () if before is None else before.links
            self.record.save(BrickCommand(stop, _with(links, link)))
        else:
            self._reject(link, stop, ABSENT)

    def _first_command(self, command: Message) -> ExecutiveClaim | BrickCommand | None:
        if command.moe_inputs_id is None:
            return None
        return self.record.claim(command) or self.record.find_first(command)

    def _answer_repeat(self, link: BrickLink, command: Message) -> bool:
        """Answer a command that was received before; return False for a new one."""
        first, family = self.record.find_from_relay(command), self.record.find_first(command)
        claim = self.record.claim(command)
        if link is BrickLink.DIRECT and command.moe_inputs_counter is not None:
            if first is not None:
                if self._ownership.relay_was_first(claim or ExecutiveClaim(first.command), first):
                    return True
                first = None
            family = self.record.find(command)
        elif link is BrickLink.RELAY and first is None and (claim or (family and family.is_part)):
            self._ownership.add_relay_copy(claim or ExecutiveClaim(command), command)
            return True
        entry = first or family
        if entry is None:
            return False
        if self._out.is_same(link, entry.command, command):
            self._repeat(link, entry)
        return True

    def _repeat(self, link: BrickLink, stored: BrickCommand) -> None:
        """Send a link the last reply again, and subscribe it to later replies."""
        if link not in stored.links:
            stored = replace(stored, links=_with(stored.links, link))
            self.record.save(stored)
        if stored.replied is not None:
            self._out.notify(link, stored.replied)

    def _count_dropped(self) -> None:
        streams = (self._brick_stream, *self._link_streams.values())
        self.counts.dropped_octets = sum(each.dropped_octets for each in streams)
        self.counts.dropped_pieces = sum(each.dropped_pieces for each in streams)


def _with(links: Sequence[BrickLink], link: BrickLink) -> tuple[BrickLink, ...]:
    return tuple(links) if link in links else (*links, link)
