"""What is not exactly a value of its type is refused, as octets and as Python values."""

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mal import (
    AttributeType,
    Codec,
    DecodeError,
    EncodeError,
    Encoding,
    Field,
    MalError,
    TypedList,
)
from adapters.mal.specification import ELEMENT, TypeRef
from tests.mal.strategies import FIRST_NS, LAST_NS, Strategies, integers
from tests.mal.wiretest import SPECIFICATION, Derived2, Mode, Rec

CODECS = {encoding: Codec(SPECIFICATION, encoding) for encoding in Encoding}
FIXED = CODECS[Encoding.FIXED]
STRATEGIES = Strategies(SPECIFICATION)


@pytest.mark.parametrize("encoding", list(Encoding))
@given(body=st.binary(max_size=60), ref=st.sampled_from(STRATEGIES.types))
def test_any_octets_are_a_value_or_a_decode_error(
    encoding: Encoding, body: bytes, ref: TypeRef
) -> None:
    parts = (Field("v", ref), Field("l", TypeRef(ref.area, ref.name, is_list=True), nullable=True))
    try:
        values = CODECS[encoding].decode(parts, body)
    except DecodeError:
        return
    CODECS[encoding].encode(parts, values)


def part(name: str, nullable: bool = False, is_list: bool = False) -> tuple[Field, ...]:
    area = "WireTest" if name in SPECIFICATION.classes and name != "NamedValue" else "MAL"
    return (Field("v", TypeRef(area, name, is_list), nullable),)


@pytest.mark.parametrize(
    ("encoding", "parts", "body", "why"),
    [
        ("fixed", part("Integer"), "000000", "4 octets expected, 3 available"),
        ("fixed", part("Integer"), "0000000000", "1 excess octets"),
        ("fixed", (), "00", "1 octets, but the message has no parts"),
        ("fixed", part("Integer", nullable=True), "0200000000", "must be 0 or 1"),
        ("fixed", part("Boolean"), "02", "must be 0 or 1"),
        ("fixed", part("Mode"), "03", "Mode has no item 3"),
        ("fixed", part("String"), "00000002c328", "not UTF-8"),
        ("fixed", part("String"), "ffffffff41", "4294967295 octets expected, 1 available"),
        ("fixed", part("Blob"), "7fffffff", "octets expected, 0 available"),
        ("fixed", part("Integer", is_list=True), "ffffffff", "list elements"),
        ("fixed", part("Integer", is_list=True), "0000ffff00000000", "octets expected"),
        ("fixed", part("Time"), "111f05265c00", "86400000 ms in a day"),
        ("fixed", part("FineTime"), "111f000000003b9aca00", "1000000000 ps in a ms"),
        ("fixed", part("Attribute"), "0001000003000014", "no Attribute has type id"),
        ("fixed", part("Attribute"), "00b100000100000b02", "no Attribute has type id"),
        ("fixed", part("Composite"), "000100000300000201", "no Composite has type id"),
        ("fixed", part("Base"), "00b100000100000c", "no Base has type id"),
        ("fixed", part("Element"), "00b1000001fffff000", "no Element has type id"),
        ("fixed", part("Base", is_list=True), "000000000000000100000000", "mixed types"),
        (
            "fixed",
            part("Rec"),
            "00000000000000" + "0114" + "00",
            "unknown attribute short form",
        ),
        ("variable", part("Integer"), "ffffffff1f", "exceeds 32 bits"),
        ("variable", part("ULong"), "ffffffffffffffffffff01", "exceeds 64 bits"),
        ("variable", part("UShort"), "808004", "exceeds 16 bits"),
        ("variable", part("UInteger"), "8000", "not minimally encoded"),
        ("variable", part("UInteger"), "80", "1 octets expected, 0 available"),
        ("variable", part("Boolean"), "02", "must be 0 or 1"),
        ("split", part("Boolean"), "", "1 octets expected, 0 available"),
        ("split", part("Boolean"), "0102", "excess bits"),
        ("split", part("Boolean"), "020100", "excess bits"),
        ("split", part("Boolean"), "0501", "5 octets expected, 1 available"),
        ("split", part("Boolean", is_list=True), "00ffffff7f", "list elements"),
    ],
)
def test_the_decoder_is_strict(
    encoding: str, parts: tuple[Field, ...], body: str, why: str
) -> None:
    with pytest.raises(DecodeError, match=why):
        CODECS[Encoding(encoding)].decode(parts, bytes.fromhex(body))


