"""Cuts a stream of octets into MOPS messages, whatever lies between them."""

from collections.abc import Callable, Iterator
from typing import Final

from adapters.mops.message import END, LONGEST, Message, MopsError, decode

_END: Final = END.encode()
_PADDING: Final = b"\0\r\n"
"""What may stand before a message unsaid: USB packets are filled up with zeros."""
_SHOWN: Final = 60


class MopsStream:
    """Collects octets until messages are there; keeps no more than one message's worth.

    What is no message is dropped up to and with the next `#`, counted and told once.

    Args:
        tell: called with one line on each piece that was dropped.

    Attributes:
        dropped_octets, dropped_pieces: what was no message so far.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        """Begin at the border of a message."""
        self._tell = tell
        self._begun = b""
        self._skipped = 0
        self.dropped_octets = 0
        self.dropped_pieces = 0

    def feed(self, octets: bytes) -> Iterator[Message]:
        """Take octets, cut anywhere, and give the messages that are now whole."""
        *pieces, self._begun = (self._begun + octets).split(_END)
        for piece in pieces:
            message = self._whole(piece + _END)
            if message is not None:
                yield message
        if len(self._begun) >= LONGEST:
            self._skipped += len(self._begun)
            self._begun = b""

    def cut(self) -> None:
        """Drop what has begun: its end does not come any more."""
        begun, self._begun = self._begun, b""
        skipped, self._skipped = self._skipped, 0
        if skipped or begun.strip(_PADDING):
            self._drop(begun[:_SHOWN], skipped + len(begun), f"no {END} at the end")

    def _whole(self, piece: bytes) -> Message | None:
        if self._skipped:
            self._drop(piece[-_SHOWN:], self._skipped + len(piece), "it does not end")
            self._skipped = 0
            return None
        try:
            return decode(piece.lstrip(_PADDING))
        except MopsError as fault:
            self._drop(piece[:_SHOWN], len(piece), str(fault))
            return None

    def _drop(self, shown: bytes, octets: int, why: str) -> None:
        self.dropped_octets += octets
        self.dropped_pieces += 1
        self._tell(f"{octets} octets are no MOPS message ({why}): {shown!r}")


def messages_in(text: str, tell: Callable[[str], None]) -> Iterator[Message]:
    """Give the messages of a text that holds whole ones only.

    Args:
        text: one message or several.
        tell: called with one line on each piece that is none.
    """
    stream = MopsStream(tell)
    yield from stream.feed(text.encode("utf-8", "replace"))
    stream.cut()
