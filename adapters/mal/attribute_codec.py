"""Attribute values to octets and back, strictly, in each of the three body encodings."""

import struct
from enum import Enum
from typing import Final

from adapters.mal.errors import DecodeError, EncodeError
from adapters.mal.values import AttributeType, ObjectRef


class Encoding(Enum):
    """How bodies are written; both sides agree on it beforehand, the header does not tell."""

    FIXED = "fixed"
    VARIABLE = "variable"
    SPLIT = "split"


PRIMITIVE: Final = {
    AttributeType.BLOB: "blob",
    AttributeType.BOOLEAN: "boolean",
    AttributeType.DURATION: "double",
    AttributeType.FLOAT: "single",
    AttributeType.DOUBLE: "double",
    AttributeType.IDENTIFIER: "string",
    AttributeType.OCTET: "octet",
    AttributeType.UOCTET: "uoctet",
    AttributeType.SHORT: "short",
    AttributeType.USHORT: "ushort",
    AttributeType.INTEGER: "integer",
    AttributeType.UINTEGER: "uinteger",
    AttributeType.LONG: "long",
    AttributeType.ULONG: "ulong",
    AttributeType.STRING: "string",
    AttributeType.TIME: "time",
    AttributeType.FINETIME: "finetime",
    AttributeType.URI: "string",
    AttributeType.OBJECTREF: "objectref",
}
"""Attribute type to the method of `reader.Reader` and `writer.Writer` that carries it."""

EPOCH_DAYS: Final = 4383
"""Days from 1958-01-01, the CCSDS epoch of CDS time codes, to 1970-01-01."""
DAY_MS: Final = 86_400_000
MS_NS: Final = 1_000_000
MAX_DEPTH: Final = 64
"""Composites inside composites, at most."""
MAX_ELEMENTS: Final = 1 << 20
"""List elements in one message, at most: an element may cost no octet at all (a false bit)."""


_DOUBLE = struct.Struct(">d")
_SINGLE = struct.Struct(">f")


