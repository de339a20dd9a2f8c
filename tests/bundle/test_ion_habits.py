"""What NASA ION does, replayed: its blocks, its stream, its reports, its repeats."""

import asyncio
import json
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import pytest

from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    Bundle,
    FragmentRange,
    decode_bundle,
    encode_bundle,
)
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.links.link import LinkContext
from adapters.bundle.links.tcpcl import SessionStage, TcpclNeighbour, TcpclSession
from adapters.bundle.links.tcpcl_messages import (
    AckSegment,
    ContactFlag,
    ContactHeader,
    MessageReader,
    RefuseBundle,
    Shutdown,
    encode_message,
)
from adapters.bundle.node.database import BundleDatabase
from adapters.bundle.node.node import BundleNode
from adapters.bundle.node.reporting import DeliveryNotice, DeliveryStatus
from adapters.bundle.node.settings import Neighbour, NodeSettings, TcpclLink
from tests.bundle.nodes import Clock, TestedNode, settings_of
from tests.support.unsynced import UNSYNCED

VECTORS: Any = json.loads(Path(__file__).with_name("vectors.json").read_text())
SIGNED: Any = json.loads(Path(__file__).with_name("bpsec-vectors.json").read_text())
FROM_ION = [row for row in VECTORS["vectors"] if row["sender"] == "ION 4.1.3"]
HEADER = bytes.fromhex(VECTORS["tcpclv3_contact_header_of_ION"]["hex"])
STREAM = VECTORS["tcpclv3_stream"]


def recorded(source_port: str) -> bytes:
    """Return what one side of the recorded session said."""
    return b"".join(
        bytes.fromhex(row["hex"])
        for row in STREAM
        if row["srcport"] == source_port and {row["srcport"], row["dstport"]} == {"47794", "4502"}
    )


def test_a_block_of_several_bundles_is_cut_and_a_duplicate_is_delivered_once(
    tmp_path: Path,
) -> None:
    clock = Clock()
    clock.utc_ms = DTN_EPOCH_UTC_MS + FROM_ION[2]["fields"]["creation"][0] + 5000
    node = TestedNode(tmp_path, settings_of(5, 1), clock)
    block = b"".join(bytes.fromhex(row["hex"]) for row in FROM_ION)
    for _ in range(2):
        node.node.receiving.receive("ipn:1.0", block)
        assert node.commit() is None
    assert node.take() == [b"001|MOPS|NXT|FORWARD|5||False|False|17|1#", b"custody requested msg\0"]
    assert node.node.receiving.malformed == 0


def test_its_report_confirms_a_bundle(tmp_path: Path) -> None:
    report = FROM_ION[-1]
    clock = Clock()
    clock.utc_ms = DTN_EPOCH_UTC_MS + 848_564_355_498
    node = TestedNode(tmp_path, settings_of(5, 1), clock)
    node.put(Ipn(1, 1), b"please-report-delivery", confirm=True)
    assert node.node.outbox.depth() == 1
    for _ in range(2):
        node.node.receiving.receive("ipn:1.0", bytes.fromhex(report["hex"]))
        assert node.commit() is None
    assert node.node.outbox.depth() == 0
    assert set(node.fates()) == {DeliveryStatus.DELIVERED}


class Wire(asyncio.Transport):
    """The connection to ION: keeps what was written to it."""

    output = b""

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.output += data

    def is_closing(self) -> bool:
        return False

    def close(self) -> None:
        pass


class Caller:
    """A TCPCL session of node 2 with ION at the other end of it."""

    def __init__(self, folder: Path, link: TcpclLink, header: bytes = HEADER) -> None:
        self.clock = Clock()
        self.clock.utc_ms = DTN_EPOCH_UTC_MS + 848_563_950_000
        neighbour = Neighbour(Ipn(1, 0), link)
        settings = NodeSettings(Ipn(2, 1), (Ipn(2, 1),), (neighbour,))
        database = BundleDatabase(folder / "2.db", None, UNSYNCED)
        self.notices: list[DeliveryNotice] = []
        self.node = BundleNode(settings, database, self.clock, self.notices.append)
        self.now_s = 0.0
        context = LinkContext(self.node, lambda: self.now_s, lambda: None)
        self.link = TcpclNeighbour(context, neighbour, {})
        self.session = TcpclSession(context, {Ipn(1, 0): self.link})
        self.wire = Wire()
        self.session.connection_made(self.wire)
        self.session.data_received(header)

    def commit(self) -> None:
        self.node.transaction.commit()
        self.session.flush()

    def put(self, count: int) -> list[int]:
        """Have bundles sent; return their lengths."""
        for number in range(count):
            self.node.put(Ipn(1, 1), b"%d" % number)
        self.commit()
        sent = self.node.sending.outgoing("ipn:1.0", 1 << 20, 1 << 20)
        for outgoing in sent:
            self.session.send(outgoing, 65_536)
        self.session.flush()
        return [len(outgoing.octets) for outgoing in sent]

    def waiting(self) -> int:
        """Return how many bundles are there to be sent again."""
        return len(self.node.sending.outgoing("ipn:1.0", 1 << 20, 1 << 20))