def test_nesting_without_end_is_refused() -> None:
    mixed_in_mixed = 100_000 * (bytes(8) + b"\0\0\0\1\1")
    with pytest.raises(DecodeError, match="nested deeper"):
        FIXED.decode(part("Element"), mixed_in_mixed)


def test_false_bits_that_are_not_there_are_bounded() -> None:
    split = CODECS[Encoding.SPLIT]
    parts = part("Boolean", is_list=True)
    assert split.decode(parts, bytes.fromhex("000a")) == (10 * (False,),)
    assert len(split.decode(parts, bytes.fromhex("00808040"))[0]) == 1 << 20
    with pytest.raises(DecodeError, match="list elements"):
        split.decode(parts, bytes.fromhex("00818040"))


@pytest.mark.parametrize("encoding", list(Encoding))
@pytest.mark.parametrize(
    ("parts", "value"),
    [
        (part("Octet"), 128),
        (part("UOctet"), -1),
        (part("UShort"), 65536),
        (part("ULong"), 1 << 64),
        (part("Long"), 2.5),
        (part("Boolean"), 1),
        (part("Float"), 1e39),
        (part("Double"), "x"),
        (part("String"), b"x"),
        (part("String"), "\ud83d"),
        (part("Blob"), "x"),
        (part("String"), None),
        (part("String", is_list=True), "abc"),
        (part("String", is_list=True), ("a", None)),
        (part("Time"), LAST_NS + 1),
        (part("FineTime"), FIRST_NS - 1),
        (part("Mode"), 1),
        (part("Mode"), AttributeType.BLOB),
        (part("Rec"), Derived2(id=1, x=1)),
        (part("Rec"), Rec(name=None, ok=True)),
        (part("Attribute"), 3),
        (part("Attribute"), TypedList(AttributeType.LONG, (1,))),
        (part("Composite"), Mode.IDLE),
        (part("Base"), Rec(name="", ok=True)),
        (part("Element"), "text"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(
    encoding: Encoding, parts: tuple[Field, ...], value: Any
) -> None:
    with pytest.raises(EncodeError, match=r"^v: "):
        CODECS[encoding].encode(parts, (value,))


def test_the_number_of_parts_must_be_right() -> None:
    with pytest.raises(EncodeError, match="1 parts expected, 0 given"):
        FIXED.encode(part("Long"), ())


@given(single=st.integers(0, (1 << 32) - 1), double=st.integers(0, (1 << 64) - 1))
def test_every_bit_pattern_of_a_double_survives_and_nan_stays_nan(single: int, double: int) -> None:
    for name, layout, bits in (("Float", ">I", single), ("Double", ">Q", double)):
        body = struct.pack(layout, bits)
        (value,) = FIXED.decode(part(name), body)
        again = FIXED.encode(part(name), (value,))
        assert again == body or (name == "Float" and math.isnan(value))


def test_a_time_is_rounded_to_the_millisecond() -> None:
    body = FIXED.encode(part("Time"), (1_499_999,))
    assert FIXED.decode(part("Time"), body) == (1_000_000,)
    body = FIXED.encode(part("Time"), (1_500_000,))
    assert FIXED.decode(part("Time"), body) == (2_000_000,)


@given(number=integers(32, False), extra=st.none() | STRATEGIES.of(ELEMENT))
def test_errors_survive(number: int, extra: Any) -> None:
    error = FIXED.decode_error(FIXED.encode_error(MalError(number, extra)))
    assert (error.number, error.extra) == (number, extra)
