"""Strict, deterministic codec of the subset of CBOR (RFC 8949) that bundles use.

Heads are accepted in their shortest form only: RFC 9171, 4.1, requires core deterministic encoding.
So decoded octets encode to the same octets again.
"""

import struct
from typing import Final

from adapters.bundle.codec.errors import DecodeError

BREAK: Final = b"\xff"
OPEN_ARRAY: Final = b"\x9f"
FALSE: Final = b"\xf4"
TRUE: Final = b"\xf5"
MAX_UNSIGNED: Final = 2**64 - 1

_UNSIGNED, _OCTETS, _TEXT, _ARRAY = 0, 2, 3, 4
_KINDS: Final = ("unsigned", "negative", "octet string", "text", "array", "map", "tag", "simple")
_FORMATS: Final = {24: (1, 24), 25: (2, 1 << 8), 26: (4, 1 << 16), 27: (8, 1 << 32)}


def _head(major: int, argument: int) -> bytes:
    kind = major << 5
    if argument < 24:
        return bytes((kind | argument,))
    if argument < 0x100:
        return bytes((kind | 24, argument))
    if argument < 0x10000:
        return struct.pack(">BH", kind | 25, argument)
    if argument < 0x100000000:
        return struct.pack(">BI", kind | 26, argument)
    return struct.pack(">BQ", kind | 27, argument)


def unsigned(value: int) -> bytes:
    """Encode an unsigned integer of at most 64 bits."""
    return _head(_UNSIGNED, value)


def octet_string(value: bytes) -> bytes:
    """Encode an octet string."""
    return _head(_OCTETS, len(value)) + value


def text(value: str) -> bytes:
    """Encode a text string."""
    encoded = value.encode()
    return _head(_TEXT, len(encoded)) + encoded


def array(length: int) -> bytes:
    """Encode the head of an array of known length."""
    return _head(_ARRAY, length)


class Reader:
    """Sequential decoder. Each method consumes its item, or raises DecodeError.

    Attributes:
        octets: the encoded items.
        at: index of the next octet.
    """

    __slots__ = ("at", "octets")

    def __init__(self, octets: bytes, at: int = 0) -> None:
        self.octets = octets
        self.at = at

    def fail(self, what: str) -> DecodeError:
        """Return a DecodeError with the position and this text."""
        return DecodeError(f"octet {self.at}: {what}")

    def unsigned(self) -> int:
        """Read an unsigned integer."""
        return self._argument(_UNSIGNED)

    def octet_string(self) -> bytes:
        """Read an octet string."""
        return self._take(self._argument(_OCTETS))

    def text(self) -> str:
        """Read a text string."""
        taken = self._take(self._argument(_TEXT))
        try:
            return taken.decode()
        except UnicodeDecodeError as error:
            raise self.fail("text is not UTF-8") from error

    def array(self) -> int:
        """Read the head of an array; return its length."""
        return self._argument(_ARRAY)

    def array_of(self, *lengths: int) -> int:
        """Read the head of an array that must have one of these lengths."""
        length = self._argument(_ARRAY)
        if length not in lengths:
            wanted = " or ".join(map(str, lengths))
            raise self.fail(f"expected array of {wanted}, got array of {length}")
        return length

    def skip(self) -> None:
        """Skip an item of the kinds above, with its content."""
        left = 1
        while left:
            left -= 1
            match self.octets[self.at] >> 5 if self.at < len(self.octets) else None:
                case 0:
                    self.unsigned()
                case 2:
                    self.octet_string()
                case 3:
                    self.text()
                case _:
                    left += self.array()

    def boolean(self) -> bool:
        """Read a boolean."""
        octet = self._take(1)
        if octet not in (TRUE, FALSE):
            raise self.fail(f"expected true or false, got 0x{octet.hex()}")
        return octet == TRUE

    def open_array(self) -> None:
        """Read the head of an array of indefinite length, which ends with a break."""
        if self._take(1) != OPEN_ARRAY:
            raise self.fail("expected array of indefinite length")

    def is_break(self) -> bool:
        """Return whether a break is next; consume it if so."""
        if self.octets[self.at : self.at + 1] != BREAK:
            return False
        self.at += 1
        return True

    def is_text(self) -> bool:
        """Return whether a text string is next; consume nothing."""
        return self.at < len(self.octets) and self.octets[self.at] >> 5 == _TEXT

    def finish(self) -> None:
        """Raise DecodeError unless every octet was consumed."""
        if self.at != len(self.octets):
            raise self.fail(f"{len(self.octets) - self.at} trailing octets")

    def _take(self, count: int) -> bytes:
        end = self.at + count
        if end > len(self.octets):
            raise self.fail(f"expected {count} octets, {len(self.octets) - self.at} left")
        taken = self.octets[self.at : end]
        self.at = end
        return taken

    def _argument(self, major: int) -> int:
        at = self.at
        if at >= len(self.octets):
            raise self.fail(f"expected {_KINDS[major]}, input ends")
        first = self.octets[at]
        short = first - (major << 5)
        if not 0 <= short < 32:
            raise self.fail(f"expected {_KINDS[major]}, got {_KINDS[first >> 5]}")
        self.at = at + 1
        if short < 24:
            return short
        if short not in _FORMATS:
            raise self.fail(f"{_KINDS[major]} with indefinite or reserved length")
        size, least = _FORMATS[short]
        argument = int.from_bytes(self._take(size), "big")
        if argument < least:
            raise self.fail(f"{argument} is not encoded in its shortest form")
        return argument
