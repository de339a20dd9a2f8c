"""`Reader`, `Writer`: strict codec of attribute values in the three body encodings of the MAL."""

import struct
from collections.abc import Callable
from enum import Enum
from typing import Final, TypeVar

from adapters.mal.errors import DecodeError, EncodeError
from adapters.mal.values import AttributeType, ObjectRef, TypedAttribute


class Encoding(Enum):
    """Body encodings. Both ends agree on one beforehand: the header does not carry it."""

    FIXED = "fixed"
    VARIABLE = "variable"
    SPLIT = "split"


_SHARED: Final = {
    AttributeType.DURATION: "double",
    AttributeType.FLOAT: "single",
    AttributeType.IDENTIFIER: "string",
    AttributeType.URI: "string",
}
METHODS: Final = {kind: _SHARED.get(kind, kind.name.lower()) for kind in AttributeType}
"""Method of `Reader` and `Writer` for each attribute type."""
_BY_SHORT_FORM: Final = {kind.value: (kind, method) for kind, method in METHODS.items()}

EPOCH_DAYS: Final = 4383
"""Days from 1958-01-01, the epoch of CDS time codes (CCSDS 301.0-B-4, 3.3), to 1970-01-01."""
DAY_MS: Final = 86_400_000
MS_NS: Final = 1_000_000
MAX_DEPTH: Final = 64
"""Maximum nesting of composites."""
MAX_ELEMENTS: Final = 1 << 20
"""Default maximum of list elements in one message: an element may need no octet at all (a false
bit)."""
_CDS: Final = struct.Struct(">HI")
_FLOATS: Final = {32: struct.Struct(">f"), 64: struct.Struct(">d")}


_Number = TypeVar("_Number", int, float)


def _read_number(code: str, _kind: type[_Number]) -> "Callable[[Reader], _Number]":
    layout = struct.Struct(">" + code)
    size, unpack_from = layout.size, layout.unpack_from

    def read(reader: "Reader") -> _Number:
        value: _Number
        at = reader.at
        try:
            (value,) = unpack_from(reader._octets, at)
        except struct.error:
            reader.take(size)
            raise
        reader.at = at + size
        return value

    return read


