"""The sending side of one LTP block (RFC 5326, 6.1 to 6.14), all of it red."""

from collections.abc import Callable
from typing import Final

from adapters.bundle.ltp_segment import Checkpoint, Claim, Data, Report, SessionId
from adapters.bundle.ranges import Ranges

BUNDLE_SERVICE: Final = 1


class Export:
    """Sends a block until reports have claimed all of it.

    A report replaces what was known of its scope, so that a receiver that lost its memory gets
    everything again.

    Args:
        session: whose block this is.
        block: what is sent.
        segment_octets: how much of it goes in one segment.
        serial: the first checkpoint's serial number.
        send: takes a segment.

    Attributes:
        done: whether all has been claimed.
    """

    def __init__(
        self,
        session: SessionId,
        block: bytes,
        segment_octets: int,
        serial: int,
        send: Callable[[Data], None],
    ) -> None:
        """Send all of the block."""
        self._session = session
        self._block = block
        self._segment_octets = segment_octets
        self._serial = serial
        self._send = send
        self._claimed = Ranges()
        self._heard: set[int] = set()
        self._last: Data | None = None
        self.done = False
        self._send_gaps([(0, len(block))], 0)

    def hear(self, report: Report) -> bool:
        """Take a report; return whether segments, and with them a checkpoint, were sent."""
        if report.serial in self._heard or self.done:
            return False
        self._heard.add(report.serial)
        upper = min(report.upper, len(self._block))
        self._claim(report.lower, upper, report.claims)
        self.done = self._claimed.cover(0, len(self._block))
        answers = self._last and self._last.checkpoint
        if self.done or (answers and answers.serial == report.checkpoint_serial):
            self._last = None
        if self.done:
            return False
        gaps = self._claimed.gaps(report.lower, upper)
        if not gaps and self._last is None:
            gaps = self._claimed.gaps(0, len(self._block))
        if gaps:
            self._send_gaps(gaps, report.serial)
        return bool(gaps)

    def remind(self) -> None:
        """Send the checkpoint that was not answered again."""
        if self._last is not None:
            self._send(self._last)

    def _claim(self, lower: int, upper: int, claims: tuple[Claim, ...]) -> None:
        self._claimed.remove(lower, upper)
        for claim in claims:
            end = min(claim.offset + claim.length, len(self._block))
            self._claimed.add(claim.offset, end)

    def _send_gaps(self, gaps: list[tuple[int, int]], report_serial: int) -> None:
        cut = [
            (at, min(at + self._segment_octets, end))
            for begin, end in gaps
            for at in range(begin, end, self._segment_octets)
        ]
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
