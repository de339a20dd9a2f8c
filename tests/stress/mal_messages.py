"""Writers that make mistakes where the structure is: lengths, flags, numbers, type ids, text."""

from dataclasses import dataclass
from random import Random
from typing import Final, Self

from adapters.mal import (
    AttributeType,
    Codec,
    Encoding,
    Header,
    NamedValue,
    Operation,
    Pattern,
    Specification,
    Stage,
    Typed,
    encode_message,
)
from adapters.mal.attribute_codec import READERS, WRITERS, SplitWriter, VariableWriter, Writer
from adapters.mal.codec import TypeCodec
from adapters.mal.message import SHORTEST
from adapters.mal.specification import REPLY
from tests.stress.random_values import Values

_SLIP: Final = 0.15
"""How likely a writer makes a mistake at a value, as long as it has made none."""
_COUNTS: Final = (0, 1, 0x7F, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_NO_TEXT: Final = (b"\xff", b"\xc3(", b"\xed\xa0\x80", b"\xf5\x80\x80\x80", b"\0" * 300)


class _FaultyWriter(Writer):
    """Makes one mistake at most; what follows it is written as it should be.

    Attributes:
        slipped: whether the mistake was made.
    """

    _random: Random
    _type_ids: tuple[int, ...]
    slipped: bool

    @classmethod
    def begin(cls, random: Random, type_ids: tuple[int, ...]) -> Self:
        """Return a writer that takes wrong type ids from the right ones of others."""
        writer = cls()
        writer._random, writer._type_ids, writer.slipped = random, type_ids, False
        return writer

    def _slips(self) -> bool:
        if self.slipped or self._random.random() > _SLIP:
            return False
        self.slipped = True
        return True

    def length(self, count: int) -> None:
        if self._slips():
            count = self._random.choice((*_COUNTS, max(count - 1, 0), count + 1))
        super().length(count)

    def boolean(self, value: bool) -> None:
        if self._slips():
            super().uoctet(self._random.randrange(2, 256))
        else:
            super().boolean(value)

    def uoctet(self, value: int) -> None:
        super().uoctet(self._random.randrange(256) if self._slips() else value)

    def ushort(self, value: int) -> None:
        super().ushort(self._random.choice((0, 0xFFFF)) if self._slips() else value)

    def uinteger(self, value: int) -> None:
        super().uinteger(self._random.choice(_COUNTS) if self._slips() else value)

    def long(self, value: int) -> None:
        if self._slips():
            value = self._random.choice((*self._type_ids, 0, -1, value ^ 1))
        super().long(value)

    def double(self, value: float) -> None:
        super().double(self._random.choice((1e300, -3.0, 0.0)) if self._slips() else value)

    def string(self, value: str) -> None:
        if self._slips():
            super().blob(self._random.choice(_NO_TEXT))
        else:
            super().string(value)

    def finetime(self, value: int) -> None:
        if self._slips():
            self._ones(10)
        else:
            super().finetime(value)

    def time(self, value: int) -> None:
        if self._slips():
            self._ones(6)
        else:
            super().time(value)

    def _ones(self, octets: int) -> None:
        for _ in range(octets):
            super().uoctet(0xFF)


class _Fixed(_FaultyWriter):
    pass


class _Variable(_FaultyWriter, VariableWriter):
    pass


class _Split(_FaultyWriter, SplitWriter):
    pass


FAULTY_WRITERS: Final[dict[Encoding, type[_FaultyWriter]]] = {
    Encoding.FIXED: _Fixed,
    Encoding.VARIABLE: _Variable,
    Encoding.SPLIT: _Split,
}
"""The crooked writer of each encoding."""


POOL: Final = 400
"""Sound messages kept for being mutated."""
FRESH: Final = 0.25
"""How often a new one takes the place of one in the pool."""
_EXTREMES: Final = (
    b"\0\0\0\0",
    b"\0\0\0\1",
    b"\x7f\xff\xff\xff",
    b"\x80\0\0\0",
    b"\xff\xff\xff\xff",
)
_KIND, _AREA, _BITS, _TRANSACTION, _FLAGS = 4, 5, 12, 13, 21
"""Where the fields of a header begin."""


@dataclass(frozen=True, slots=True)
class Sound:
    """A message as it should be.

    Attributes:
        head: the header, its transaction id to be written over.
    """

    operation: Operation
    stage: Stage
    head: bytes
    body: bytes


class Messages:
    """Makes messages, the same ones for the same random generator.

    Args:
        uri: the provider that they are for.
        words: texts that mean something there.
    """

    def __init__(
        self,
        specification: Specification,
        encoding: Encoding,
        random: Random,
        uri: str,
        words: tuple[str, ...],
    ) -> None:
        """Fill the pool."""
        self._random = random
        self._uris = (uri, uri + "Broker", uri.replace("MRS", "mrs"), "", "maltcp://", "x" * 5000)
        self._values = Values(specification, random, (*words, uri))
        self._codec = Codec(specification, encoding)
        self._types = TypeCodec(specification, READERS[encoding], WRITERS[encoding])
        self._crooked = FAULTY_WRITERS[encoding]
        self._type_ids = tuple(
            number
            for bound in specification.types.values()
            for number in (bound.type_id, bound.list_id)
            if number is not None
        )
        self._starts = [
            (operation, stage)
            for area in specification.areas
            for service in area.services
            for operation in service.operations
            for stage in operation.parts
            if stage in REPLY or stage is Stage.SEND
        ]
        self._storms = [start for start in self._starts if start[0].pattern is Pattern.PUBSUB]
        self._transaction = 0
        self._ways = (
            [self._slip] * 40
            + [self._flip, self._flip, self._insert, self._remove, self._repeat, self._extreme] * 3
            + [self._other_body, self._other_address, self._other_stage, self._other_uri] * 3
            + [self._cut_body, self._same_transaction, self._two_in_one] * 2
            + [self._head_octet, self._no_request, self._cut_short, self._other_length]
        )
        self._pool = [self._sound(*random.choice(self._starts)) for _ in range(POOL)]

    def mutated(self) -> bytes:
        """Return a message with something wrong in it; by chance it may be sound all the same."""
        random = self._random
        if random.random() < FRESH:
            self._pool[random.randrange(POOL)] = self._sound(*random.choice(self._starts))
        return random.choice(self._ways)(random.choice(self._pool))

    def storming(self) -> bytes:
        """Return a sound registration, deregistration or publication."""
        return self._whole(self._sound(*self._random.choice(self._storms)))

    def calm(self) -> bytes:
        """Return any sound message, which may well move the rover."""
        return self._whole(self._sound(*self._random.choice(self._starts)))

    def sound(self, service: str, operation: str, stage: Stage) -> bytes:
        """Return a message as it should be."""
        found = next(
            (known, begin)
            for known, begin in self._starts
            if (known.service_name, known.name, begin) == (service, operation, stage)
        )
        return self._whole(self._sound(*found))

    def _sound(self, operation: Operation, stage: Stage) -> Sound:
        random, parts = self._random, operation.parts[stage]
        uri = self._uris[operation.pattern is Pattern.PUBSUB]
        supplements: tuple[NamedValue, ...] = ()
        match random.randrange(10):
            case 0:
                arrival = random.choice(("append", "replace", "later"))
                value = Typed(AttributeType.IDENTIFIER, arrival)
                supplements = (NamedValue(name="arrival", value=value),)
            case 1:
                supplements = (NamedValue(name="other", value=self._values.attribute()),)
            case _:
                pass
        from_uri = random.choice(("maltcp://127.0.0.1:1/fuzz", "maltcp://127.0.0.1:2/other", None))
        timestamp_ns = random.choice((None, 1_800_000_000_000_000_000))
        header = Header.of(operation, stage, 0, from_uri, uri, timestamp_ns, supplements)
        body = self._codec.encode(parts, [self._values.of(part) for part in parts])
        return Sound(operation, stage, encode_message(header, b""), body)

    def _whole(self, sound: Sound, head: bytes | None = None, body: bytes | None = None) -> bytes:
        """A message with its own transaction id and its true length."""
        self._transaction += 1
        head = sound.head if head is None else head
        body = sound.body if body is None else body
        length = (len(head) + len(body)).to_bytes(4, "big")
        number = self._transaction.to_bytes(8, "big")
        return length + head[4:_TRANSACTION] + number + head[_FLAGS:] + body

    def _slip(self, sound: Sound) -> bytes:
        parts = sound.operation.parts[sound.stage]
        writer = self._crooked.begin(self._random, self._type_ids)
        for part in parts:
            self._types.part(part).write(writer, self._values.of(part))
        if not writer.slipped:
            return self._flip(sound)
        return self._whole(sound, body=writer.finish())

    def _flip(self, sound: Sound) -> bytes:
        if not sound.body:
            return self._insert(sound)
        at, body = self._random.randrange(len(sound.body)), bytearray(sound.body)
        body[at] ^= 1 << self._random.randrange(8)
        return self._whole(sound, body=bytes(body))

    def _insert(self, sound: Sound) -> bytes:
        at, body = self._random.randint(0, len(sound.body)), sound.body
        new = self._random.randbytes(self._random.randrange(1, 9))
        return self._whole(sound, body=body[:at] + new + body[at:])

    def _remove(self, sound: Sound) -> bytes:
        at, body = self._random.randint(0, len(sound.body)), sound.body
        return self._whole(sound, body=body[:at] + body[at + self._random.randrange(1, 9) :])

    def _repeat(self, sound: Sound) -> bytes:
        body = sound.body
        first, last = sorted(self._random.randint(0, len(body)) for _ in range(2))
        return self._whole(sound, body=body[:last] + body[first:last] * 2 + body[last:])

    def _extreme(self, sound: Sound) -> bytes:
        at, body = self._random.randint(0, len(sound.body)), sound.body
        count = self._random.choice(_EXTREMES)
        return self._whole(sound, body=body[:at] + count + body[at + 4 :])

    def _cut_body(self, sound: Sound) -> bytes:
        return self._whole(sound, body=sound.body[: self._random.randint(0, len(sound.body))])

    def _other_body(self, sound: Sound) -> bytes:
        other = self._random.choice(self._pool)
        return self._whole(sound, body=other.body)

    def _other_address(self, sound: Sound) -> bytes:
        at, head = self._random.randrange(_AREA, _BITS), bytearray(sound.head)
        head[at] = self._random.choice((0, 1, 2, head[at] ^ 1, 255))
        return self._whole(sound, head=bytes(head))

    def _other_stage(self, sound: Sound) -> bytes:
        head = bytearray(sound.head)
        head[_KIND] = 1 << 5 | self._random.choice((Stage.SEND, *REPLY)).value
        return self._whole(sound, head=bytes(head))

    def _other_uri(self, sound: Sound) -> bytes:
        uri, stage = self._random.choice(self._uris), sound.stage
        header = Header.of(sound.operation, stage, 0, to_uri=uri or None)
        return self._whole(sound, head=encode_message(header, b""))

    def _same_transaction(self, sound: Sound) -> bytes:
        self._transaction -= self._transaction > 0
        return self._whole(sound)

    def _two_in_one(self, sound: Sound) -> bytes:
        return self._whole(sound, body=sound.body + self._whole(self._random.choice(self._pool)))

    def _head_octet(self, sound: Sound) -> bytes:
        at, message = self._random.randrange(_KIND, SHORTEST), bytearray(self._whole(sound))
        message[at] = self._random.randrange(256)
        return bytes(message)

    def _no_request(self, sound: Sound) -> bytes:
        """A reply, a notification or an error where a request should be."""
        head = bytearray(sound.head)
        if self._random.random() < 0.5:
            head[_KIND] = 1 << 5 | self._random.choice(tuple(Stage)).value
        else:
            head[_BITS] |= 0x80
        return self._whole(sound, head=bytes(head))

    def _cut_short(self, sound: Sound) -> bytes:
        message = self._whole(sound)
        return message[: self._random.randrange(1, len(message))]

    def _other_length(self, sound: Sound) -> bytes:
        message = self._whole(sound)
        wrong = max(len(message) + self._random.choice((-9, -1, 1, 9, 1 << 20, 1 << 29)), 0)
        return wrong.to_bytes(4, "big") + message[4:]
