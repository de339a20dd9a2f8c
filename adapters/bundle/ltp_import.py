"""The receiving side of one LTP block (RFC 5326, 6.8 to 6.11), its red part."""

from enum import Enum
from typing import Final

from adapters.bundle.ltp_segment import Claim, Data, Report, SessionId
from adapters.bundle.ranges import Ranges

_MOST_CLAIMS: Final = 100


class Stage(Enum):
    """How far a block has come: octets are missing, it is being stored, it is stored."""

    GATHERING = 1
    STORING = 2
    STORED = 3


class Import:
    """Gathers a block and says what of it is there.

    That all of it is there is said only when it is stored.

    Attributes:
        stage: how far it has come.
        octets: how much it holds in memory.
    """

    def __init__(self, session: SessionId) -> None:
        """Begin with nothing."""
        self.stage = Stage.GATHERING
        self.octets = 0
        self._session = session
        self._there = Ranges()
        self._parts: dict[int, bytes] = {}
        self._length: int | None = None
        self._checkpoint_serial = 0
        self._reach = 0
        self._serials = {0}

    def knows(self, data: Data) -> bool:
        """Return whether a segment follows no report, or one of this block and this memory.

        The report before a loss of memory claimed what is no longer here; with new reports that
        leave some of it out, the sender would take the block for complete.
        """
        return data.checkpoint is None or data.checkpoint.report_serial in self._serials

    def take(self, data: Data) -> bool:
        """Take a red segment; return whether it asks for a report."""
        if self.stage is Stage.GATHERING:
            self._gather(data)
        if data.checkpoint is None:
            return False
        self._checkpoint_serial = data.checkpoint.serial
        self._reach = max(self._reach, data.offset + len(data.octets))
        return True

    def whole(self) -> bytes | None:
        """Return the block when it has just become complete."""
        if self.stage is not Stage.GATHERING or self._length is None:
            return None
        if not self._there.cover(0, self._length):
            return None
        self.stage = Stage.STORING
        block = bytearray()
        for offset, octets in sorted(self._parts.items()):
            block += octets[len(block) - offset :]
        return bytes(block[: self._length])

    def stored(self) -> None:
        """Note that the block is stored, and let go of it."""
        self.stage = Stage.STORED
        self.octets = 0
        self._parts.clear()

    def report(self, serial: int) -> Report | None:
        """Return a report on what is there; None if nothing may be said."""
        if self.stage is Stage.STORING:
            return None
        there = self._there.within(0, self._reach)
        upper = self._reach if len(there) <= _MOST_CLAIMS else there[_MOST_CLAIMS - 1][1]
        claims = tuple(Claim(begin, end - begin) for begin, end in there[:_MOST_CLAIMS])
        if not claims:
            return None
        self._serials.add(serial)
        return Report(self._session, serial, self._checkpoint_serial, upper, 0, claims)

    def _gather(self, data: Data) -> None:
        end = data.offset + len(data.octets)
        if data.ends_red:
            self._length = end
        if not self._there.cover(data.offset, end):
            held = self._parts.get(data.offset, b"")
            if len(data.octets) > len(held):
                self._parts[data.offset] = data.octets
                self.octets += len(data.octets) - len(held)
            self._there.add(data.offset, end)
