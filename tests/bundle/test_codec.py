"""Octets and values: what is allowed comes back the same, what is not raises DecodeError."""

import random
from binascii import crc32
from contextlib import suppress
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.bundle.codec import cbor
from adapters.bundle.codec.bundle import (
    Block,
    BlockFlag,
    BlockType,
    Bundle,
    Crc,
    Creation,
    Flag,
    FragmentRange,
    Primary,
    crc16,
    crc32c,
    decode_bundle,
    decode_bundles,
    encode_bundle,
)
from adapters.bundle.codec.eid import (
    NONE,
    Dtn,
    Eid,
    Ipn,
    decode_eid,
    encode_eid,
    is_null,
    node_of,
    parse_eid,
)
from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.codec.report import StatusReport, decode_report, encode_report
from adapters.bundle.links.ltp_segment import Segment, decode_segment, encode_segment
from adapters.bundle.links.sdnv import SdnvReader, TruncatedError, encode_sdnv
from adapters.bundle.links.tcpcl_messages import (
    ContactHeader,
    Message,
    MessageReader,
    encode_message,
)
from tests.bundle.strategies import CONTACT_HEADERS, EIDS, MESSAGES, REPORTS, SEGMENTS, bundles
from tests.support.examples import examples

MALFORMED = {
    "creation time 0 without age": (
        "9f88071a000200040082028203018202820302820100821b0000000000000000001a821820008501010000445445"
        "5354ff"
    ),
    "payload numbered 33": (
        "9f89071844018202820301820100820100821b000000b5998c982b011a000493e042c9f6850602100045820282020"
        "085070401004218348501182101004454455354ff"
    ),
    "primary block without CRC": (
        "9f88071844008202820301820100820100821b000000b5998c982b011a000493e08506021000458202820200850704"
        "010042183485010101004454455354ff"
    ),
    "CRC type 24": (
        "9f89071844018202820301820100820100821b000000b5998c982b011a000493e042c9f6850602100045820282020"
        "085070401004218348501010118194454455354ff"
    ),
    "to the null endpoint": (
        "9f8807000082028200008202821a1000bff8008202821a1000bff800821a6971"
        "7f55001a0036ee8085010100005483"
        "1a1000bff81a000000001b00000000697117"
        "7f55ff"
    ),
}


PRIMARY = Primary(Ipn(2, 1), Ipn(1, 1), NONE, Creation(848_000_000_000, 1), 3_600_000)
ANONYMOUS = replace(PRIMARY, source=NONE, flags=int(Flag.MUST_NOT_FRAGMENT))
RECORD = replace(PRIMARY, flags=int(Flag.ADMINISTRATIVE))
UNSEALED = replace(PRIMARY, crc=Crc.NONE)
PAYLOAD = Block(BlockType.PAYLOAD, 1, b"hello rover")
AGE = Block(BlockType.BUNDLE_AGE, 2, cbor.unsigned(52))
HEADER = encode_message(ContactHeader(0, 0, ""))


def reporting(block: Block) -> Block:
    """Return a block that requests a report where it is not known."""
    return replace(block, flags=int(BlockFlag.REPORT_IF_UNKNOWN))


def integrity(*targets: int, data: bytes | None = None) -> Block:
    """Return a BIB of these targets; its results are nobody's."""
    count = len(targets)
    head = bytes((0x80 | count, *targets, 1, 0)) + encode_eid(Ipn(1, 0)) + bytes((0x80 | count,))
    result = bytes((0x81, 0x82, 1, 0x58, 48)) + bytes(48)
    return Block(BlockType.INTEGRITY, 3, head + count * result if data is None else data)


