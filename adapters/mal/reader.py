"""Strict readers: octets to attribute values, one class for each encoding."""

import struct

from adapters.mal.encoding import DAY_MS, EPOCH_DAYS, MAX_DEPTH, MAX_ELEMENTS, MS_NS, Encoding
from adapters.mal.errors import DecodeError
from adapters.mal.values import ObjectRef

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
