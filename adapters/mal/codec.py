"""`Codec` of MAL messages: the header, always fixed binary, and bodies of any type."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final, NamedTuple

from adapters.mal.attribute_codec import (
    MAX_ELEMENTS,
    METHODS,
    READERS,
    WRITERS,
    Encoding,
    Reader,
    Writer,
)
from adapters.mal.errors import DecodeError, EncodeError, MalError, StandardError
from adapters.mal.specification import (
    ATTRIBUTE,
    ATTRIBUTES,
    ELEMENT,
    BoundType,
    CompositeType,
    EnumerationType,
    Field,
    InteractionStage,
    Operation,
    Specification,
    TypeRef,
    python_name,
    type_id,
)
from adapters.mal.values import AttributeType, NamedValue, TypedAttribute, TypedList

Read = Callable[[Any], Any]
Write = Callable[[Any, Any], None]
_UNFIT = (EncodeError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""Exceptions of an encoder for a value that does not fit."""
_MIXED = 0
"""Type id of a list whose elements each have their own type."""


class TypeFunctions(NamedTuple):
    """Functions that read a type from a Reader and write it to a Writer."""

    read: Read
    write: Write


@dataclass(frozen=True, slots=True)
class _Announced:
    """A type that a type id can identify."""

    type_id: int
    ref: TypeRef
    ancestors: frozenset[TypeRef]
    kind: AttributeType | type[Any] | None


def write_named(name: str, write: Write, writer: Writer, value: Any) -> None:
    """Write a value; the error names it.

    Raises:
        EncodeError: The value does not fit.
    """
    try:
        write(writer, value)
    except _UNFIT as fault:
        what = "must not be NULL" if value is None else fault
        raise EncodeError(f"{name}: {what}") from None


