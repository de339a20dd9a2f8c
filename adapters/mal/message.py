"""Messages on the wire: the header, always fixed binary, and cutting a stream by length."""

import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from adapters.mal.attribute_codec import METHODS, Reader, Writer
from adapters.mal.errors import DecodeError, EncodeError
from adapters.mal.specification import Operation, Stage
from adapters.mal.values import AttributeType, NamedValue, Typed

VERSION: Final = 1
_HEAD: Final = struct.Struct(">IBHHHBBqBB")
_STAGES: Final = tuple(Stage)
_LENGTH: Final = struct.Struct(">I")
_FROM, _TO, _TIMESTAMP, _AUTHENTICATION = 0x80, 0x40, 0x10, 0x01
_B2_FIELDS: Final = 0x2E
"""Priority, network zone, session name and domain: gone in 521.0-B-3, and not to be skipped."""
SHORTEST: Final = _HEAD.size + _LENGTH.size
"""Octets of the shortest message: no URI, no timestamp, no supplement, no body."""


@dataclass(frozen=True, slots=True)
class Header:
    """What a message says of itself.

    Attributes:
        stage: Which message of which pattern it is.
        transaction_id: The interaction it belongs to, chosen by the consumer; signed, 64 bits.
        from_uri: Who sent it.
        to_uri: Whom it is for.
        timestamp_ns: When it was sent, in ns since 1970 UTC, to the ms.
        supplements: Named attributes beside the body.
        authentication_id: Proof of who sent it; None if there is none.
        qos: Left over from 521.0-B-2; 1 by custom, and of no meaning.
        session: The same.
    """

    stage: Stage
    area: int
    service: int
    operation: int
    area_version: int
    transaction_id: int
    is_error: bool = False
    from_uri: str | None = None
    to_uri: str | None = None
    timestamp_ns: int | None = None
    supplements: tuple[NamedValue, ...] = ()
    authentication_id: bytes | None = None
    qos: int = 1
    session: int = 1

    @classmethod
    def of(
        cls,
        operation: Operation,
        stage: Stage,
        transaction_id: int,
        from_uri: str | None = None,
        to_uri: str | None = None,
        timestamp_ns: int | None = None,
        supplements: tuple[NamedValue, ...] = (),
    ) -> "Header":
        """A header addressed to an operation."""
        return cls(
            stage,
            operation.area,
            operation.service,
            operation.number,
            operation.area_version,
            transaction_id,
            False,
            from_uri,
            to_uri,
            timestamp_ns,
            supplements,
        )

    def reply(self, stage: Stage, *, is_error: bool = False) -> "Header":
        """The header of what answers this message."""
        return Header(
            stage,
            self.area,
            self.service,
            self.operation,
            self.area_version,
            self.transaction_id,
            is_error,
            self.to_uri,
            self.from_uri,
            time.time_ns(),
        )

    @property
    def flags(self) -> int:
        """The octet that says which of the optional fields are there."""
        return (
            (_FROM if self.from_uri is not None else 0)
            | (_TO if self.to_uri is not None else 0)
            | (_TIMESTAMP if self.timestamp_ns is not None else 0)
            | (_AUTHENTICATION if self.authentication_id is not None else 0)
        )


def encode_message(header: Header, body: bytes) -> bytes:
    """Put a header in front of a body.

    Raises:
        EncodeError: A header field does not fit.
    """
    writer = Writer()
    try:
        writer.length(len(header.supplements))
        for supplement in header.supplements:
            writer.string(supplement.name)
            writer.boolean(supplement.value is not None)
            if supplement.value is not None:
                writer.uoctet(supplement.value.type.value)
                getattr(writer, METHODS[supplement.value.type])(supplement.value.value)
        if header.from_uri is not None:
            writer.string(header.from_uri)
        if header.to_uri is not None:
            writer.string(header.to_uri)
        if header.timestamp_ns is not None:
            writer.time(header.timestamp_ns)
        if header.authentication_id is not None:
            writer.blob(header.authentication_id)
        rest = writer.finish()
        head = _HEAD.pack(
            _HEAD.size + len(rest) + len(body),
            VERSION << 5 | header.stage.value,
            header.area,
            header.service,
            header.operation,
            header.area_version,
            header.is_error << 7 | header.qos << 4 | header.session,
            header.transaction_id,
            header.flags,
            0,
        )
    except (struct.error, ArithmeticError, AttributeError, TypeError) as fault:
        raise EncodeError(f"header: {fault}") from fault
    return b"".join((head, rest, body))


def decode_message(message: bytes | memoryview) -> tuple[Header, bytes]:
    """Take a whole message apart.

    Returns:
        The header and the body.

    Raises:
        DecodeError: It has no header of this kind, or its length is another one.
    """
    reader = Reader(message)
    (length, kind, area, service, operation, version, bits, transaction_id, flags, encoding) = (
        _HEAD.unpack(reader.take(_HEAD.size))
    )
    if length != len(message):
        raise DecodeError(f"length {length} in a message of {len(message)} octets")
    if kind >> 5 != VERSION:
        raise DecodeError(f"header version {kind >> 5}, not {VERSION}")
    if kind & 0x1F >= len(_STAGES):
        raise DecodeError(f"no SDU type {kind & 0x1F}")
    if flags & _B2_FIELDS:
        raise DecodeError(f"flags {flags:#04x} announce fields that 521.0-B-3 does not have")
    if encoding:
        raise DecodeError(f"encoding id {encoding}, not 0")
    supplements = tuple([_supplement(reader) for _ in range(reader.elements())])
    header = Header(
        _STAGES[kind & 0x1F],
        area,
        service,
        operation,
        version,
        transaction_id,
        bool(bits & 0x80),
        reader.string() if flags & _FROM else None,
        reader.string() if flags & _TO else None,
        reader.time() if flags & _TIMESTAMP else None,
        supplements,
        reader.blob() if flags & _AUTHENTICATION else None,
        bits >> 4 & 0x7,
        bits & 0xF,
    )
    return header, bytes(message[reader.at :])


def _supplement(reader: Reader) -> NamedValue:
    name = reader.string()
    if not reader.boolean():
        return NamedValue(name=name)
    number = reader.uoctet()
    if not 1 <= number <= len(AttributeType):
        raise reader.fail(f"no attribute type has short form {number}")
    kind = AttributeType(number)
    return NamedValue(name=name, value=Typed(kind, getattr(reader, METHODS[kind])()))


MESSAGE_CAP: Final = 64 << 20
"""Octets of the longest message taken."""
_LEAST_ROOM: Final = 16 << 10
"""Octets of a new framer's buffer."""
_MOST_AT_ONCE: Final = 256 << 10
"""Octets that a buffer grows to because much comes; beyond that only for a longer message."""


class Framer:
    """Cuts a stream of octets into messages.

    The buffer is reused, and never much longer than what has arrived of a message.
    """

    def __init__(self, cap: int = MESSAGE_CAP) -> None:
        self._cap = cap
        self._buffer = memoryview(bytearray(_LEAST_ROOM))
        self._begin = 0
        self._end = 0

    def buffer(self) -> memoryview:
        """The free part of the buffer, at least one octet: the next octets go there."""
        return self._buffer[self._end :]

    def received(self, count: int) -> Iterator[memoryview]:
        """Yield the messages that are complete now that octets were put into `buffer`.

        Each is valid until the next one is asked for.

        Raises:
            DecodeError: These octets are no message; where the next begins is unknown.
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
        """Make room behind an incomplete message by moving it, into a longer buffer if need be."""
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
