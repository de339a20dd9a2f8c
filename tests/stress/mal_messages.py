"""Messages with something wrong in them, made from a specification.

Every operation and every message that a consumer may send has its turn, so that an operation that
the specification gains is covered by itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from random import Random
from typing import Any, Final

from hypothesis import strategies as st

from adapters.mal import (
    AttributeType,
    Codec,
    Encoding,
    Header,
    InteractionStage,
    NamedValue,
    Operation,
    Pattern,
    Specification,
    TypedAttribute,
    encode_message,
)
from adapters.mal.attribute_codec import WRITERS, Writer
from adapters.mal.codec import MIN_MESSAGE_OCTETS, TypeCodec
from adapters.mal.specification import REPLY
from adapters.mrs.spec import CommandHeader
from tests.mal.strategies import TEXT, VALUES, Strategies, integers
from tests.stress.fuzzing import COUNTS, examples, mutate

_SLIP: Final = 0.15
"""How likely a writer makes a mistake at a value, as long as it has made none."""
_NO_TEXT: Final = (b"\xff", b"\xc3(", b"\xed\xa0\x80", b"\xf5\x80\x80\x80", b"\0" * 300)
Mistake = Callable[[Random, Any, Sequence[int]], tuple[str, Any]]
_MISTAKES: Final[dict[str, Mistake]] = {
    "length": lambda random, count, _: (
        "length", random.choice((*COUNTS, max(count - 1, 0), count + 1))
    ),
    "boolean": lambda random, *_: ("uoctet", random.randrange(2, 256)),
    "uoctet": lambda random, *_: ("uoctet", random.randrange(256)),
    "ushort": lambda random, *_: ("ushort", random.choice((0, 0xFFFF))),
    "uinteger": lambda random, *_: ("uinteger", random.choice(COUNTS)),
    "long": lambda random, value, ids: ("long", random.choice((*ids, 0, -1, value ^ 1))),
    "double": lambda random, *_: ("double", random.choice((1e300, -3.0, 0.0))),
    "string": lambda random, *_: ("blob", random.choice(_NO_TEXT)),
    "finetime": lambda *_: ("ones", 10),
    "time": lambda *_: ("ones", 6),
}  # fmt: skip
"""What a writer writes in place of each: lengths, flags, numbers, type ids, text."""


class FaultyWriter(Writer):
    """Makes one mistake at most.

    Attributes:
        slipped: whether it was made.
    """

    random: Random
    type_ids: Sequence[int]
    slipped = False

    def ones(self, count: int) -> None:
        for _ in range(count):
            self.uoctet(0xFF)


def _faulty(kind: type[Writer]) -> type[FaultyWriter]:
    def method(name: str, mistake: Mistake) -> Callable[[FaultyWriter, Any], None]:
        write = getattr(kind, name)

        def write_or_slip(self: FaultyWriter, value: Any) -> None:
            if self.slipped or self.random.random() > _SLIP:
                write(self, value)
            else:
                self.slipped = True
                instead, wrong = mistake(self.random, value, self.type_ids)
                getattr(self, instead)(wrong)

        return write_or_slip

    methods = {name: method(name, mistake) for name, mistake in _MISTAKES.items()}
    return type("Faulty" + kind.__name__, (FaultyWriter, kind), methods)


FAULTY_WRITERS: Final = {encoding: _faulty(writer) for encoding, writer in WRITERS.items()}


EACH: Final = 6
"""Sound messages of each kind that are kept for being mutated."""
RENEWED: Final = 50_000
"""Mutated messages after which others are kept."""
TIMELY: Final = 0.7
"""Part of the commands whose time has come and is not over."""
_KIND, _AREA, _BITS, _TRANSACTION, _FLAGS = 4, 5, 12, 13, 21
"""Where the fields of a header begin."""
Start = tuple[Operation, InteractionStage]


def starts_of(specification: Specification) -> list[Start]:
    """Return every operation, with each stage of it that a consumer begins."""
    return [
        (operation, stage)
        for area in specification.areas
        for service in area.services
        for operation in service.operations
        for stage in operation.parts
        if stage in REPLY or stage is InteractionStage.SEND
    ]


@dataclass(frozen=True, slots=True)
class Sound:
    """A message as it should be.

    Attributes:
        head: the header, its transaction id to be written over.
    """

    operation: Operation
    stage: InteractionStage
    values: tuple[Any, ...]
    head: bytes
    body: bytes


@cache
def _values(
    specification: Specification, tokens: tuple[str, ...], seed: int
) -> tuple[list[list[tuple[Any, ...]]], list[TypedAttribute]]:
    """Return the parts of some messages of each start, and attributes of any type."""
    # What makes sense comes more often than what only the types allow.
    text = st.sampled_from(tokens) | st.sampled_from(tokens) | TEXT
    near, small = st.floats(-3.0, 3.0), st.integers(1, 100)
    number = near | near | near | st.floats()
    strategies = Strategies(
        specification,
        {
            AttributeType.STRING: text,
            AttributeType.IDENTIFIER: text,
            AttributeType.URI: text,
            AttributeType.BLOB: text.map(str.encode) | VALUES[AttributeType.BLOB],
            AttributeType.FLOAT: st.floats(width=32),
            AttributeType.DOUBLE: number,
            AttributeType.DURATION: number,
            AttributeType.LONG: small | small | integers(64, True),
            AttributeType.UINTEGER: small | integers(32, False),
        },
    )
    values = [
        examples(st.tuples(*map(strategies.field, operation.parts[stage])), EACH, seed + index)
        for index, (operation, stage) in enumerate(starts_of(specification))
    ]
    return values, examples(strategies.typed, 50, seed)


class Messages:
    """Makes messages, the same ones for the same seed.

    Args:
        uri: the provider that they are for.
        tokens: texts that mean something there.
    """

    def __init__(
        self,
        specification: Specification,
        encoding: Encoding,
        seed: int,
        uri: str,
        tokens: tuple[str, ...],
    ) -> None:
        self._random = random = Random(seed)
        self._specification, self._tokens, self._seed = specification, tokens, seed
        self._uris = (uri, uri + "Broker", uri.replace("MRS", "mrs"), "", "maltcp://", "x" * 5000)
        self._codec = Codec(specification, encoding)
        self._types = TypeCodec(specification, encoding)
        self._writer = FAULTY_WRITERS[encoding]
        self._type_ids = tuple(
            number
            for bound in specification.types.values()
            for number in (bound.type_id, bound.list_id)
            if number is not None
        )
        self._transaction = self._made = 0
        self._mutations = (
            [self._slip] * 40
            + [self._mutated_body] * 20
            + [self._other_body, self._other_address, self._other_stage, self._other_uri] * 3
            + [self._cut_body, self._same_transaction, self._two_in_one] * 2
            + [self._head_octet, self._no_request, self._cut_short, self._other_length]
        )
        self._fill()
        random.shuffle(self._pool)

    def mutated(self) -> bytes:
        """Return a message with something wrong in it; by chance it may be sound all the same."""
        self._made += 1
        if self._made % RENEWED == 0:
            self._seed += 1
            self._fill()
        return self._random.choice(self._mutations)(self._random.choice(self._pool))

    def storming(self) -> bytes:
        """Return a sound registration, deregistration or publication."""
        return self._whole(self._random.choice(self._storms))

    def valid(self) -> bytes:
        """Return any sound message, which may well move the rover."""
        sound = self._random.choice(self._pool)
        return self._whole(sound, body=self._body(sound))

    def status_request(self) -> bytes:
        """Return a request as a good client sends it."""
        operation = self._specification.operation("Status", "getStatus")
        return self._whole(self._sound(operation, InteractionStage.REQUEST, (), []))

    def _fill(self) -> None:
        values, attributes = _values(self._specification, self._tokens, self._seed)
        self._pool = [
            self._sound(operation, stage, each, attributes)
            for (operation, stage), some in zip(starts_of(self._specification), values, strict=True)
            for each in some
        ]
        self._storms = [s for s in self._pool if s.operation.pattern is Pattern.PUBSUB]
        self._bodies = [sound.body for sound in self._pool if sound.body]

    def _sound(
        self,
        operation: Operation,
        stage: InteractionStage,
        values: tuple[Any, ...],
        others: list[TypedAttribute],
    ) -> Sound:
        random, supplements = self._random, tuple[NamedValue, ...]()
        match random.randrange(10) if others else None:
            case 0:
                arrival = random.choice(("append", "replace", "later"))
                value = TypedAttribute(AttributeType.IDENTIFIER, arrival)
                supplements = (NamedValue(name="preemption", value=value),)
            case 1:
                supplements = (NamedValue(name="other", value=random.choice(others)),)
            case _:
                pass
        uri = self._uris[operation.pattern is Pattern.PUBSUB]
        from_uri = random.choice(("maltcp://127.0.0.1:1/fuzz", "maltcp://127.0.0.1:2/other", None))
        timestamp_ns = random.choice((None, 1_800_000_000_000_000_000))
        header = Header.of(operation, stage, 0, from_uri, uri, timestamp_ns, supplements)
        body = self._codec.encode(operation.parts[stage], values)
        return Sound(operation, stage, values, encode_message(header, b""), body)

    def _whole(self, sound: Sound, head: bytes | None = None, body: bytes | None = None) -> bytes:
        """A message with its own transaction id and its true length."""
        self._transaction += 1
        head = sound.head if head is None else head
        body = sound.body if body is None else body
        length = (len(head) + len(body)).to_bytes(4, "big")
        number = self._transaction.to_bytes(8, "big")
        return length + head[4:_TRANSACTION] + number + head[_FLAGS:] + body

    def _body(self, sound: Sound) -> bytes:
        return self._codec.encode(sound.operation.parts[sound.stage], self._renumbered(sound))

    def _renumbered(self, sound: Sound) -> tuple[Any, ...]:
        """The parts of a message; a command is another one each time, else it is a duplicate."""
        values = sound.values
        if not (values and isinstance(values[0], CommandHeader)):
            return values
        new: dict[str, Any] = {"commandId": self._transaction}
        if self._random.random() < TIMELY:
            new |= {"source": "MOE", "lifetime": None, "creationTime": None}
        return replace(values[0], **new), *values[1:]

    def _slip(self, sound: Sound) -> bytes:
        writer = self._writer()
        writer.random, writer.type_ids = self._random, self._type_ids
        parts = sound.operation.parts[sound.stage]
        for part, value in zip(parts, self._renumbered(sound), strict=True):
            self._types.part(part).write(writer, value)
        return self._whole(sound, body=writer.finish()) if writer.slipped else self.mutated()

    def _mutated_body(self, sound: Sound) -> bytes:
        return self._whole(sound, body=mutate(self._body(sound), self._random, self._bodies))

    def _cut_body(self, sound: Sound) -> bytes:
        return self._whole(sound, body=sound.body[: self._random.randint(0, len(sound.body))])

    def _other_body(self, sound: Sound) -> bytes:
        return self._whole(sound, body=self._random.choice(self._pool).body)

    def _other_address(self, sound: Sound) -> bytes:
        at, head = self._random.randrange(_AREA, _BITS), bytearray(sound.head)
        head[at] = self._random.choice((0, 1, 2, head[at] ^ 1, 255))
        return self._whole(sound, head=bytes(head))

    def _other_stage(self, sound: Sound) -> bytes:
        head = bytearray(sound.head)
        head[_KIND] = 1 << 5 | self._random.choice((InteractionStage.SEND, *REPLY)).value
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
        at, message = (
            self._random.randrange(_KIND, MIN_MESSAGE_OCTETS),
            bytearray(self._whole(sound)),
        )
        message[at] = self._random.randrange(256)
        return bytes(message)

    def _no_request(self, sound: Sound) -> bytes:
        """A reply, a notification or an error where a request should be."""
        head = bytearray(sound.head)
        if self._random.random() < 0.5:
            head[_KIND] = 1 << 5 | self._random.choice(tuple(InteractionStage)).value
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
