"""Writers: attribute values to octets, one class for each encoding."""

import struct
from typing import Final

from adapters.mal.encoding import DAY_MS, EPOCH_DAYS, MS_NS, Encoding
from adapters.mal.errors import EncodeError
from adapters.mal.values import ObjectRef

_OCTETS: Final = tuple(bytes((octet,)) for octet in range(256))
"""Every single octet."""


class Writer:
    """Fixed binary. A value that does not fit raises what `type_codec` turns into EncodeError."""

    __slots__ = ("_pieces",)

    def __init__(self) -> None:
        """Begin with nothing."""
        self._pieces: list[bytes] = []

    def finish(self) -> bytes:
        """All that was written."""
        return b"".join(self._pieces)

    def length(self, count: int) -> None:
        """A count of octets or elements."""
        self.uinteger(count)

    def flag(self, present: bool) -> None:
        """A presence flag."""
        self.boolean(present)

    def boolean(self, value: bool) -> None:
        """A Boolean."""
        self._pieces.append(_OCTETS[_checked(value)])

    def octet(self, value: int) -> None:
        """An Octet."""
        self._pieces.append(value.to_bytes(1, "big", signed=True))

    def uoctet(self, value: int) -> None:
        """An UOctet."""
        self._pieces.append(value.to_bytes(1, "big"))

    def short(self, value: int) -> None:
        """A Short."""
        self._pieces.append(value.to_bytes(2, "big", signed=True))

    def ushort(self, value: int) -> None:
        """An UShort."""
        self._pieces.append(value.to_bytes(2, "big"))

    def integer(self, value: int) -> None:
        """An Integer."""
        self._pieces.append(value.to_bytes(4, "big", signed=True))

    def uinteger(self, value: int) -> None:
        """An UInteger."""
        self._pieces.append(value.to_bytes(4, "big"))

    def long(self, value: int) -> None:
        """A Long."""
        self._pieces.append(value.to_bytes(8, "big", signed=True))

    def ulong(self, value: int) -> None:
        """An ULong."""
        self._pieces.append(value.to_bytes(8, "big"))

    def single(self, value: float) -> None:
        """A Float."""
        self._pieces.append(_packed(">f", value))

    def double(self, value: float) -> None:
        """A Double, or a Duration in s."""
        self._pieces.append(_packed(">d", value))

    def blob(self, value: bytes) -> None:
        """A Blob."""
        if not isinstance(value, bytes):
            raise EncodeError(f"bytes wanted, not {value!r}")
        self.length(len(value))
        self._pieces.append(value)

    def string(self, value: str) -> None:
        """A String, Identifier or URI."""
        self.blob(value.encode())

    def time(self, value: int) -> None:
        """A Time, from ns since 1970 UTC, rounded to the ms."""
        self._cds((value + MS_NS // 2) // MS_NS)

    def finetime(self, value: int) -> None:
        """A FineTime, from ns since 1970 UTC."""
        milliseconds, nanoseconds = divmod(value, MS_NS)
        self._cds(milliseconds)
        self._pieces.append((nanoseconds * 1000).to_bytes(4, "big"))

    def _cds(self, milliseconds: int) -> None:
        days, rest = divmod(milliseconds, DAY_MS)
        self._pieces.append((days + EPOCH_DAYS).to_bytes(2, "big") + rest.to_bytes(4, "big"))

    def objectref(self, value: ObjectRef) -> None:
        """An ObjectRef."""
        self.length(len(value.domain))
        for part in value.domain:
            self.string(part)
        self.long(value.type)
        self.string(value.key)
        self.long(value.version)


class VariableWriter(Writer):
    """Variable binary: integers as LEB128, signed ones zigzag, floats as integers of their bits."""

    __slots__ = ()

    def _unsigned(self, value: int, bits: int) -> None:
        if not 0 <= value < 1 << bits:
            raise EncodeError(f"{value} does not fit {bits} bits")
        while value > 0x7F:
            self._pieces.append(_OCTETS[value & 0x7F | 0x80])
            value >>= 7
        self._pieces.append(_OCTETS[value])

    def _signed(self, value: int, bits: int) -> None:
        self._unsigned(value << 1 if value >= 0 else ~(value << 1), bits)

    def short(self, value: int) -> None:
        """A Short."""
        self._signed(value, 16)

    def ushort(self, value: int) -> None:
        """An UShort."""
        self._unsigned(value, 16)

    def integer(self, value: int) -> None:
        """An Integer."""
        self._signed(value, 32)

    def uinteger(self, value: int) -> None:
        """An UInteger."""
        self._unsigned(value, 32)

    def long(self, value: int) -> None:
        """A Long."""
        self._signed(value, 64)

    def ulong(self, value: int) -> None:
        """An ULong."""
        self._unsigned(value, 64)

    def single(self, value: float) -> None:
        """A Float."""
        self._signed(int.from_bytes(_packed(">f", value), "big", signed=True), 32)

    def double(self, value: float) -> None:
        """A Double, or a Duration in s."""
        self._signed(int.from_bytes(_packed(">d", value), "big", signed=True), 64)


class SplitWriter(VariableWriter):
    """Split binary: Booleans and presence flags are bits in front, all else as in variable."""

    __slots__ = ("_bit", "_bits")

    def __init__(self) -> None:
        """Begin with nothing."""
        super().__init__()
        self._bit = 0
        self._bits = bytearray()

    def boolean(self, value: bool) -> None:
        """The next bit, least significant first."""
        place = self._bit % 8
        if not place:
            self._bits.append(0)
        self._bits[-1] |= _checked(value) << place
        self._bit += 1

    def finish(self) -> bytes:
        """The bits up to the last one that is set, then the rest."""
        front = VariableWriter()
        front.blob(bytes(self._bits.rstrip(b"\0")))
        return b"".join((front.finish(), *self._pieces))


def _checked(value: bool) -> bool:
    if not isinstance(value, bool):
        raise EncodeError(f"a Boolean wanted, not {value!r}")
    return value


def _packed(layout: str, value: float) -> bytes:
    try:
        return struct.pack(layout, value)
    except struct.error as fault:
        raise EncodeError(str(fault)) from None


WRITERS = {
    Encoding.FIXED: Writer,
    Encoding.VARIABLE: VariableWriter,
    Encoding.SPLIT: SplitWriter,
}