class TypeCodec:
    """Readers and writers of all types of a specification in one encoding.

    All composites are built in the constructor: they refer to each other, and threads share them.
    """

    def __init__(self, specification: Specification, encoding: Encoding) -> None:
        reader, writer = READERS[encoding], WRITERS[encoding]
        self._types = specification.types
        self._attribute = TypeFunctions(reader.attribute, writer.attribute)
        self._codes = {
            ref: TypeFunctions(getattr(reader, METHODS[kind]), getattr(writer, METHODS[kind]))
            for ref, kind in ATTRIBUTES.items()
        }
        self._announced = {known.type_id: known for known in _announced(specification)}
        self._by_kind = {
            (known.kind, known.ref.is_list): known for known in self._announced.values()
        }
        self._parts: dict[int, tuple[tuple[Field, ...], tuple[TypeFunctions, ...]]] = {}
        for ref in self._types:
            self._functions_of(ref)

    def parts(self, parts: tuple[Field, ...]) -> tuple[TypeFunctions, ...]:
        """Return the codes of parts, cached by identity: hashing them is as slow as decoding."""
        known = self._parts.get(id(parts))
        if known is None:
            known = self._parts[id(parts)] = parts, tuple(map(self.part, parts))
        return known[1]

    def part(self, part: Field) -> TypeFunctions:
        """Return the codes of a message part."""
        mixed = part.type.is_list and self._is_abstract(part.type)
        codes = self._functions_of(part.type)
        return _nullable(_mixed_part(codes) if mixed else codes, part.nullable)

    def _field(self, field: Field) -> TypeFunctions:
        codes = self._attribute if field.type == ATTRIBUTE else self._functions_of(field.type)
        return _nullable(codes, field.nullable)

    def _is_abstract(self, ref: TypeRef) -> bool:
        plain = replace(ref, is_list=False)
        bound = self._types.get(plain)
        return bound.type_id is None if bound else plain not in ATTRIBUTES

    def _functions_of(self, ref: TypeRef) -> TypeFunctions:
        if ref not in self._codes:
            self._codes[ref] = self._make_functions(ref)
        return self._codes[ref]

    def _make_functions(self, ref: TypeRef) -> TypeFunctions:
        if ref.is_list:
            element = self._functions_of(replace(ref, is_list=False))
            return _list(_nullable(element, self._is_abstract(ref)))
        if self._is_abstract(ref):
            return self._by_type_id(ref)
        bound = self._types[ref]
        match bound.definition:
            case EnumerationType():
                return self._enumeration(bound)
            case CompositeType():
                return self._composite(ref, bound)

    def _enumeration(self, bound: BoundType) -> TypeFunctions:
        members: dict[int, Any] = {member.value: member for member in bound.cls}
        width = (
            "UOctet"
            if len(members) < 1 << 8
            else "UShort"
            if len(members) < 1 << 16
            else "UInteger"
        )
        read_number, write_number = self._codes[TypeRef("MAL", width)]

        def read(reader: Reader) -> Any:
            number = read_number(reader)
            if number not in members:
                raise reader.fail(f"{bound.definition.name} has no item {number}")
            return members[number]

        def write(writer: Writer, value: Any) -> None:
            if not isinstance(value, bound.cls):
                raise EncodeError(f"expected a {bound.definition.name}, not {value!r}")
            write_number(writer, value.value)

        return TypeFunctions(read, write)

    def _composite(self, ref: TypeRef, bound: BoundType) -> TypeFunctions:
        plan: list[tuple[str, Read, Write]] = []

        def read(reader: Reader) -> Any:
            reader.enter()
            value = bound.cls(**{name: read_field(reader) for name, read_field, _ in plan})
            reader.leave()
            return value

        def write(writer: Writer, value: Any) -> None:
            if type(value) is not bound.cls:
                raise EncodeError(f"expected a {ref.name}, not {value!r}")
            for name, _, write_field in plan:
                write_named(name, write_field, writer, getattr(value, name))

        self._codes[ref] = codes = TypeFunctions(read, write)
        for field in bound.fields:
            plan.append((python_name(field.name), *self._field(field)))
        return codes

    def _by_type_id(self, base: TypeRef) -> TypeFunctions:
        """Return the codes of an element with its type id, of a subtype of `base`."""

        def read(reader: Reader) -> Any:
            number = reader.long()
            known = self._announced.get(number)
            reader.enter()
            value: Any
            if number == _MIXED and base == ELEMENT:
                value = TypedList(
                    None, self._functions_of(TypeRef("MAL", "Element", is_list=True)).read(reader)
                )
            elif known is None or base not in known.ancestors:
                raise reader.fail(f"no {base.name} has type id {number}")
            else:
                value = self._functions_of(known.ref).read(reader)
                if known.ref.is_list:
                    value = TypedList(known.kind, value)
                elif isinstance(known.kind, AttributeType):
                    value = TypedAttribute(known.kind, value)
            reader.leave()
            return value

        def write(writer: Writer, value: Any) -> None:
            match value:
                case TypedList(type=None) if base == ELEMENT:
                    writer.long(_MIXED)
                    self._functions_of(TypeRef("MAL", "Element", is_list=True)).write(
                        writer, value.values
                    )
                    return
                case TypedList():
                    known, content = self._by_kind.get((value.type, True)), value.values
                case TypedAttribute():
                    known, content = self._by_kind.get((value.type, False)), value.value
                case _:
                    known, content = self._by_kind.get((type(value), False)), value
            if known is None or base not in known.ancestors:
                raise EncodeError(f"expected a {base.name}, not {value!r}")
            writer.long(known.type_id)
            self._functions_of(known.ref).write(writer, content)

        return TypeFunctions(read, write)


def _announced(specification: Specification) -> list[_Announced]:
    elements = frozenset({ELEMENT})
    found = []
    for ref, kind in ATTRIBUTES.items():
        ids = [type_id(1, 3, kind.value, is_list=is_list) for is_list in (False, True)]
        found.append(_Announced(ids[0], ref, elements | {ATTRIBUTE}, kind))
        found.append(_Announced(ids[1], replace(ref, is_list=True), elements, kind))
    for ref, bound in specification.types.items():
        if bound.type_id is not None and bound.list_id is not None:
            found.append(_Announced(bound.type_id, ref, bound.ancestors, bound.cls))
            found.append(_Announced(bound.list_id, replace(ref, is_list=True), elements, bound.cls))
    return found


def _list(element: TypeFunctions) -> TypeFunctions:
    read_element, write_element = element

    def read(reader: Reader) -> tuple[Any, ...]:
        return tuple([read_element(reader) for _ in range(reader.elements())])

    def write(writer: Writer, values: Any) -> None:
        if isinstance(values, str | bytes):
            raise EncodeError(f"expected a list, not {values!r}")
        writer.length(len(values))
        for index, value in enumerate(values):
            write_named(f"[{index}]", write_element, writer, value)

    return TypeFunctions(read, write)