FORBIDDEN = {
    "an anonymous bundle, a block requests a report": (ANONYMOUS, reporting(AGE), PAYLOAD),
    "an anonymous bundle, its payload requests a report": (ANONYMOUS, reporting(PAYLOAD)),
    "an administrative record, a block requests a report": (RECORD, reporting(AGE), PAYLOAD),
    "an administrative record, its payload requests a report": (RECORD, reporting(PAYLOAD)),
    "no CRC, the BIB signs the payload": (UNSEALED, integrity(1), PAYLOAD),
    "no CRC, the BIB signs other blocks": (UNSEALED, AGE, integrity(2, 1), PAYLOAD),
    "no CRC, the BIB is no security block": (UNSEALED, integrity(data=b"\x00"), PAYLOAD),
    "no CRC, the BIB is empty": (UNSEALED, integrity(data=b""), PAYLOAD),
    "no CRC, the BIB ends within its targets": (UNSEALED, integrity(data=b"\x82\x01"), PAYLOAD),
    "to ipn:0.1": (replace(PRIMARY, destination=Ipn(0, 1)), PAYLOAD),
    "to ipn:0.1 in three elements": (
        replace(PRIMARY, destination=Ipn(0, 1, three_elements=True)),
        PAYLOAD,
    ),
    "from ipn:0.7, may be fragmented": (replace(PRIMARY, source=Ipn(0, 7)), PAYLOAD),
    "from ipn:0.7, requests reports": (
        replace(
            PRIMARY,
            source=Ipn(0, 7),
            flags=int(Flag.MUST_NOT_FRAGMENT | Flag.REPORT_DELIVERY),
        ),
        PAYLOAD,
    ),
    "from ipn:0.7, a block requests a report": (
        replace(ANONYMOUS, source=Ipn(0, 7)),
        reporting(PAYLOAD),
    ),
    "a fragment that forbids fragmentation": (
        replace(
            PRIMARY, flags=int(Flag.FRAGMENT | Flag.MUST_NOT_FRAGMENT), part=FragmentRange(0, 11)
        ),
        PAYLOAD,
    ),
}
ALLOWED = {
    "a block of a source requests a report": (PRIMARY, reporting(AGE), PAYLOAD),
    "no CRC, the BIB signs the primary block": (UNSEALED, integrity(0), PAYLOAD),
    "no CRC, the BIB signs it among others": (UNSEALED, integrity(1, 0), PAYLOAD),
    "CRC, the BIB signs the payload": (PRIMARY, integrity(1), PAYLOAD),
    "reports to ipn:0.1": (replace(PRIMARY, report_to=Ipn(0, 1)), PAYLOAD),
    "from ipn:0.7, not to be fragmented": (replace(ANONYMOUS, source=Ipn(0, 7)), PAYLOAD),
    "from node 0 of another allocator": (replace(PRIMARY, source=Ipn(0, 7, 5)), PAYLOAD),
}


@pytest.mark.parametrize("parts", FORBIDDEN.values(), ids=FORBIDDEN)
def test_a_bundle_that_the_standard_forbids_is_refused(parts: tuple[Primary, Block]) -> None:
    primary, *blocks = parts
    with pytest.raises(DecodeError):
        decode_bundle(encode_bundle(Bundle(primary, tuple(blocks))))


@pytest.mark.parametrize("parts", ALLOWED.values(), ids=ALLOWED)
def test_a_bundle_resembling_one_of_these_is_accepted(parts: tuple[Primary, Block]) -> None:
    primary, *blocks = parts
    bundle = Bundle(primary, tuple(blocks))
    assert decode_bundle(encode_bundle(bundle)) == bundle


@pytest.mark.parametrize("octets", MALFORMED.values(), ids=MALFORMED)
def test_what_broke_other_agents_is_refused(octets: str) -> None:
    with pytest.raises(DecodeError):
        decode_bundle(bytes.fromhex(octets))


@pytest.mark.parametrize(
    "octets",
    [
        "9f890718440182028203018201008201008200011a000493e042a2218506021000458202820200850718a601004218"
        "3485010101004454455354ff",
        "9f88070000820282030182028201018202820100821b000000bb0e20b4ea001a000927c0850802010041008601010"
        "0014d48656c6c6f2c20576f726c64214254b3ff",
    ],
    ids=["creation time 0 with age", "block type 8 (but no CRC)"],
)
def test_bundles_wrongly_refused_by_others(octets: str) -> None:
    encoded = bytes.fromhex(octets)
    if encoded[1] == 0x89:
        assert encode_bundle(decode_bundle(encoded)) == encoded
    else:
        with pytest.raises(DecodeError, match="primary block without CRC"):
            decode_bundle(encoded)


def test_the_check_sum_of_any_length_is_that_of_the_polynomial() -> None:
    octets = random.Random(1).randbytes(13)
    for length in range(len(octets)):
        crc = 0xFFFFFFFF
        for octet in octets[:length]:
            crc ^= octet
            for _ in range(8):
                crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
        assert crc32c(octets[:length]) == (crc ^ 0xFFFFFFFF).to_bytes(4, "big")


@pytest.mark.parametrize(("crc", "known"), [(crc16, "906e"), (crc32c, "e3069283")])
def test_check_sums_have_their_published_values(crc: object, known: str) -> None:
    assert callable(crc)
    assert crc(b"123456789").hex() == known
    assert crc32(b"123456789") != int(known, 16)


@given(bundles())
def test_a_bundle_survives_the_round_trip(bundle: Bundle) -> None:
    assert decode_bundle(encode_bundle(bundle)) == bundle


