"""Cuts a stream of octets into messages, by the length that each begins with."""

from collections.abc import Iterator
from typing import Final

from adapters.mal.errors import DecodeError
from adapters.mal.header import SHORTEST

MESSAGE_CAP: Final = 64 << 20
"""Octets of the longest message taken."""
_LEAST_ROOM: Final = 16 << 10
"""Octets of a new framer's buffer."""
_MOST_AT_ONCE: Final = 256 << 10
"""Octets that a buffer grows to because much comes; beyond that only for a longer message."""


class Framer:
    """Collects octets until whole messages are there.

    What comes is put into a buffer that is used again and again; it is never much longer than what
    has arrived of a message.
    """

    def __init__(self, cap: int = MESSAGE_CAP) -> None:
        """Refuse messages longer than `cap` octets."""
        self._cap = cap
        self._buffer = memoryview(bytearray(_LEAST_ROOM))
        self._begin = 0
        self._end = 0

    def room(self) -> memoryview:
        """Where the next octets are to be put; one at least."""
        return self._buffer[self._end :]

    def taken(self, count: int) -> Iterator[memoryview]:
        """Give the messages that are whole now that octets were put where room was.

        A message is only there until the next one is asked for.

        Raises:
            DecodeError: What begins here cannot be a message; nobody knows where the next begins.
        """
        self._end += count
        while (there := self._end - self._begin) >= 4 and there >= (length := self._length()):
            message = self._buffer[self._begin : self._begin + length]
            self._begin += length
            yield message
        self._arrange()

    def _length(self) -> int:
        begin = self._buffer[self._begin : self._begin + 4]
        length = int.from_bytes(begin, "big")
        if begin[0] >> 4 == 2:
            raise DecodeError(
                f"first octet {begin[0]:#04x}: the header of 521.0-B-2, not of 521.0-B-3"
            )
        if not SHORTEST <= length <= self._cap:
            raise DecodeError(f"message length {length}, not within {SHORTEST} and {self._cap}")
        return length

    def _arrange(self) -> None:
        """Make room behind what has begun: by moving it, in a longer buffer if this one is full."""
        begun = self._buffer[self._begin : self._end]
        size = len(self._buffer)
        if len(begun) == size or (self._end == size and size < _MOST_AT_ONCE):
            self._buffer = memoryview(bytearray(2 * size))
        elif not begun and size > _MOST_AT_ONCE:
            self._buffer = memoryview(bytearray(_LEAST_ROOM))
        elif self._begin == 0 or (begun and self._end <= size // 2):
            return
        self._begin, self._end = 0, len(begun)
        self._buffer[: self._end] = begun
