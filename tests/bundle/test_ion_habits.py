"""What NASA ION does, replayed: its blocks, its stream, its reports, its repeats."""

import json
from math import inf
from pathlib import Path
from typing import Any

import pytest

from adapters.bundle.codec.bundle import DTN_EPOCH_UTC_MS
from adapters.bundle.codec.eid import Eid, Ipn
from adapters.bundle.links.tcpcl_session import (
    AckSegment,
    ContactHeader,
    MessageReader,
    RefuseBundle,
    SessionStage,
    Shutdown,
    TcpclSession,
    encode_message,
)
from adapters.bundle.node.database import Database, Synchronous
from adapters.bundle.node.node import Node
from adapters.bundle.node.reporting import DeliveryStatus, Notice
from adapters.bundle.node.settings import Neighbour, NodeSettings, TcpclLink
from tests.bundle.nodes import Clock, TestedNode, settings_of

VECTORS: Any = json.loads(Path(__file__).with_name("vectors.json").read_text())
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


def test_a_block_of_several_bundles_is_cut_and_what_comes_twice_comes_once(tmp_path: Path) -> None:
    clock = Clock()
    clock.utc_ms = DTN_EPOCH_UTC_MS + FROM_ION[2]["fields"]["creation"][0] + 5000
    node = TestedNode(tmp_path, settings_of(5, 1), clock)
    block = b"".join(bytes.fromhex(row["hex"]) for row in FROM_ION)
    for _ in range(2):
        node.node.receiving.arrived("ipn:1.0", block)
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
        node.node.receiving.arrived("ipn:1.0", bytes.fromhex(report["hex"]))
        assert node.commit() is None
    assert node.node.outbox.depth() == 0
    assert set(node.fates()) == {DeliveryStatus.DELIVERED}


class Caller:
    """A TCPCL session of node 2 with ION at the other end of it."""

    def __init__(self, folder: Path, link: TcpclLink) -> None:
        self.link = link
        self.clock = Clock()
        self.clock.utc_ms = DTN_EPOCH_UTC_MS + 848_563_950_000
        neighbour = Neighbour(Ipn(1, 0), link)
        settings = NodeSettings(Ipn(2, 1), (Ipn(2, 1),), (neighbour,))
        database = Database(folder / "2.db", None, Synchronous.OFF)
        self.notices: list[Notice] = []
        self.node = Node(settings, database, self.clock, self.notices.append)
        self.now_s = 0.0
        self.said = b""
        self.session = TcpclSession(self.node, self.know, lambda: self.now_s, self.write)

    def know(self, node: Eid) -> TcpclLink | None:
        return self.link if node == Ipn(1, 0) else None

    def write(self, octets: bytes) -> None:
        self.said += octets

    def put(self, count: int) -> list[int]:
        """Have bundles sent; return their lengths."""
        for number in range(count):
            self.node.put(Ipn(1, 1), b"%d" % number)
        self.node.transaction.commit()
        sent = self.node.sending.outgoing("ipn:1.0", 1 << 20, 1 << 20)
        for outgoing in sent:
            self.session.send(outgoing)
        return [len(outgoing.octets) for outgoing in sent]


def test_the_recorded_session_is_answered_as_it_was_then_but_after_the_commit(
    tmp_path: Path,
) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.session.receive(HEADER)
    (header,) = MessageReader(1000).feed(caller.said)
    assert isinstance(header, ContactHeader)
    assert header.eid == "ipn:2.0"
    caller.said = b""
    for octet in recorded("47794"):
        caller.session.receive(bytes((octet,)))
    assert caller.said == b""
    caller.node.transaction.commit()
    assert caller.said == recorded("4502")[:4]
    fetched = caller.node.fetch()
    assert fetched
    assert fetched.payload == b"001|MOE|NXT|FORWARD|5||False|False|17|3#"


def test_what_ion_acknowledged_is_handed_on_and_the_rest_comes_back(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.session.receive(HEADER)
    lengths = caller.put(5)
    for length in lengths[:2]:
        caller.session.receive(encode_message(AckSegment(length)))
    caller.session.lost()
    caller.node.transaction.commit()
    assert len(caller.session.unacknowledged) == 3
    assert [notice.status for notice in caller.notices] == [DeliveryStatus.HANDED_ON] * 2


def test_without_acknowledgements_none_is_said_and_none_is_awaited(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None, acknowledge=False, keepalive_s=0))
    caller.session.receive(HEADER)
    caller.put(5)
    caller.node.transaction.commit()
    assert len(caller.notices) == 5
    said = len(caller.said)
    caller.session.receive(recorded("47794"))
    caller.node.transaction.commit()
    assert len(caller.said) == said
    assert caller.session.next_s == inf


@pytest.mark.parametrize("message", [AckSegment(1 << 20), AckSegment(7)])
def test_an_acknowledgement_of_what_was_not_sent_ends_the_session(
    tmp_path: Path, message: AckSegment
) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.session.receive(HEADER)
    caller.put(1 if message.length > 1000 else 0)
    caller.session.receive(encode_message(message))
    assert caller.session.stage is SessionStage.OVER


def test_a_silent_session_is_kept_alive_and_then_given_up(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.session.receive(HEADER)
    before = caller.said
    caller.now_s = 15.0
    caller.session.tick()
    assert caller.said == before + b"\x40"
    caller.now_s = 30.0
    caller.session.tick()
    assert caller.session.stage is SessionStage.OVER


@pytest.mark.parametrize("message", [Shutdown(), Shutdown(0, 10), RefuseBundle(2)])
def test_what_was_refused_or_shut_down_comes_back(
    tmp_path: Path, message: Shutdown | RefuseBundle
) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.session.receive(HEADER)
    caller.put(3)
    caller.session.receive(encode_message(message))
    assert caller.session.stage is SessionStage.OVER
    assert len(caller.session.unacknowledged) == 3
    assert caller.said.endswith(encode_message(Shutdown()))


def test_what_there_is_no_room_for_is_not_acknowledged(tmp_path: Path) -> None:
    caller = Caller(tmp_path, TcpclLink(None))
    caller.session.receive(HEADER)
    caller.said = b""
    caller.node.database.full = True
    caller.session.receive(recorded("47794"))
    caller.node.transaction.commit()
    assert caller.said == encode_message(Shutdown())
    assert caller.session.stage is SessionStage.OVER
