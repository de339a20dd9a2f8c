"""What a node does not take, cannot forward, or has no room for: refused, told, nothing lost."""

import os
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from adapters.bundle.codec.eid import NONE, Ipn
from adapters.bundle.codec.errors import StoreError, StoreFull
from adapters.bundle.node.database import Limits
from adapters.bundle.node.reporting import DeliveryStatus
from tests.bundle.nodes import Clock, TestedNode, carry, settings_of


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def pair(tmp_path: Path, clock: Clock) -> tuple[TestedNode, TestedNode]:
    return (
        TestedNode(tmp_path, settings_of(1, 2), clock),
        TestedNode(tmp_path, settings_of(2, 1), clock),
    )


def test_a_unit_that_is_too_long_is_not_gathered(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1, most_payload_octets=4999), clock)
    one.put(Ipn(2, 1), bytes(5000), confirm=True)
    carry(one, two, bundle_octets=1400)
    carry(two, one)
    assert one.fates() == [DeliveryStatus.HANDED_ON, *[DeliveryStatus.DELETED] * 4]
    assert two.database.read("SELECT count(*) FROM fragments") == [(0,)]


def test_what_cannot_be_cut_small_enough_for_its_link_is_deleted_and_told(
    pair: tuple[TestedNode, TestedNode], caplog: pytest.LogCaptureFixture
) -> None:
    one, two = pair
    one.put(Ipn(2, 1), bytes(500))
    carry(one, two, bundle_octets=40)
    one.commit()
    assert one.fates() == [DeliveryStatus.DELETED]
    assert one.node.outbox.depth() == 0
    assert (
        "cannot be cut to 40 octets, which is bundle_octets of the link to ipn:2.0" in caplog.text
    )


@pytest.mark.parametrize("destination", [Ipn(2, 9), Ipn(9, 1)])
def test_what_cannot_go_on_is_deleted_and_told(
    pair: tuple[TestedNode, TestedNode], destination: Ipn
) -> None:
    one, two = pair
    one.put(destination, b"x", confirm=True)
    carry(one, two)
    carry(two, one)
    assert one.fates() == [DeliveryStatus.HANDED_ON, DeliveryStatus.DELETED]
    assert two.take() == []


def test_a_bundle_may_be_forwarded_as_often_as_its_hop_limit_says(
    tmp_path: Path, clock: Clock
) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2, hop_limit=1), clock)
    two = TestedNode(tmp_path, settings_of(2, 3, 1), clock)
    three = TestedNode(tmp_path, settings_of(3, 4, 2), clock)
    one.put(Ipn(3, 1), b"near")
    one.put(Ipn(4, 1), b"far")
    carry(one, two)
    carry(two, three)
    assert three.take() == [b"near"]
    assert three.node.outbox.depth() == 0


def test_a_full_store_takes_nothing_more_and_loses_nothing(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1), clock, Limits(most_octets=400_000))
    for _ in range(100):
        one.put(Ipn(2, 1), bytes(5000))
    taken = 0
    while sent := one.node.sending.outgoing("ipn:2.0", 1, 10_000):
        try:
            two.node.receiving.arrived("ipn:1.0", sent[0].octets)
        except StoreFull:
            one.node.sending.came_back("ipn:2.0", sent)
            taken += len(two.take())
        assert two.commit() is None
        if not two.node.inbox.depth():
            continue
        one.node.sending.handed_on(sent)
        one.commit()
    assert taken
    assert taken + len(two.take()) >= 100


def test_a_disk_that_fills_refuses_what_was_not_committed(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    one.put(Ipn(2, 1), b"first")
    one.database.read("PRAGMA max_page_count = 40")
    put = 0
    with suppress(StoreFull):
        for put in range(1000):
            one.node.put(Ipn(2, 1), bytes(1000))
            if put % 10 == 9:
                assert one.commit() is None
    assert put < 999
    assert isinstance(one.commit(), StoreError)
    kept = one.node.outbox.depth()
    assert kept == 1 + put // 10 * 10
    with pytest.raises(StoreFull):
        one.node.put(Ipn(2, 1), b"x")
    one.database.read("PRAGMA max_page_count = 4000")
    one.commit()
    one.put(Ipn(2, 1), b"x")
    assert one.node.outbox.depth() == kept + 1


def test_what_is_malformed_is_dropped_and_counted(pair: tuple[TestedNode, TestedNode]) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"good")
    carry(one, two, change=lambda octets: [b"".join(octets) + b"\x9f\x00"])
    assert two.take() == [b"good"]
    assert two.node.receiving.malformed == 1


def test_a_destination_that_nobody_reaches_is_an_error_of_the_caller(
    tmp_path: Path, clock: Clock
) -> None:
    one = TestedNode(tmp_path, settings_of(1), clock)
    for destination in (Ipn(2, 1), Ipn(1, 2), Ipn(0, 0), NONE):
        with pytest.raises(ValueError, match="no neighbour"):
            one.node.put(destination, b"x")


def test_a_store_takes_again_once_its_disk_has_room_though_nothing_was_written_meanwhile(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    with monkeypatch.context() as crowded:
        crowded.setattr(os, "statvfs", lambda _: SimpleNamespace(f_bavail=0, f_frsize=4096))
        one.put(Ipn(2, 1), b"the last that goes in")
        with pytest.raises(StoreFull):
            one.node.put(Ipn(2, 1), b"one too many")
    one.node.tick()
    assert not one.node.transaction.pending
    one.put(Ipn(2, 1), b"again")
