"""An LTP engine's side of the link to one other engine (RFC 5326, red), fed with segments and time.

Checkpoints are repeated for as long as it takes; a block is reported whole only when whoever took
it says that it is stored.
"""

import random
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeVar, assert_never

from adapters.bundle.ltp_export import Export
from adapters.bundle.ltp_import import Import, Stage
from adapters.bundle.ltp_segment import (
    Cancel,
    CancelAck,
    CancelReason,
    Data,
    Report,
    ReportAck,
    Segment,
    SessionId,
)
from adapters.bundle.settings import LtpLink

_MOST_IMPORTS: Final = 256
_MOST_IMPORT_OCTETS: Final = 64 << 20
_REMEMBERED: Final = 1024
_MOST_REPEATS: Final = 5
_SERIALS: Final = 1 << 28


@dataclass(frozen=True, slots=True)
class Completed:
    """The other engine has a block of ours."""

    number: int


@dataclass(frozen=True, slots=True)
class Cancelled:
    """The other engine does not want a block of ours now."""

    number: int


@dataclass(frozen=True, slots=True)
class Arrived:
    """A block has come, to be stored or refused."""

    number: int
    block: bytes


Event = Completed | Cancelled | Arrived


@dataclass(slots=True)
class _Told:
    """A report that was not acknowledged yet."""

    report: Report
    due_s: float
    repeats: int = 0