class Reader:
    """Fixed binary. Every method consumes what it returns, or raises DecodeError."""

    __slots__ = ("_at", "_depth", "_elements", "_octets")

    def __init__(self, octets: bytes | memoryview, at: int = 0) -> None:
        """Begin at an index of the octets."""
        self._octets = octets
        self._at = at
        self._depth = 0
        self._elements = 0

    @property
    def at(self) -> int:
        """The index of the next octet."""
        return self._at

    def fail(self, what: str) -> DecodeError:
        """Make the error that says where it happened."""
        return DecodeError(f"octet {self._at}: {what}")

    def take(self, count: int) -> bytes | memoryview:
        """The next `count` octets, not copied from a view."""
        end = self._at + count
        taken = self._octets[self._at : end]
        if len(taken) != count:
            raise self.fail(f"{count} octets wanted, {len(taken)} there")
        self._at = end
        return taken

    def finish(self) -> None:
        """Raise DecodeError unless everything was consumed."""
        if self._at != len(self._octets):
            raise self.fail(f"{len(self._octets) - self._at} octets left over")

    def enter(self) -> None:
        """Go one composite deeper."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self.fail(f"composites nested deeper than {MAX_DEPTH}")

    def leave(self) -> None:
        """Come out of a composite."""
        self._depth -= 1

    def elements(self) -> int:
        """The number of elements of a list."""
        count = self.length()
        self._elements += count
        if self._elements > MAX_ELEMENTS:
            raise self.fail(f"{count} list elements, {MAX_ELEMENTS} allowed in a message")
        return count

    def length(self) -> int:
        """A count of octets or elements."""
        return self.uinteger()

    def flag(self) -> bool:
        """A presence flag."""
        return self.boolean()

    def boolean(self) -> bool:
        """A Boolean."""
        octet = self.uoctet()
        if octet > 1:
            raise self.fail(f"0 or 1 wanted for a flag or Boolean, {octet} there")
        return octet == 1

    def octet(self) -> int:
        """An Octet."""
        return int.from_bytes(self.take(1), "big", signed=True)

    def uoctet(self) -> int:
        """An UOctet."""
        return self.take(1)[0]

    def short(self) -> int:
        """A Short."""
        return int.from_bytes(self.take(2), "big", signed=True)

    def ushort(self) -> int:
        """An UShort."""
        return int.from_bytes(self.take(2), "big")

    def integer(self) -> int:
        """An Integer."""
        return int.from_bytes(self.take(4), "big", signed=True)

    def uinteger(self) -> int:
        """An UInteger."""
        return int.from_bytes(self.take(4), "big")

    def long(self) -> int:
        """A Long."""
        return int.from_bytes(self.take(8), "big", signed=True)

    def ulong(self) -> int:
        """An ULong."""
        return int.from_bytes(self.take(8), "big")

    def single(self) -> float:
        """A Float."""
        value: float = _SINGLE.unpack(self.take(4))[0]
        return value

    def double(self) -> float:
        """A Double, or a Duration in s."""
        value: float = _DOUBLE.unpack(self.take(8))[0]
        return value

    def blob(self) -> bytes:
        """A Blob."""
        return bytes(self.take(self.length()))

    def string(self) -> str:
        """A String, Identifier or URI."""
        octets = self.take(self.length())
        try:
            return str(octets, "utf-8")
        except UnicodeDecodeError as fault:
            raise self.fail(f"text is not UTF-8: {fault.reason}") from None

    def time(self) -> int:
        """A Time, in ns since 1970 UTC."""
        days = int.from_bytes(self.take(2), "big")
        milliseconds = int.from_bytes(self.take(4), "big")
        if milliseconds >= DAY_MS:
            raise self.fail(f"{milliseconds} ms in a day")
        return ((days - EPOCH_DAYS) * DAY_MS + milliseconds) * MS_NS

    def finetime(self) -> int:
        """A FineTime, in ns since 1970 UTC; what is finer is cut off."""
        coarse = self.time()
        picoseconds = int.from_bytes(self.take(4), "big")
        if picoseconds >= 1000 * MS_NS:
            raise self.fail(f"{picoseconds} ps in a ms")
        return coarse + picoseconds // 1000

    def objectref(self) -> ObjectRef:
        """An ObjectRef."""
        domain = tuple([self.string() for _ in range(self.elements())])
        return ObjectRef(domain, self.long(), self.string(), self.long())


class VariableReader(Reader):
    """Variable binary: integers as LEB128, signed ones zigzag, floats as integers of their bits."""

    __slots__ = ()

    def _unsigned(self, bits: int) -> int:
        value = shift = 0
        while True:
            octet = self.uoctet()
            value |= (octet & 0x7F) << shift
            if octet < 0x80:
                break
            shift += 7
            if shift >= bits:
                raise self.fail(f"number longer than {bits} bits")
        if value >> bits:
            raise self.fail(f"number longer than {bits} bits")
        if shift and not octet:
            raise self.fail("number written longer than it is")
        return value

    def _signed(self, bits: int) -> int:
        value = self._unsigned(bits)
        return (value >> 1) ^ -(value & 1)

    def short(self) -> int:
        """A Short."""
        return self._signed(16)

    def ushort(self) -> int:
        """An UShort."""
        return self._unsigned(16)

    def integer(self) -> int:
        """An Integer."""
        return self._signed(32)

    def uinteger(self) -> int:
        """An UInteger."""
        return self._unsigned(32)

    def long(self) -> int:
        """A Long."""
        return self._signed(64)

    def ulong(self) -> int:
        """An ULong."""
        return self._unsigned(64)

    def single(self) -> float:
        """A Float."""
        value: float = _SINGLE.unpack(self._signed(32).to_bytes(4, "big", signed=True))[0]
        return value

    def double(self) -> float:
        """A Double, or a Duration in s."""
        value: float = _DOUBLE.unpack(self._signed(64).to_bytes(8, "big", signed=True))[0]
        return value


class SplitReader(VariableReader):
    """Split binary: Booleans and presence flags are bits in front, all else as in variable."""

    __slots__ = ("_bit", "_bits")

    def __init__(self, octets: bytes | memoryview, at: int = 0) -> None:
        """Take the bits from the front."""
        super().__init__(octets, at)
        self._bit = 0
        self._bits = b""
        self._bits = self.blob()

    def boolean(self) -> bool:
        """The next bit, least significant first; bits that are not there are 0."""
        index, place = divmod(self._bit, 8)
        self._bit += 1
        return index < len(self._bits) and bool(self._bits[index] >> place & 1)

    def finish(self) -> None:
        """Raise DecodeError unless every octet and every set bit was consumed."""
        super().finish()
        used, partial = divmod(self._bit, 8)
        rest = self._bits[used:]
        if rest and (len(rest) > 1 or not partial or rest[0] >> partial):
            raise self.fail("bits left over")


READERS = {
    Encoding.FIXED: Reader,
    Encoding.VARIABLE: VariableReader,
    Encoding.SPLIT: SplitReader,
}


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
