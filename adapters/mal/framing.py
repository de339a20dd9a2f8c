"""Cuts a stream of octets into messages, by the length that each begins with."""

from collections.abc import Iterator
from typing import Final

from adapters.mal.errors import DecodeError
from adapters.mal.header import SHORTEST

MESSAGE_CAP: Final = 64 << 20
"""Octets of the longest message taken."""


class Framer:
    """Collects octets until whole messages are there; keeps no more than what has arrived."""

    def __init__(self, cap: int = MESSAGE_CAP) -> None:
        """Refuse messages longer than `cap` octets."""
        self._cap = cap
        self._octets = bytearray()

    def feed(self, octets: bytes) -> Iterator[bytes]:
        """Take octets and give the messages that are now whole.

        Raises:
            DecodeError: What begins here cannot be a message; nobody knows where the next begins.
        """
        waiting = self._octets
        waiting += octets
        at = 0
        while len(waiting) - at >= 4:
            length = int.from_bytes(waiting[at : at + 4], "big")
            if waiting[at] >> 4 == 2:
                raise DecodeError(
                    f"first octet {waiting[at]:#04x}: the header of 521.0-B-2, not of 521.0-B-3"
                )
            if not SHORTEST <= length <= self._cap:
                raise DecodeError(f"message length {length}, not within {SHORTEST} and {self._cap}")
            if len(waiting) - at < length:
                break
            yield bytes(memoryview(waiting)[at : at + length])
            at += length
        del waiting[:at]