class LtpSpan:
    """Blocks to and from one other engine.

    Args:
        own: number of our engine.
        other: number of the other engine.
        link: sizes and times.
        next_number: gives session numbers, never one twice.
        now_s: monotonic time.

    Attributes:
        light_time_s: how long a signal takes one way.
        segments: what is to be sent; whoever sends it empties it.
        events: what has happened; whoever reads it empties it.
    """

    def __init__(
        self,
        own: int,
        other: int,
        link: LtpLink,
        next_number: Callable[[], int],
        now_s: Callable[[], float],
    ) -> None:
        """Begin without blocks."""
        self.light_time_s = 0.0
        self.segments: list[Segment] = []
        self.events: list[Event] = []
        self._own, self._other, self._link = own, other, link
        self._next_number, self._now_s = next_number, now_s
        self._exports: dict[int, Export] = {}
        self._ended: OrderedDict[int, None] = OrderedDict()
        self._due_s: dict[int, float] = {}
        self._imports: OrderedDict[int, Import] = OrderedDict()
        self._import_octets = 0
        self._stored: OrderedDict[int, Import] = OrderedDict()
        self._refused: OrderedDict[int, None] = OrderedDict()
        self._told: dict[tuple[int, int], _Told] = {}
        self._serial = random.randrange(1, _SERIALS)
        self._suspended = False

    @property
    def room(self) -> int:
        """How many blocks may be sent now."""
        return 0 if self._suspended else self._link.sessions - len(self._exports)

    def send(self, block: bytes) -> int:
        """Send a block; return the number of its session."""
        number = self._next_number()
        session = SessionId(self._own, number)
        serial = random.randrange(1, _SERIALS)
        export = Export(session, block, self._link.segment_octets, serial, self.segments.append)
        self._exports[number] = export
        self._due_s[number] = self._now_s() + self._answer_s
        return number

    def owns(self, session: SessionId) -> bool:
        """Return whether this span has begun a session of our engine, not too long ago."""
        return session.number in self._exports or session.number in self._ended

    def receive(self, segment: Segment) -> None:
        """Take a segment from the other engine."""
        number = segment.session.number
        match segment:
            case Data():
                if segment.red:
                    self._take(number, segment)
            case Report():
                self.segments.append(ReportAck(segment.session, segment.serial))
                self._hear(number, segment)
            case ReportAck():
                self._told.pop((number, segment.serial), None)
            case Cancel(by_sender=True):
                self.segments.append(CancelAck(segment.session, of_sender=True))
                known = self._imports.get(number)
                if known and known.stage is Stage.GATHERING:
                    self._drop(number)
            case Cancel():
                self.segments.append(CancelAck(segment.session, of_sender=False))
                if number in self._exports:
                    self._end(number)
                    self.events.append(Cancelled(number))
            case CancelAck():
                pass
            case _:
                assert_never(segment)

    def stored(self, number: int) -> None:
        """Note that a block that has arrived is stored, and tell the other engine."""
        block = self._imports.pop(number)
        self._import_octets -= block.octets
        block.stored()
        _remember(self._stored, number, block)
        self._report(number, block)

    def refuse(self, number: int) -> None:
        """Tell the other engine that a block is not wanted now."""
        self._drop(number)
        _remember(self._refused, number, None)
        session = SessionId(self._other, number)
        self.segments.append(Cancel(session, by_sender=False, reason=CancelReason.SYSTEM))

    def suspend(self) -> None:
        """Let no time pass: there is no contact."""
        self._suspended = True

    def resume(self) -> None:
        """Have contact again: everything that waits for an answer is due."""
        self._suspended = False
        now_s = self._now_s()
        self._due_s = dict.fromkeys(self._due_s, now_s)
        for told in self._told.values():
            told.due_s = now_s

    @property
    def next_s(self) -> float | None:
        """When `tick` has something to do, if ever."""
        if self._suspended:
            return None
        due_s = [*self._due_s.values(), *(told.due_s for told in self._told.values())]
        return min(due_s, default=None)

    def tick(self) -> None:
        """Repeat what was not answered in time."""
        if self._suspended:
            return
        now_s = self._now_s()
        for number, due_s in self._due_s.items():
            if due_s <= now_s:
                self._exports[number].remind()
                self._due_s[number] = now_s + self._answer_s
        for key, told in list(self._told.items()):
            if told.due_s <= now_s:
                self._repeat(key, told, now_s)

    @property
    def _answer_s(self) -> float:
        return 2 * self.light_time_s + self._link.answer_s

    def _repeat(self, key: tuple[int, int], told: _Told, now_s: float) -> None:
        """Repeat a report a few times; then the other engine's checkpoint has to ask again."""
        told.repeats += 1
        if told.repeats > _MOST_REPEATS:
            del self._told[key]
            return
        self.segments.append(told.report)
        told.due_s = now_s + self._answer_s

    def _hear(self, number: int, report: Report) -> None:
        export = self._exports.get(number)
        if export is None:
            return
        if export.hear(report):
            self._due_s[number] = self._now_s() + self._answer_s
        if export.done:
            self._end(number)
            self.events.append(Completed(number))

    def _end(self, number: int) -> None:
        """Remember an ended session: its last report may come again and wants its answer."""
        del self._exports[number], self._due_s[number]
        _remember(self._ended, number, None)

    def _take(self, number: int, data: Data) -> None:
        if (block := self._stored.get(number)) is not None:
            if block.take(data):
                self._report(number, block)
            return
        block = self._imports.get(number) or Import(data.session)
        if number in self._refused or not block.knows(data):
            if block.stage is Stage.GATHERING:
                self.refuse(number)
            return
        self._imports[number] = block
        self._imports.move_to_end(number)
        before = block.octets
        wanted = block.take(data)
        self._import_octets += block.octets - before
        whole = block.whole()
        if whole is not None:
            self.events.append(Arrived(number, whole))
        elif wanted:
            self._report(number, block)
        self._bound()

    def _report(self, number: int, block: Import) -> None:
        self._serial += 1
        report = block.report(self._serial)
        if report is None:
            return
        for key in [key for key in self._told if key[0] == number]:
            del self._told[key]
        self._told[number, report.serial] = _Told(report, self._now_s() + self._answer_s)
        self.segments.append(report)

    def _bound(self) -> None:
        """Refuse the oldest of the blocks that are gathered where there are too many."""
        while len(self._imports) > _MOST_IMPORTS or self._import_octets > _MOST_IMPORT_OCTETS:
            oldest = next(
                (
                    number
                    for number, block in self._imports.items()
                    if block.stage is Stage.GATHERING
                ),
                None,
            )
            if oldest is None:
                return
            self.refuse(oldest)

    def _drop(self, number: int) -> None:
        if block := self._imports.pop(number, None):
            self._import_octets -= block.octets
        for key in [key for key in self._told if key[0] == number]:
            del self._told[key]


_Value = TypeVar("_Value")


def _remember(memory: OrderedDict[int, _Value], number: int, value: _Value) -> None:
    memory[number] = value
    while len(memory) > _REMEMBERED:
        memory.popitem(last=False)