class Reader:
    """Reader of fixed binary. Each method consumes the value it returns, or raises DecodeError.

    Attributes:
        at: Index of the next octet.
    """

    __slots__ = ("_depth", "_elements", "_max_elements", "_octets", "at")

    def __init__(
        self, octets: bytes | memoryview, at: int = 0, elements: int = MAX_ELEMENTS
    ) -> None:
        self._octets = octets
        self.at = at
        self._depth = 0
        self._elements = 0
        self._max_elements = elements

    def fail(self, what: str) -> DecodeError:
        """Return the error with the position of the octet."""
        return DecodeError(f"octet {self.at}: {what}")

    def take(self, count: int) -> bytes | memoryview:
        """Return the next `count` octets; a view is not copied."""
        end = self.at + count
        octets = self._octets[self.at : end]
        if len(octets) != count:
            raise self.fail(f"{count} octets expected, {len(octets)} available")
        self.at = end
        return octets

    def finish(self) -> None:
        """Raise DecodeError unless everything was consumed."""
        if self.at != len(self._octets):
            raise self.fail(f"{len(self._octets) - self.at} excess octets")

    def enter(self) -> None:
        """Enter a composite."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self.fail(f"composites nested deeper than {MAX_DEPTH}")

    def leave(self) -> None:
        """Leave a composite."""
        self._depth -= 1

    def elements(self) -> int:
        """Return the number of elements of a list."""
        count = self.uinteger()
        self._elements += count
        if self._elements > self._max_elements:
            raise self.fail(f"{count} list elements, {self._max_elements} allowed in a message")
        return count

    def boolean(self) -> bool:
        """Return a Boolean, or the presence flag of a nullable value."""
        octet = self.uoctet()
        if octet > 1:
            raise self.fail(f"a flag or Boolean must be 0 or 1, not {octet}")
        return octet == 1

    octet = _read_number("b", int)
    uoctet = _read_number("B", int)
    short = _read_number("h", int)
    ushort = _read_number("H", int)
    integer = _read_number("i", int)
    uinteger = _read_number("I", int)
    long = _read_number("q", int)
    ulong = _read_number("Q", int)
    single = _read_number("f", float)
    double = _read_number("d", float)

    def blob(self) -> bytes:
        """Return a Blob."""
        return bytes(self.take(self.uinteger()))

    def string(self) -> str:
        """Return a String, Identifier or URI."""
        octets = self.take(self.uinteger())
        try:
            return str(octets, "utf-8")
        except UnicodeDecodeError as fault:
            raise self.fail(f"text is not UTF-8: {fault.reason}") from None

    def time(self) -> int:
        """Return a Time in ns since 1970 UTC: 16 bits of days, 32 bits of ms of the day."""
        days, milliseconds = _CDS.unpack(self.take(_CDS.size))
        if milliseconds >= DAY_MS:
            raise self.fail(f"{milliseconds} ms in a day")
        since_ms: int = (days - EPOCH_DAYS) * DAY_MS + milliseconds
        return since_ms * MS_NS

    def finetime(self) -> int:
        """Return a FineTime in ns since 1970 UTC; finer digits are truncated."""
        coarse = self.time()
        picoseconds = int.from_bytes(self.take(4), "big")
        if picoseconds >= 1000 * MS_NS:
            raise self.fail(f"{picoseconds} ps in a ms")
        return coarse + picoseconds // 1000

    def objectref(self) -> ObjectRef:
        """Return an ObjectRef."""
        domain = tuple([self.string() for _ in range(self.elements())])
        return ObjectRef(domain, self.long(), self.string(), self.long())

    def attribute(self) -> TypedAttribute:
        """Return an attribute with its type: the short form in one octet, then the value."""
        number = self.uoctet()
        if number not in _BY_SHORT_FORM:
            raise self.fail(f"unknown attribute short form {number}")
        kind, method = _BY_SHORT_FORM[number]
        return TypedAttribute(kind, getattr(self, method)())


def _read_unsigned(bits: int) -> "Callable[[Reader], int]":
    """Return a reader of LEB128: seven bits an octet, least significant first."""

    def read(reader: "Reader") -> int:
        value = shift = 0
        while True:
            octet = reader.uoctet()
            value |= (octet & 0x7F) << shift
            if octet < 0x80:
                break
            shift += 7
            if shift >= bits:
                raise reader.fail(f"number exceeds {bits} bits")
        if value >> bits:
            raise reader.fail(f"number exceeds {bits} bits")
        if shift and not octet:
            raise reader.fail("number is not minimally encoded")
        return value

    return read


def _read_signed(bits: int) -> "Callable[[Reader], int]":
    """Return a reader of zigzag numbers: 0, -1, 1, -2, and so on."""
    read_unsigned = _read_unsigned(bits)

    def read(reader: "Reader") -> int:
        value = read_unsigned(reader)
        return (value >> 1) ^ -(value & 1)

    return read


def _read_float_of_integer(bits: int) -> "Callable[[Reader], float]":
    read_signed, layout = _read_signed(bits), _FLOATS[bits]

    def read(reader: "Reader") -> float:
        value: float = layout.unpack(read_signed(reader).to_bytes(bits // 8, "big", signed=True))[0]
        return value

    return read


class VariableReader(Reader):
    """Variable binary: integers as LEB128, signed ones zigzag, floats as integers of their bits."""

    __slots__ = ()

    short = _read_signed(16)
    ushort = _read_unsigned(16)
    integer = _read_signed(32)
    uinteger = _read_unsigned(32)
    long = _read_signed(64)
    ulong = _read_unsigned(64)
    single = _read_float_of_integer(32)
    double = _read_float_of_integer(64)


class SplitReader(VariableReader):
    """Split binary (CCSDS 524.2-B-1): Booleans and flags as leading bits, the rest variable."""

    __slots__ = ("_bit", "_bits")

    def __init__(
        self, octets: bytes | memoryview, at: int = 0, elements: int = MAX_ELEMENTS
    ) -> None:
        super().__init__(octets, at, elements)
        self._bit = 0
        self._bits = self.blob()

    def boolean(self) -> bool:
        """Return the next bit, least significant first; missing bits are 0."""
        index, shift = divmod(self._bit, 8)
        self._bit += 1
        return index < len(self._bits) and bool(self._bits[index] >> shift & 1)

    def finish(self) -> None:
        """Raise DecodeError unless every octet and every set bit was consumed."""
        super().finish()
        used, partial = divmod(self._bit, 8)
        rest = self._bits[used:]
        if rest and (len(rest) > 1 or not partial or rest[0] >> partial):
            raise self.fail("excess bits")


READERS: Final = {
    Encoding.FIXED: Reader,
    Encoding.VARIABLE: VariableReader,
    Encoding.SPLIT: SplitReader,
}
_OCTETS: Final = tuple(bytes((octet,)) for octet in range(256))
"""All octets as bytes."""


def _write_integer(bits: int, *, signed: bool) -> "Callable[[Writer, int], None]":
    size = bits // 8

    def write(writer: "Writer", value: int) -> None:
        writer.pieces.append(value.to_bytes(size, "big", signed=signed))

    return write


def _write_float(bits: int) -> "Callable[[Writer, float], None]":
    def write(writer: "Writer", value: float) -> None:
        writer.pieces.append(_pack_bits(bits, value))

    return write


class Writer:
    """Writer of fixed binary. `codec` converts the errors of values that do not fit."""

    __slots__ = ("pieces",)

    def __init__(self) -> None:
        self.pieces: list[bytes] = []

    def finish(self) -> bytes:
        """Return all written octets."""
        return b"".join(self.pieces)

    def length(self, count: int) -> None:
        """Write a number of octets or elements."""
        self.uinteger(count)

    def boolean(self, value: bool) -> None:
        """Write a Boolean, or the presence flag of a nullable value."""
        self.pieces.append(_OCTETS[_checked(value)])

    octet = _write_integer(8, signed=True)
    uoctet = _write_integer(8, signed=False)
    short = _write_integer(16, signed=True)
    ushort = _write_integer(16, signed=False)
    integer = _write_integer(32, signed=True)
    uinteger = _write_integer(32, signed=False)
    long = _write_integer(64, signed=True)
    ulong = _write_integer(64, signed=False)
    single = _write_float(32)
    double = _write_float(64)

    def blob(self, value: bytes) -> None:
        """Write a Blob."""
        if not isinstance(value, bytes):
            raise EncodeError(f"expected bytes, not {value!r}")
        self.length(len(value))
        self.pieces.append(value)

    def string(self, value: str) -> None:
        """Write a String, Identifier or URI."""
        self.blob(value.encode())

    def time(self, value: int) -> None:
        """Write a Time from ns since 1970 UTC, rounded to the ms."""
        self._cds((value + MS_NS // 2) // MS_NS)

    def finetime(self, value: int) -> None:
        """Write a FineTime from ns since 1970 UTC."""
        milliseconds, nanoseconds = divmod(value, MS_NS)
        self._cds(milliseconds)
        self.pieces.append((nanoseconds * 1000).to_bytes(4, "big"))

    def _cds(self, milliseconds: int) -> None:
        days, rest = divmod(milliseconds, DAY_MS)
        self.pieces.append((days + EPOCH_DAYS).to_bytes(2, "big") + rest.to_bytes(4, "big"))

    def objectref(self, value: ObjectRef) -> None:
        """Write an ObjectRef."""
        self.length(len(value.domain))
        for part in value.domain:
            self.string(part)
        self.long(value.type)
        self.string(value.key)
        self.long(value.version)

    def attribute(self, value: TypedAttribute) -> None:
        """Write an attribute with its type."""
        if not isinstance(value, TypedAttribute):
            raise EncodeError(f"expected a TypedAttribute, not {value!r}")
        self.uoctet(value.type.value)
        getattr(self, METHODS[value.type])(value.value)


def _write_unsigned(bits: int) -> "Callable[[Writer, int], None]":
    def write(writer: "Writer", value: int) -> None:
        if not 0 <= value < 1 << bits:
            raise EncodeError(f"{value} does not fit {bits} bits")
        while value > 0x7F:
            writer.pieces.append(_OCTETS[value & 0x7F | 0x80])
            value >>= 7
        writer.pieces.append(_OCTETS[value])

    return write


def _write_signed(bits: int) -> "Callable[[Writer, int], None]":
    write_unsigned = _write_unsigned(bits)

    def write(writer: "Writer", value: int) -> None:
        write_unsigned(writer, value << 1 if value >= 0 else ~(value << 1))

    return write


def _write_float_as_integer(bits: int) -> "Callable[[Writer, float], None]":
    write_signed = _write_signed(bits)

    def write(writer: "Writer", value: float) -> None:
        write_signed(writer, int.from_bytes(_pack_bits(bits, value), "big", signed=True))

    return write


class VariableWriter(Writer):
    """Variable binary: integers as LEB128, signed ones zigzag, floats as integers of their bits."""

    __slots__ = ()

    short = _write_signed(16)
    ushort = _write_unsigned(16)
    integer = _write_signed(32)
    uinteger = _write_unsigned(32)
    long = _write_signed(64)
    ulong = _write_unsigned(64)
    single = _write_float_as_integer(32)
    double = _write_float_as_integer(64)


class SplitWriter(VariableWriter):
    """Split binary (CCSDS 524.2-B-1): Booleans and flags as leading bits, the rest variable."""

    __slots__ = ("_bit", "_bits")

    def __init__(self) -> None:
        super().__init__()
        self._bit = 0
        self._bits = bytearray()

    def boolean(self, value: bool) -> None:
        """Write the next bit, least significant first."""
        shift = self._bit % 8
        if not shift:
            self._bits.append(0)
        self._bits[-1] |= _checked(value) << shift
        self._bit += 1

    def finish(self) -> bytes:
        """Return the bits up to the last set one, then the other octets."""
        front = VariableWriter()
        front.blob(bytes(self._bits.rstrip(b"\0")))
        return b"".join((front.finish(), *self.pieces))


WRITERS: Final = {
    Encoding.FIXED: Writer,
    Encoding.VARIABLE: VariableWriter,
    Encoding.SPLIT: SplitWriter,
}


def _checked(value: bool) -> bool:
    if not isinstance(value, bool):
        raise EncodeError(f"expected a Boolean, not {value!r}")
    return value


def _pack_bits(bits: int, value: float) -> bytes:
    try:
        return _FLOATS[bits].pack(value)
    except struct.error as fault:
        raise EncodeError(str(fault)) from None