def _nullable(codes: TypeFunctions, nullable: bool) -> TypeFunctions:
    if not nullable:
        return codes
    read_value, write_value = codes

    def read(reader: Reader) -> Any:
        return read_value(reader) if reader.boolean() else None

    def write(writer: Writer, value: Any) -> None:
        writer.boolean(value is not None)
        if value is not None:
            write_value(writer, value)

    return TypeFunctions(read, write)


def _mixed_part(codes: TypeFunctions) -> TypeFunctions:
    """Return the codes of a list of an abstract type as a message part, after the mixed type id."""

    def read(reader: Reader) -> Any:
        number = reader.long()
        if number != _MIXED:
            raise reader.fail(f"type id {number} at the start of a list of mixed types")
        return codes.read(reader)

    def write(writer: Writer, value: Any) -> None:
        writer.long(_MIXED)
        codes.write(writer, value)

    return TypeFunctions(read, write)


_type_codec = lru_cache(maxsize=8)(TypeCodec)
"""Cached for all connections: a process has one or two specifications."""

ERROR_PARTS: Final = (
    Field("number", TypeRef("MAL", "UInteger")),
    Field("extraInformation", TypeRef("MAL", "Element"), nullable=True),
)
"""Parts of every error message."""


class Codec:
    """Encodes and decodes bodies of one specification, with at most `elements` list elements."""

    def __init__(
        self,
        specification: Specification,
        encoding: Encoding = Encoding.FIXED,
        elements: int = MAX_ELEMENTS,
    ) -> None:
        self._elements = elements
        self._reader = READERS[encoding]
        self._writer = WRITERS[encoding]
        self._types = _type_codec(specification, encoding)

    def decode(self, parts: tuple[Field, ...], body: bytes) -> tuple[Any, ...]:
        """Decode the parts of a message.

        Raises:
            DecodeError: The body is not exactly one value of each part.
        """
        if not parts:
            if body:
                raise DecodeError(f"{len(body)} octets, but the message has no parts")
            return ()
        reader = self._reader(body, elements=self._elements)
        values = []
        for codes, part in zip(self._types.parts(parts), parts, strict=True):
            try:
                values.append(codes.read(reader))
            except DecodeError as fault:
                raise DecodeError(f"{part.name}: {fault}") from None
        reader.finish()
        return tuple(values)

    def encode(self, parts: tuple[Field, ...], values: Sequence[Any]) -> bytes:
        """Encode the parts of a message.

        Raises:
            EncodeError: A value does not fit its part, or the number of values differs.
        """
        if len(values) != len(parts):
            raise EncodeError(f"{len(parts)} parts expected, {len(values)} given")
        if not parts:
            return b""
        writer = self._writer()
        for codes, part, value in zip(self._types.parts(parts), parts, values, strict=True):
            write_named(part.name, codes.write, writer, value)
        return writer.finish()

    def decode_error(self, body: bytes) -> MalError:
        """Decode the body of a message with the is-error bit.

        Raises:
            DecodeError: The body is no error body.
        """
        return MalError(*self.decode(ERROR_PARTS, body))

    def encode_error(self, error: MalError) -> bytes:
        """Encode the body of an error.

        Raises:
            EncodeError: The number or the extra information does not fit.
        """
        return self.encode(ERROR_PARTS, (error.number, error.extra))


VERSION: Final = 1
_HEAD: Final = struct.Struct(">IBHHHBBqBB")
_STAGES: Final = tuple(InteractionStage)
_LENGTH: Final = struct.Struct(">I")
_FROM, _TO, _TIMESTAMP, _AUTHENTICATION = 0x80, 0x40, 0x10, 0x01
_B2_FIELDS: Final = 0x2E
"""Priority, network zone, session name and domain: removed in 521.0-B-3, so not accepted."""
_SUPPLEMENT_CAP: Final = 256
"""Maximum supplements and parts of them in one header."""
_COPIED_OCTETS: Final = 4096
"""Maximum octets of a message that is copied first, since many small views are slower."""
MIN_MESSAGE_OCTETS: Final = _HEAD.size + _LENGTH.size
"""Octets of the minimum message: no URI, no timestamp, no supplement, no body."""