@given(bundles(), st.data())
def test_no_changed_octet_goes_unseen_under_a_check_sum(
    bundle: Bundle, data: st.DataObject
) -> None:
    encoded = bytearray(encode_bundle(bundle))
    at = data.draw(st.integers(0, len(encoded) - 1))
    encoded[at] ^= data.draw(st.integers(1, 255))
    with suppress(DecodeError):
        changed = decode_bundle(bytes(encoded))
        assert changed.primary == bundle.primary
        assert encode_bundle(changed) == encoded


@given(st.lists(bundles(), max_size=4))
def test_bundles_back_to_back_are_cut(sent: list[Bundle]) -> None:
    encoded = [encode_bundle(bundle) for bundle in sent]
    cut = list(decode_bundles(b"".join(encoded)))
    assert cut == list(zip(sent, encoded, strict=True))


@settings(max_examples=examples(500))
@given(st.binary(max_size=200), st.integers(0, 100), bundles())
def test_garbage_is_refused(garbage: bytes, at: int, bundle: Bundle) -> None:
    encoded = encode_bundle(bundle)
    for octets in (garbage, encoded[:at] + garbage, encoded[:at] + garbage + encoded[at:]):
        with suppress(DecodeError):
            assert encode_bundle(decode_bundle(octets)) == octets
        with suppress(DecodeError):
            decode_report(octets)
        with suppress(DecodeError):
            decode_segment(octets)
        with suppress(DecodeError):
            MessageReader(1000).feed(b"dtn!\x03" + octets)
        with suppress(DecodeError):
            MessageReader(1000).feed(HEADER + octets)


@given(EIDS)
def test_an_endpoint_survives_octets_and_text(eid: Eid) -> None:
    assert decode_eid(encode_eid(eid)) == eid
    assert parse_eid(str(eid)) == eid


@pytest.mark.parametrize("text", ["", "ipn:1", "ipn:1.-1", "ipn:１.1", "dtn:", "dtn:x", "http://x"])
def test_other_text_is_no_endpoint(text: str) -> None:
    with pytest.raises(ValueError, match="not an endpoint"):
        parse_eid(text)


def test_nodes_and_null_endpoint() -> None:
    assert node_of(Ipn(5, 1)) == Ipn(5, 0)
    assert node_of(Dtn("//rover/mops")) == Dtn("//rover/")
    assert is_null(Ipn(0, 0))
    assert is_null(Ipn(0, 7))
    assert is_null(parse_eid("ipn:0.0.7"))
    assert not is_null(Ipn(0, 7, 5))
    assert is_null(parse_eid("dtn:none"))
    assert not is_null(Ipn(1, 0))


@given(REPORTS)
def test_a_status_report_survives_the_round_trip(report: StatusReport) -> None:
    assert decode_report(encode_report(report)) == report


def test_an_unknown_administrative_record_is_none_of_ours() -> None:
    assert decode_report(bytes.fromhex("820300")) is None


@given(st.integers(0, 2**64 - 1))
def test_a_number_survives_the_round_trip_and_is_not_read_before_its_end(value: int) -> None:
    encoded = encode_sdnv(value)
    reader = SdnvReader(encoded + b"x")
    assert (reader.number(), reader.remaining) == (value, 1)
    with pytest.raises(TruncatedError):
        SdnvReader(encoded[:-1]).number()


@pytest.mark.parametrize("octets", [b"\x82" + b"\x80" * 8 + b"\x00", b"\xff" * 11])
def test_a_number_of_more_than_64_bits_is_refused(octets: bytes) -> None:
    with pytest.raises(DecodeError):
        SdnvReader(octets).number()


@given(SEGMENTS)
def test_a_segment_survives_the_round_trip(segment: Segment) -> None:
    assert decode_segment(encode_segment(segment)) == segment


def test_extensions_of_a_segment_are_skipped() -> None:
    plain = bytes.fromhex("090583ec87853b00bc1b")
    extended = plain[:7] + b"\x11" + b"\x07\x02ab" + plain[8:] + b"\x08\x01c"
    assert decode_segment(extended) == decode_segment(plain)


@given(CONTACT_HEADERS, st.lists(MESSAGES), st.integers(1, 7))
def test_messages_survive_any_fragmentation_of_the_stream(
    header: ContactHeader, messages: list[Message], size: int
) -> None:
    text = [header, *messages]
    stream = b"".join(map(encode_message, text))
    reader = MessageReader(1000)
    received = [
        message
        for at in range(0, len(stream), size)
        for message in reader.feed(stream[at : at + size])
    ]
    assert received == text


def test_a_segment_that_is_too_long_is_refused_before_it_has_arrived() -> None:
    with pytest.raises(DecodeError, match="101 octets exceeds 100 octets"):
        MessageReader(100).feed(HEADER + b"\x13" + encode_sdnv(101))
