"""Random bundles, segments and messages that the standards allow."""

from hypothesis import strategies as st

from adapters.bundle.codec import cbor
from adapters.bundle.codec.bundle import (
    Block,
    BlockType,
    Bundle,
    Crc,
    Creation,
    Flag,
    FragmentRange,
    HopCount,
    Primary,
    encode_hop_count,
)
from adapters.bundle.codec.eid import Dtn, Eid, Ipn
from adapters.bundle.codec.report import Assertion, StatusReport
from adapters.bundle.links.ltp_segment import (
    Cancel,
    CancelAck,
    Checkpoint,
    Data,
    ReceptionClaim,
    ReportAck,
    ReportSegment,
    Segment,
    SessionId,
)
from adapters.bundle.links.tcpcl_messages import (
    AckSegment,
    BundleLength,
    ContactHeader,
    DataSegment,
    Keepalive,
    Message,
    RefuseBundle,
    Shutdown,
)

NUMBERS = st.integers(0, 2**64 - 1)
SMALL = st.integers(0, 1000)
CRCS = st.sampled_from(Crc)

NODES = st.one_of(
    st.builds(Ipn, st.integers(1, 2**32), NUMBERS),
    st.builds(lambda node, service: Ipn(node, service, 7, True), SMALL, SMALL),
    st.builds(Dtn, st.from_regex(r"//[a-z]{1,9}/[a-z0-9~]{0,9}", fullmatch=True)),
)
CREATIONS = st.builds(Creation, st.integers(1, 2**64 - 1), NUMBERS)


@st.composite
def bundles(draw: st.DrawFn) -> Bundle:
    payload = draw(st.binary(max_size=300))
    part = draw(
        st.none() | st.builds(lambda at, more: FragmentRange(at, at + 300 + more), SMALL, SMALL)
    )
    flags = draw(st.sampled_from([0, Flag.REPORT_DELIVERY | Flag.REPORT_TIMES, 1 << 40]))
    primary = Primary(
        draw(NODES), draw(NODES), draw(st.just(Dtn()) | NODES), draw(CREATIONS), draw(NUMBERS),
        flags=int(flags) | (1 if part else 0),
        crc=draw(st.sampled_from([Crc.CRC16, Crc.CRC32C])),
        part=part,
    )  # fmt: skip
    known = [
        (BlockType.BUNDLE_AGE, cbor.unsigned(draw(NUMBERS))),
        (BlockType.HOP_COUNT, encode_hop_count(HopCount(draw(st.integers(1, 255)), draw(SMALL)))),
        (193, draw(st.binary(max_size=20))),
    ]
    chosen = draw(st.lists(st.sampled_from(known), unique_by=lambda pair: pair[0]))
    blocks = [
        Block(kind, number, data, draw(st.sampled_from([0, 1, 16])), draw(CRCS))
        for number, (kind, data) in enumerate(chosen, 2)
    ]
    return Bundle(primary, (*blocks, Block(BlockType.PAYLOAD, 1, payload, 0, draw(CRCS))))


REPORTS = st.builds(
    StatusReport,
    st.dictionaries(st.sampled_from(Assertion), st.none() | NUMBERS),
    SMALL,
    NODES,
    CREATIONS,
    st.none() | st.builds(FragmentRange, SMALL, SMALL),
)
EIDS: st.SearchStrategy[Eid] = NODES | st.just(Dtn())


@st.composite
def ltp_reports(draw: st.DrawFn) -> ReportSegment:
    lower = draw(SMALL)
    claims, at = [], lower
    for gap, length in draw(st.lists(st.tuples(SMALL, st.integers(1, 1000)), min_size=1)):
        claims.append(ReceptionClaim(at + gap, length))
        at += gap + length
    upper = at + draw(SMALL)
    return ReportSegment(draw(SESSIONS), draw(NUMBERS), draw(NUMBERS), upper, lower, tuple(claims))


SESSIONS = st.builds(SessionId, NUMBERS, NUMBERS)


@st.composite
def ltp_data(draw: st.DrawFn) -> Data:
    checkpoint = draw(st.none() | st.builds(Checkpoint, NUMBERS, NUMBERS))
    red = draw(st.booleans()) or checkpoint is not None
    ends_block = draw(st.booleans()) and (checkpoint is not None or not red)
    ends_red = checkpoint is not None and (ends_block or draw(st.booleans()))
    octets = draw(st.binary(max_size=50))
    return Data(
        draw(SESSIONS), draw(SMALL), draw(NUMBERS), octets, red, checkpoint, ends_red, ends_block
    )


SEGMENTS: st.SearchStrategy[Segment] = st.one_of(
    ltp_data(),
    ltp_reports(),
    st.builds(ReportAck, SESSIONS, NUMBERS),
    st.builds(Cancel, SESSIONS, st.booleans(), st.integers(0, 255)),
    st.builds(CancelAck, SESSIONS, st.booleans()),
)

MESSAGES: st.SearchStrategy[Message] = st.one_of(
    st.builds(DataSegment, st.binary(max_size=200), st.booleans(), st.booleans()),
    st.builds(AckSegment, NUMBERS),
    st.builds(RefuseBundle, st.integers(0, 15)),
    st.builds(Keepalive),
    st.builds(Shutdown, st.none() | st.integers(0, 255), st.none() | NUMBERS),
    st.builds(BundleLength, NUMBERS),
)
CONTACT_HEADERS = st.builds(
    ContactHeader, st.integers(0, 255), st.integers(0, 65535), st.text(max_size=20)
)
