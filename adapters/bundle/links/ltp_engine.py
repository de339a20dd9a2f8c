"""`LtpSpan`: LTP between two engines (RFC 5326, red part), driven by segments and time.

Checkpoints are retransmitted without limit. A block is reported complete only once it is stored.
"""

import zlib
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final, TypeVar, assert_never

from adapters.bundle.links.ltp_segment import (
    Cancel,
    CancelAck,
    CancelReason,
    Checkpoint,
    Data,
    ReceptionClaim,
    ReportAck,
    ReportSegment,
    Segment,
    SessionId,
)
from adapters.bundle.node.settings import LtpLink

BUNDLE_SERVICE: Final = 1  # LTP client service id of the Bundle Protocol
_MAX_CLAIMS: Final = 100
_MAX_IMPORTS: Final = 256  # this and the next four: chosen, not measured
_MAX_IMPORT_OCTETS: Final = 64 << 20
_MAX_ENDED_SESSIONS: Final = 1024
_REMEMBERED_ROUND_TRIPS: Final = 10
_MAX_RETRANSMISSIONS: Final = 5


class Ranges:
    """Set of half-open ranges [begin, end): sorted, disjoint and not adjacent."""

    def __init__(self) -> None:
        self._ranges: list[tuple[int, int]] = []

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(self._ranges)

    def add(self, begin: int, end: int) -> None:
        """Add a range; merge it with those that it touches."""
        apart = []
        for other_begin, other_end in self._ranges:
            if other_end < begin or other_begin > end:
                apart.append((other_begin, other_end))
            else:
                begin, end = min(begin, other_begin), max(end, other_end)
        if begin < end:
            apart.append((begin, end))
        self._ranges = sorted(apart)

    def remove(self, begin: int, end: int) -> None:
        """Remove a range."""
        remaining = []
        for other_begin, other_end in self._ranges:
            remaining.append((other_begin, min(other_end, begin)))
            remaining.append((max(other_begin, end), other_end))
        self._ranges = [(left, right) for left, right in remaining if left < right]

    def within(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Return the contained parts of a range."""
        cut = [(max(begin, left), min(end, right)) for left, right in self._ranges]
        return [(left, right) for left, right in cut if left < right]

    def gaps(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Return the missing parts of a range."""
        missing = []
        for left, right in self.within(begin, end):
            if begin < left:
                missing.append((begin, left))
            begin = right
        if begin < end:
            missing.append((begin, end))
        return missing

    def cover(self, begin: int, end: int) -> bool:
        """Return whether a range is fully contained."""
        return not self.gaps(begin, end)


class ExportSession:
    """Sends a block until reports have claimed all of it.

    A report replaces earlier claims within its scope. So a receiver that lost its state receives
    everything again.

    Attributes:
        done: whether all octets have been claimed.
        due_s: time of the next checkpoint retransmission; set by the span.
        resent: number of retransmitted segments.
        checkpoint_at_s: send time of the last checkpoint until repetition or answer; as `due_s`.
    """

    def __init__(
        self,
        session: SessionId,
        block: bytes,
        segment_octets: int,
        serial: int,
        send: Callable[[Data], None],
    ) -> None:
        self.done, self.due_s = False, 0.0
        self.resent = 0
        self.checkpoint_at_s: float | None = None
        self._session, self._block = session, block
        self._segment_octets, self._serial, self._send = segment_octets, serial, send
        self._claimed = Ranges()
        self._seen_reports: set[int] = set()
        self._last: Data | None = None
        self._send_gaps([(0, len(block))], 0)

    def on_report(self, report: ReportSegment) -> bool:
        """Process a report; return whether segments, including a checkpoint, were sent."""
        if report.serial in self._seen_reports or self.done:
            return False
        self._seen_reports.add(report.serial)
        upper = min(report.upper, len(self._block))
        self._claim(report.lower, upper, report.claims)
        self.done = self._claimed.cover(0, len(self._block))
        if self.done or self.is_answered_by(report):
            self._last = None
        if self.done:
            return False
        gaps = self._claimed.gaps(report.lower, upper)
        if not gaps and self._last is None:
            gaps = self._claimed.gaps(0, len(self._block))
        if gaps:
            self._send_gaps(gaps, report.serial)
        return bool(gaps)

    def is_answered_by(self, report: ReportSegment) -> bool:
        """Return whether a report answers the last checkpoint."""
        last = None if self._last is None else self._last.checkpoint
        return last is not None and last.serial == report.checkpoint_serial

    def resend_checkpoint(self) -> None:
        """Retransmit the unanswered checkpoint."""
        if self._last is not None:
            self.resent += 1
            self._send(self._last)

    def _claim(self, lower: int, upper: int, claims: tuple[ReceptionClaim, ...]) -> None:
        self._claimed.remove(lower, upper)
        for claim in claims:
            end = min(claim.offset + claim.length, len(self._block))
            self._claimed.add(claim.offset, end)

    def _send_gaps(self, gaps: list[tuple[int, int]], report_serial: int) -> None:
        size = self._segment_octets
        cut = [(at, min(at + size, end)) for begin, end in gaps for at in range(begin, end, size)]
        if report_serial:
            self.resent += len(cut)
        for begin, end in cut[:-1]:
            self._send(self._data(begin, end, None))
        checkpoint = Checkpoint(self._serial, report_serial)
        self._serial += 1
        self._last = self._data(*cut[-1], checkpoint)
        self._send(self._last)

    def _data(self, begin: int, end: int, checkpoint: Checkpoint | None) -> Data:
        ends = end == len(self._block) and checkpoint is not None
        octets = self._block[begin:end]
        return Data(self._session, BUNDLE_SERVICE, begin, octets, True, checkpoint, ends, ends)


class ImportStage(Enum):
    """State of a received block: octets are missing, it is being stored, it is stored."""

    GATHERING = 1
    STORING = 2
    STORED = 3


class ImportSession:
    """Assembles a received block and reports its octets.

    It is reported complete only after it is stored.

    Attributes:
        stage: state of the block.
        octets: octets held in memory.
        last_received_s: time of the last segment received.
    """

    def __init__(self, session: SessionId) -> None:
        self.stage = ImportStage.GATHERING
        self.octets = 0
        self.last_received_s = 0.0
        self._sums: dict[tuple[int, int], int] = {}
        self._end_serial: int | None = None
        self._session = session
        self._there = Ranges()
        self._parts: dict[int, bytes] = {}
        self._length: int | None = None
        self._checkpoint_serial = 0
        self._reach = 0
        self._serials = {0}

    def knows(self, data: Data) -> bool:
        """Return whether a segment responds to no report, or to one of this session.

        Reports sent before a loss of state claimed octets that are now missing. With new reports
        that omit some of them, the sender would treat the block as complete.
        """
        return data.checkpoint is None or data.checkpoint.report_serial in self._serials

    def contradicts(self, data: Data) -> bool:
        """Return whether a segment belongs to another block with the same session number.

        An engine that has restarted may number its sessions from the beginning. Its block then
        differs in the serial of the first checkpoint at the end, in its length, or in octets at
        the same offset.
        """
        end = data.offset + len(data.octets)
        if self._length is not None and (
            end > self._length or (data.ends_red and end != self._length)
        ):
            return True
        there = self._sums.get((data.offset, end))
        if there is not None and there != zlib.crc32(data.octets):
            return True
        return self._end_serial is not None and _end_serial(data) not in (None, self._end_serial)

    def add_segment(self, data: Data) -> bool:
        """Add a red segment; return whether it requests a report."""
        self._end_serial = _end_serial(data) or self._end_serial
        if self.stage is ImportStage.GATHERING:
            self._add_octets(data)
        if data.checkpoint is None:
            return False
        self._checkpoint_serial = data.checkpoint.serial
        self._reach = max(self._reach, data.offset + len(data.octets))
        return True

    def completed_block(self) -> bytes | None:
        """Return the block when it has just become complete, otherwise None."""
        if self.stage is not ImportStage.GATHERING or self._length is None:
            return None
        if not self._there.cover(0, self._length):
            return None
        self.stage = ImportStage.STORING
        block = bytearray()
        for offset, octets in sorted(self._parts.items()):
            block += octets[len(block) - offset :]
        return bytes(block[: self._length])

    def mark_stored(self) -> None:
        """Mark the block as stored, and free its octets."""
        self.stage = ImportStage.STORED
        self.octets = 0
        self._parts.clear()

    def report(self, serial: int) -> ReportSegment | None:
        """Return a report of the octets received; None if there is nothing to report."""
        if self.stage is ImportStage.STORING:
            return None
        there = self._there.within(0, self._reach)
        upper = self._reach if len(there) <= _MAX_CLAIMS else there[_MAX_CLAIMS - 1][1]
        claims = tuple(ReceptionClaim(begin, end - begin) for begin, end in there[:_MAX_CLAIMS])
        if not claims:
            return None
        self._serials.add(serial)
        return ReportSegment(self._session, serial, self._checkpoint_serial, upper, 0, claims)

    def _add_octets(self, data: Data) -> None:
        end = data.offset + len(data.octets)
        self._sums[data.offset, end] = zlib.crc32(data.octets)
        if data.ends_red:
            self._length = end
        if not self._there.cover(data.offset, end):
            held = self._parts.get(data.offset, b"")
            if len(data.octets) > len(held):
                self._parts[data.offset] = data.octets
                self.octets += len(data.octets) - len(held)
            self._there.add(data.offset, end)


def _end_serial(data: Data) -> int | None:
    """Return the serial of a segment that is a block's first checkpoint at its end, or None."""
    if data.checkpoint is None or not data.ends_red or data.checkpoint.report_serial:
        return None
    return data.checkpoint.serial


@dataclass(frozen=True, slots=True)
class ExportCompleted:
    """The peer engine has received a block of ours."""

    number: int


@dataclass(frozen=True, slots=True)
class ExportCancelled:
    """The peer engine has cancelled the reception of a block of ours."""

    number: int


@dataclass(frozen=True, slots=True)
class BlockReceived:
    """A complete block was received; it must be stored or refused."""

    number: int
    block: bytes


Event = ExportCompleted | ExportCancelled | BlockReceived


@dataclass(slots=True)
class _PendingReport:
    """A report that is not acknowledged yet."""

    report: ReportSegment
    due_s: float
    repeats: int = 0


class LtpSpan:
    """Exchange of blocks with one peer engine.

    Args:
        own: own engine number.
        other: engine number of the peer.
        link: sizes and times.
        next_number: returns session numbers that are never reused.
        now_s: returns monotonic time in seconds.
        first_serial: returns a random first serial number of a session, below 2^28.

    Attributes:
        light_time_s: one-way light time.
        suspended: whether there is no contact.
        round_trip_s: delay between the last checkpoint sent only once, and its report.
        segments: segments to send; the sender empties the list.
        events: pending events; the reader empties the list.
    """

    def __init__(
        self,
        own: int,
        other: int,
        link: LtpLink,
        next_number: Callable[[], int],
        now_s: Callable[[], float],
        first_serial: Callable[[], int],
    ) -> None:
        self.light_time_s = 0.0
        self.round_trip_s: float | None = None
        self._resent = 0
        self.segments: list[Segment] = []
        self.events: list[Event] = []
        self._own, self._other, self._link = own, other, link
        self._next_number, self._now_s, self._first_serial = next_number, now_s, first_serial
        self._exports: dict[int, ExportSession] = {}
        self._ended: OrderedDict[int, None] = OrderedDict()
        self._imports: OrderedDict[int, ImportSession] = OrderedDict()
        self._import_octets = 0
        self._stored: OrderedDict[int, ImportSession] = OrderedDict()
        self._refused: OrderedDict[int, float] = OrderedDict()
        self._pending_reports: dict[tuple[int, int], _PendingReport] = {}
        self._serial = first_serial()
        self.suspended = False

    @property
    def free_sessions(self) -> int:
        """Number of further blocks that may be in flight; negative if too many are."""
        return self._link.sessions - len(self._exports)

    @property
    def resent(self) -> int:
        """Number of retransmitted segments."""
        return self._resent + sum(export.resent for export in self._exports.values())

    def send(self, block: bytes) -> int:
        """Start sending a block; return its session number."""
        number = self._next_number()
        session = SessionId(self._own, number)
        serial = self._first_serial()
        export = ExportSession(
            session, block, self._link.segment_octets, serial, self.segments.append
        )
        self._exports[number] = export
        self._await_report(export)
        return number

    def owns(self, session: SessionId) -> bool:
        """Return whether this span recently started a session of our engine."""
        return session.number in self._exports or session.number in self._ended

    def receive(self, segment: Segment) -> None:
        """Process a segment from the peer engine."""
        number = segment.session.number
        match segment:
            case Data():
                if segment.red:
                    self._receive_data(number, segment)
            case ReportSegment():
                self.segments.append(ReportAck(segment.session, segment.serial))
                self._on_report(number, segment)
            case ReportAck():
                self._pending_reports.pop((number, segment.serial), None)
            case Cancel(by_sender=True):
                self.segments.append(CancelAck(segment.session, of_sender=True))
                known = self._imports.get(number)
                if known and known.stage is ImportStage.GATHERING:
                    self._drop(number)
            case Cancel():
                self.segments.append(CancelAck(segment.session, of_sender=False))
                if number in self._exports:
                    self._end(number)
                    self.events.append(ExportCancelled(number))
            case CancelAck():
                pass
            case _:
                assert_never(segment)

    def mark_stored(self, number: int) -> None:
        """Record that a received block is stored, and report it to the peer engine."""
        block = self._imports.pop(number)
        self._import_octets -= block.octets
        block.mark_stored()
        _remember(self._stored, number, block)
        self._report(number, block)

    def refuse(self, number: int) -> None:
        """Cancel the reception of a block, which cannot be stored now."""
        self._drop(number)
        _remember(self._refused, number, self._now_s())
        session = SessionId(self._other, number)
        self.segments.append(Cancel(session, by_sender=False, reason=CancelReason.SYSTEM))

    def suspend(self) -> None:
        """Suspend all timers, because there is no contact."""
        self.suspended = True

    def resume(self) -> None:
        """Resume the timers; everything unanswered is due at once."""
        self.suspended = False
        now_s = self._now_s()
        for waiting in self._waiting:
            waiting.due_s = now_s

    @property
    def next_s(self) -> float:
        """Monotonic due time of `tick`; infinity for never."""
        if self.suspended:
            return inf
        return min((waiting.due_s for waiting in self._waiting), default=inf)

    def tick(self) -> None:
        """Retransmit unanswered checkpoints and reports."""
        if self.suspended:
            return
        now_s = self._now_s()
        for export in self._exports.values():
            if export.due_s <= now_s:
                export.resend_checkpoint()
                export.checkpoint_at_s = None
                export.due_s = now_s + self._answer_s
        for key, pending in list(self._pending_reports.items()):
            if pending.due_s <= now_s:
                self._repeat(key, pending, now_s)

    @property
    def _waiting(self) -> list[ExportSession | _PendingReport]:
        """Exports and reports that await an answer."""
        return [*self._exports.values(), *self._pending_reports.values()]

    @property
    def _answer_s(self) -> float:
        return 2 * self.light_time_s + self._link.answer_s

    def _repeat(self, key: tuple[int, int], pending: _PendingReport, now_s: float) -> None:
        """Retransmit a report a few times; after that only a new checkpoint triggers one."""
        pending.repeats += 1
        if pending.repeats > _MAX_RETRANSMISSIONS:
            del self._pending_reports[key]
            return
        self.segments.append(pending.report)
        pending.due_s = now_s + self._answer_s

    def _await_report(self, export: ExportSession) -> None:
        export.checkpoint_at_s = self._now_s()
        export.due_s = export.checkpoint_at_s + self._answer_s

    def _on_report(self, number: int, report: ReportSegment) -> None:
        export = self._exports.get(number)
        if export is None:
            return
        if export.checkpoint_at_s is not None and export.is_answered_by(report):
            self.round_trip_s = self._now_s() - export.checkpoint_at_s
            export.checkpoint_at_s = None
        if export.on_report(report):
            self._await_report(export)
        if export.done:
            self._end(number)
            self.events.append(ExportCompleted(number))

    def _end(self, number: int) -> None:
        """Remember an ended session: its last report may be repeated and needs an answer."""
        self._resent += self._exports.pop(number).resent
        _remember(self._ended, number, None)

    def _receive_data(self, number: int, data: Data) -> None:
        now_s = self._now_s()
        self._forget_another(number, data, now_s)
        if (block := self._stored.get(number)) is not None:
            block.last_received_s = now_s
            if block.add_segment(data):
                self._report(number, block)
            return
        block = self._imports.get(number) or ImportSession(data.session)
        block.last_received_s = now_s
        if number in self._refused or not block.knows(data):
            if block.stage is ImportStage.GATHERING:
                self.refuse(number)
            return
        self._imports[number] = block
        self._imports.move_to_end(number)
        before = block.octets
        wanted = block.add_segment(data)
        self._import_octets += block.octets - before
        whole = block.completed_block()
        if whole is not None:
            self.events.append(BlockReceived(number, whole))
        elif wanted:
            self._report(number, block)
        self._limit_imports()

    def _forget_another(self, number: int, data: Data, now_s: float) -> None:
        """Drop earlier state of this number: it is old, or of an earlier run of the engine."""
        remembered_s = _REMEMBERED_ROUND_TRIPS * self._answer_s
        if now_s - self._refused.get(number, inf) > remembered_s:
            del self._refused[number]
        stored = self._stored.get(number)
        if stored and (stored.contradicts(data) or now_s - stored.last_received_s > remembered_s):
            del self._stored[number]
            self._forget_reports(number)
        gathering = self._imports.get(number)
        if gathering and gathering.stage is ImportStage.GATHERING and gathering.contradicts(data):
            self._drop(number)

    def _report(self, number: int, block: ImportSession) -> None:
        self._serial += 1
        report = block.report(self._serial)
        if report is None:
            return
        self._forget_reports(number)
        self._pending_reports[number, report.serial] = _PendingReport(
            report, self._now_s() + self._answer_s
        )
        self.segments.append(report)

    def _limit_imports(self) -> None:
        """Refuse incomplete blocks by age while count or octets exceed their limit."""
        while len(self._imports) > _MAX_IMPORTS or self._import_octets > _MAX_IMPORT_OCTETS:
            first = next(
                (
                    number
                    for number, block in self._imports.items()
                    if block.stage is ImportStage.GATHERING
                ),
                None,
            )
            if first is None:
                return
            self.refuse(first)

    def _drop(self, number: int) -> None:
        if block := self._imports.pop(number, None):
            self._import_octets -= block.octets
        self._forget_reports(number)

    def _forget_reports(self, number: int) -> None:
        for key in [key for key in self._pending_reports if key[0] == number]:
            del self._pending_reports[key]


_Value = TypeVar("_Value")


def _remember(memory: OrderedDict[int, _Value], number: int, value: _Value) -> None:
    memory[number] = value
    while len(memory) > _MAX_ENDED_SESSIONS:
        memory.popitem(last=False)