@dataclass(frozen=True, slots=True)
class Header:
    """Message header (CCSDS 521.0-B-3, octets as in mo-services-java 12).

    Attributes:
        stage: Message of an interaction pattern; the SDU type.
        transaction_id: Id of the interaction, chosen by the consumer; signed, 64 bits.
        timestamp_ns: Time of sending in ns since 1970 UTC, to the ms.
        supplements: Named attributes in addition to the body.
        authentication_id: Credentials of the sender, or None.
        qos: Remainder of 521.0-B-2; conventionally 1, without meaning.
        session: The same.
    """

    stage: InteractionStage
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
        stage: InteractionStage,
        transaction_id: int,
        from_uri: str | None = None,
        to_uri: str | None = None,
        timestamp_ns: int | None = None,
        supplements: tuple[NamedValue, ...] = (),
    ) -> "Header":
        """Return a header that addresses an operation."""
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

    def addressed(self, specification: Specification) -> Operation:
        """Return the addressed operation with this stage.

        Raises:
            MalError: Unsupported area, area version, service or operation.
        """
        operation = specification.resolve(
            self.area, self.area_version, self.service, self.operation
        )
        if self.stage not in operation.parts:
            raise MalError(StandardError.UNSUPPORTED_OPERATION)
        return operation

    def reply(
        self, stage: InteractionStage, timestamp_ns: int, *, is_error: bool = False
    ) -> "Header":
        """Return the header of a reply to this message, with this timestamp."""
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
            timestamp_ns,
        )

    @property
    def flags(self) -> int:
        """The octet of presence flags of the optional fields."""
        return (
            (_FROM if self.from_uri is not None else 0)
            | (_TO if self.to_uri is not None else 0)
            | (_TIMESTAMP if self.timestamp_ns is not None else 0)
            | (_AUTHENTICATION if self.authentication_id is not None else 0)
        )


def encode_message(header: Header, body: bytes) -> bytes:
    """Return the octets of header and body.

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
                writer.attribute(supplement.value)
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


def encode_timestamp(timestamp_ns: int) -> bytes:
    """Return a time in the encoding of headers."""
    writer = Writer()
    writer.time(timestamp_ns)
    return writer.finish()


def restamped(head: bytes, timestamp: bytes, body: bytes) -> bytes:
    """Return the message of `head` with another timestamp, its last field, and a body."""
    length = (len(head) + len(body)).to_bytes(_LENGTH.size, "big")
    return b"".join((length, head[_LENGTH.size : -len(timestamp)], timestamp, body))


def decode_header(octets: bytes | memoryview) -> tuple[Header, int]:
    """Decode the header of a message that may be incomplete.

    Returns:
        The header, and the length of the message by its length field.

    Raises:
        DecodeError: The header is not valid.
    """
    return _read_header(Reader(octets, 0, _SUPPLEMENT_CAP))


def decode_message(message: bytes | memoryview) -> tuple[Header, bytes]:
    """Decode a complete message.

    Returns:
        The header and the body.

    Raises:
        DecodeError: The header is not valid, or the length field differs.
    """
    octets = message if len(message) > _COPIED_OCTETS else bytes(message)
    reader = Reader(octets, 0, _SUPPLEMENT_CAP)
    header, length = _read_header(reader)
    if length != len(octets):
        raise DecodeError(f"length {length} in a message of {len(octets)} octets")
    return header, bytes(octets[reader.at :])


def _read_header(reader: Reader) -> tuple[Header, int]:
    (length, kind, area, service, operation, version, bits, transaction_id, flags, encoding) = (
        _HEAD.unpack(reader.take(_HEAD.size))
    )
    if kind >> 5 != VERSION:
        raise DecodeError(f"header version {kind >> 5}, not {VERSION}")
    if kind & 0x1F >= len(_STAGES):
        raise DecodeError(f"unknown SDU type {kind & 0x1F}")
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
    return header, length


def _supplement(reader: Reader) -> NamedValue:
    name = reader.string()
    return NamedValue(name=name, value=reader.attribute() if reader.boolean() else None)