async def test_the_recorded_session_is_answered_as_it_was_then_but_after_the_commit(
    tmp_path: Path,
) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    (header,) = MessageReader(1000).feed(caller.wire.output)
    assert isinstance(header, ContactHeader)
    assert header.eid == "ipn:2.0"
    caller.wire.output = b""
    for octet in recorded("47794"):
        caller.session.data_received(bytes((octet,)))
    assert caller.wire.output == b""
    caller.commit()
    assert caller.wire.output == recorded("4502")[:4]
    fetched = caller.node.fetch()
    assert fetched
    assert fetched.payload == b"001|MOE|NXT|FORWARD|5||False|False|17|3#"


async def test_acknowledged_bundles_are_handed_on_and_the_rest_is_returned(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    lengths = caller.put(5)
    for length in lengths[:2]:
        caller.session.data_received(encode_message(AckSegment(length)))
    caller.session.connection_lost(None)
    caller.commit()
    assert caller.waiting() == 3
    assert [notice.status for notice in caller.notices] == [DeliveryStatus.HANDED_ON] * 2


async def test_without_acknowledgements_none_is_sent_and_none_is_awaited(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None, acknowledge=False, keepalive_s=0))
    caller.put(5)
    caller.commit()
    assert len(caller.notices) == 5
    message = len(caller.wire.output)
    caller.session.data_received(recorded("47794"))
    caller.commit()
    assert len(caller.wire.output) == message
    assert caller.session.next_s == inf


@pytest.mark.parametrize("message", [AckSegment(1 << 20), AckSegment(7)])
async def test_an_acknowledgement_without_transfer_ends_the_session(
    tmp_path: Path, message: AckSegment
) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.put(1 if message.length > 1000 else 0)
    caller.session.data_received(encode_message(message))
    assert caller.session.stage is SessionStage.OVER


async def test_a_silent_session_sends_keepalives_and_then_times_out(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    before = caller.wire.output
    caller.now_s = 15.0
    caller.session.tick()
    assert caller.wire.output == before + b"\x40"
    caller.now_s = 30.0
    caller.session.tick()
    assert caller.session.stage is SessionStage.OVER


@pytest.mark.parametrize("message", [Shutdown(), Shutdown(0, 10), RefuseBundle(2)])
async def test_refused_transfers_and_shut_down_sessions_return_their_bundles(
    tmp_path: Path, message: Shutdown | RefuseBundle
) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.put(3)
    caller.session.data_received(encode_message(message))
    assert caller.session.stage is SessionStage.OVER
    assert caller.waiting() == 3
    assert caller.wire.output.endswith(encode_message(Shutdown()))


async def test_a_bundle_that_does_not_fit_is_not_acknowledged(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.wire.output = b""
    caller.node.database.full = True
    caller.session.data_received(recorded("47794"))
    caller.commit()
    assert caller.wire.output == encode_message(Shutdown())
    assert caller.session.stage is SessionStage.OVER


@pytest.mark.parametrize("acknowledge", [True, False])
async def test_refusal_is_requested_beside_acknowledgements_only(
    tmp_path: Path, acknowledge: bool
) -> None:
    """RFC 7242, 4.1, allows the flag beside that for acknowledgements only; measured with ION."""
    caller = Caller(tmp_path, TcpclLink(None, acknowledge=acknowledge))
    (header,) = MessageReader(1000).feed(caller.wire.output)
    assert isinstance(header, ContactHeader)
    both = ContactFlag.ACKNOWLEDGE | ContactFlag.REFUSE
    assert header.flags == (both if acknowledge else 0)


@pytest.mark.parametrize("acknowledge", [True, False])
@pytest.mark.parametrize("theirs", [0x1, 0x4, 0x5])
async def test_a_bundle_is_refused_where_both_ends_acknowledge_and_understand_it(
    tmp_path: Path, acknowledge: bool, theirs: int
) -> None:
    link = TcpclLink(None, acknowledge=acknowledge and bool(theirs & 1))
    caller = Caller(tmp_path, link, encode_message(ContactHeader(theirs, 15, "ipn:1.0")))
    caller.wire.output = b""
    caller.node.database.full = True
    caller.session.data_received(recorded("47794"))
    caller.commit()
    refusal = encode_message(RefuseBundle(2)) if acknowledge and theirs == 0x5 else b""
    assert caller.wire.output == refusal + encode_message(Shutdown())


def test_its_fragments_with_block_number_0_are_put_together(tmp_path: Path) -> None:
    """ION 4.1.3 numbers the extension blocks of a fragment 0; a recorded one, and its rest."""
    row = next(row for row in SIGNED["vectors"] if "fragment" in row["name"])
    octets = bytes.fromhex(row["hex"])
    fragment = decode_bundle(octets)
    assert [block.number for block in fragment.blocks].count(0) > 1
    assert encode_bundle(fragment) == octets
    primary = fragment.primary
    assert primary.part
    clock = Clock()
    clock.utc_ms = DTN_EPOCH_UTC_MS + primary.creation.time_ms
    destination = primary.destination
    assert isinstance(destination, Ipn)
    settings = NodeSettings(destination, (destination,), ())
    node = TestedNode(tmp_path, settings, clock)
    node.node.receiving.receive("ipn:1.0", octets)
    begin, end = primary.part.offset, primary.part.offset + len(fragment.payload)
    for at, length in ((0, begin), (end, primary.part.total - end)):
        if length:
            rest = replace(fragment.blocks[-1], data=bytes(length))
            part = replace(primary, part=FragmentRange(at, primary.part.total))
            node.node.receiving.receive("ipn:1.0", encode_bundle(Bundle(part, (rest,))))
    node.commit()
    (whole,) = node.take()
    assert whole[begin:end] == fragment.payload
