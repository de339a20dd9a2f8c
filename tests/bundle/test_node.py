"""Nodes joined by hand: what is taken, forwarded, cut, confirmed, refused, and told."""

import os
import random
from contextlib import suppress
from math import inf
from pathlib import Path
from types import SimpleNamespace

import pytest

from adapters.bundle.codec.bundle import (
    BlockType,
    HopCount,
    decode_bundle,
    decode_hop_count,
    encode_bundle,
)
from adapters.bundle.codec.eid import NONE, Ipn
from adapters.bundle.codec.errors import StoreError, StoreFull
from adapters.bundle.node import store
from adapters.bundle.node.database import StoreLimits
from adapters.bundle.node.reporting import DeliveryStatus
from tests.bundle.nodes import Clock, Pair, TestedNode, carry, nothing, settings_of

DAY_MS = 86_400_000


def test_a_queued_bundle_is_delivered_once_and_in_order(pair: Pair) -> None:
    one, two = pair
    payloads = [b"%d" % number for number in range(100)]
    for payload in payloads:
        one.put(Ipn(2, 1), payload)
    carry(one, two)
    assert two.take() == payloads
    assert two.take() == []
    assert one.fates() == [DeliveryStatus.HANDED_ON] * 100
    assert one.node.outbox.depth() == 0


def test_only_committed_bundles_survive_a_crash(pair: Pair) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"kept")
    one.node.put(Ipn(2, 1), b"lost")
    one.restart()
    carry(one, two)
    two.restart()
    assert two.take() == [b"kept"]


def test_nothing_goes_out_before_it_is_committed(pair: Pair) -> None:
    one, _ = pair
    one.node.put(Ipn(2, 1), b"x")
    assert one.node.sending.outgoing("ipn:2.0", 1000, 1000) == []


def test_a_sent_bundle_without_handover_is_sent_again_after_a_crash_and_not_delivered_twice(
    pair: Pair,
) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"x")
    (sent,) = one.node.sending.outgoing("ipn:2.0", 1000, 1000)
    two.node.receiving.receive("ipn:1.0", sent.octets)
    two.commit()
    one.restart()
    assert two.take() == [b"x"]
    two.restart()
    carry(one, two)
    assert two.take() == []


def test_a_fetched_undelivered_bundle_is_delivered_again_after_a_crash(pair: Pair) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"x")
    carry(one, two)
    fetched = two.node.fetch()
    assert fetched
    two.node.requeue_delivery(fetched)
    assert two.node.fetch() == fetched
    two.restart()
    assert two.take() == [b"x"]


def test_a_number_is_never_assigned_twice_despite_clock_changes(pair: Pair, clock: Clock) -> None:
    one, _ = pair
    chance = random.Random(1)
    given = []
    for _ in range(200):
        clock.utc_ms += chance.choice((0, 0, 1, -1000, 50))
        given.append(one.put(Ipn(2, 1), b"x"))
        if chance.random() < 0.1:
            one.restart()
    assert len(set(given)) == len(given)


def test_the_order_of_creation_is_that_of_putting_though_the_clock_steps_back(
    pair: Pair, clock: Clock
) -> None:
    one, _ = pair
    first = one.node.put(Ipn(2, 1), b"x").creation
    clock.utc_ms -= DAY_MS
    second = one.node.put(Ipn(2, 1), b"x").creation
    assert (second.time_ms, second.sequence) == (first.time_ms, first.sequence + 1)


def test_an_expired_lifetime_is_reported(pair: Pair, clock: Clock) -> None:
    one, _ = pair
    one.put(Ipn(2, 1), b"short", lifetime_s=10.0)
    one.put(Ipn(2, 1), b"long")
    clock.utc_ms += 9_999
    one.tick()
    assert one.fates() == []
    clock.utc_ms += 1
    one.tick()
    assert one.fates() == [DeliveryStatus.EXPIRED]
    assert (one.node.outbox.depth(), one.node.expired) == (1, 1)
    one.restart()
    assert one.node.expired == 1


def test_an_unfetched_bundle_ends_with_its_lifetime_and_is_reported(
    pair: Pair, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"x", lifetime_s=10.0)
    carry(one, two)
    clock.utc_ms += 10_000
    two.tick()
    assert two.take() == []
    assert two.node.expired == 1
    assert "expired before its delivery" in caplog.text


def test_a_bundle_to_be_confirmed_remains_until_confirmed(pair: Pair, clock: Clock) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"x", confirm=True)
    carry(one, two)
    assert one.node.outbox.depth() == 1
    assert two.take() == [b"x"]
    carry(two, one)
    assert one.fates() == [DeliveryStatus.HANDED_ON, DeliveryStatus.DELIVERED]
    assert one.node.outbox.depth() == 0
    clock.utc_ms += DAY_MS
    one.tick()
    assert carry(one, two) == 0


def test_a_frequently_lost_bundle_does_not_wait_for_hours(pair: Pair, clock: Clock) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"x", confirm=True)
    for _ in range(10):
        carry(one, two, change=nothing)
        clock.utc_ms += 32 * 60_000
        one.tick()
    carry(one, two)
    assert two.take() == [b"x"]


def test_a_clock_that_is_set_back_makes_no_pause_longer(pair: Pair, clock: Clock) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"x", confirm=True)
    one.tick()
    carry(one, two, change=nothing)
    clock.utc_ms -= 3_600_000
    one.tick()
    clock.utc_ms += 60_000
    one.tick()
    carry(one, two)
    assert two.take() == [b"x"]


def test_an_unconfirmed_bundle_is_resent_with_longer_pauses_and_confirmed_again(
    pair: Pair, clock: Clock
) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"x", confirm=True)
    carry(one, two)
    two.take()
    carry(two, one, change=nothing)
    sent_at = []
    for second in range(500):
        clock.utc_ms += 1000
        one.tick()
        if carry(one, two):
            sent_at.append(second + 1)
            carry(two, one, change=nothing)
    assert sent_at == [60, 180, 420]
    assert two.take() == []
    clock.utc_ms += 480_000
    one.tick()
    carry(one, two)
    carry(two, one)
    assert one.fates()[-1] is DeliveryStatus.DELIVERED


def test_fragments_in_any_order_and_twice_become_one_whole(pair: Pair) -> None:
    one, two = pair
    chance = random.Random(2)
    payload = chance.randbytes(100_000)

    def shaken(octets: list[bytes]) -> list[bytes]:
        shaken = octets * 2
        chance.shuffle(shaken)
        return shaken

    one.put(Ipn(2, 1), payload)
    carry(one, two, bundle_octets=1400, change=shaken)
    assert two.take() == [payload]
    assert one.node.outbox.depth() == 0


def test_a_returned_fragment_is_sent_alone(pair: Pair) -> None:
    one, two = pair
    one.put(Ipn(2, 1), bytes(5000))
    sent = one.node.sending.outgoing("ipn:2.0", 10_000, 1400)
    assert len(sent) == 4
    assert all(len(outgoing.octets) <= 1400 for outgoing in sent)
    one.node.sending.mark_forwarded(sent[1:])
    one.node.sending.requeue("ipn:2.0", sent[:1])
    one.commit()
    assert one.node.outbox.depth() == 1
    for outgoing in sent[1:]:
        two.node.receiving.receive("ipn:1.0", outgoing.octets)
    two.commit()
    assert two.take() == []
    carry(one, two)
    assert two.take() == [bytes(5000)]
    assert one.node.outbox.depth() == 0


def test_fragments_of_what_never_becomes_whole_end_with_the_lifetime(
    pair: Pair, clock: Clock
) -> None:
    one, two = pair
    one.put(Ipn(2, 1), bytes(5000), lifetime_s=10.0)
    carry(one, two, bundle_octets=1400, change=lambda octets: octets[1:])
    clock.utc_ms += 10_000
    two.tick()
    assert two.node.expired == 1
    assert two.database.read("SELECT count(*) FROM fragments") == [(0,)]


def test_each_incomplete_unit_is_counted_as_expired(
    pair: Pair, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "_FORGET_BATCH", 2)
    one, two = pair
    for _ in range(4):
        one.put(Ipn(2, 1), bytes(5000), lifetime_s=10.0)
        carry(one, two, bundle_octets=1400, change=lambda octets: octets[1:])
    assert two.database.read("SELECT count(DISTINCT key) FROM fragments") == [(4,)]
    clock.utc_ms += 10_000
    two.tick()
    assert two.node.expired == 2
    two.tick()
    assert two.node.expired == 4
    assert two.database.read("SELECT count(*) FROM fragments") == [(0,)]


def test_a_node_between_forwards(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2, hop_limit=3), clock)
    two = TestedNode(tmp_path, settings_of(2, 3, 1), clock)
    three = TestedNode(tmp_path, settings_of(3, 2), clock)
    one.put(Ipn(3, 1), b"x", confirm=True)
    carry(one, two)
    two.restart()
    received: list[bytes] = []

    def listen(octets: list[bytes]) -> list[bytes]:
        received.extend(octets)
        return octets

    carry(two, three, change=listen)
    bundle = decode_bundle(received[0])
    block = bundle.block(BlockType.HOP_COUNT)
    assert block
    assert decode_hop_count(block.data) == HopCount(3, 1)
    assert bundle.block(BlockType.PREVIOUS_NODE)
    assert three.take() == [b"x"]
    carry(three, two)
    carry(two, one)
    assert one.fates() == [DeliveryStatus.HANDED_ON, DeliveryStatus.DELIVERED]


def test_a_later_neighbour_may_be_reached_through_another(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    one.put(Ipn(3, 1), b"x")
    one.settings = settings_of(1, 2, 3)
    one.restart()
    assert one.node.outbox.depth("ipn:3.0") == 1


def test_a_forwarded_bundle_changes_only_its_forwarding_blocks(pair: Pair) -> None:
    one, _ = pair
    one.put(Ipn(2, 1), b"x")
    (sent,) = one.node.sending.outgoing("ipn:2.0", 1000, 1000)
    assert encode_bundle(decode_bundle(sent.octets)) == sent.octets


def test_a_listener_that_raises_does_not_affect_the_others(pair: Pair) -> None:
    one, _ = pair
    received: list[object] = []

    def fail(_: object) -> None:
        raise ZeroDivisionError

    one.node.put(Ipn(2, 1), b"x")
    for listener in (received.append, fail, received.append):
        one.node.transaction.on_commit(listener)
    with pytest.raises(ZeroDivisionError):
        one.node.transaction.commit()
    assert received == [None, None]
    assert not one.node.transaction.pending


def test_long_bundles_are_not_all_read_at_once(pair: Pair) -> None:
    one, two = pair
    payloads = [bytes((number,)) * 700_000 for number in range(10)]
    for payload in payloads:
        one.put(Ipn(2, 1), payload)
    assert len(one.node.outbox.waiting("ipn:2.0", 0, 32, one.clock())) == 2
    carry(one, two)
    assert two.take() == payloads


def test_a_unit_that_is_too_long_is_not_gathered(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1, max_payload_octets=4999), clock)
    one.put(Ipn(2, 1), bytes(5000), confirm=True)
    carry(one, two, bundle_octets=1400)
    carry(two, one)
    assert one.fates() == [DeliveryStatus.HANDED_ON, *[DeliveryStatus.DELETED] * 4]
    assert two.database.read("SELECT count(*) FROM fragments") == [(0,)]


def test_a_bundle_that_cannot_be_cut_for_its_link_is_deleted_and_reported(
    pair: Pair, caplog: pytest.LogCaptureFixture
) -> None:
    one, two = pair
    one.put(Ipn(2, 1), bytes(500))
    carry(one, two, bundle_octets=40)
    one.commit()
    assert one.fates() == [DeliveryStatus.DELETED]
    assert one.node.outbox.depth() == 0
    assert "cannot be fragmented to 40 octets, bundle_octets of the link to ipn:2.0" in caplog.text


@pytest.mark.parametrize("destination", [Ipn(2, 9), Ipn(9, 1)])
def test_a_bundle_that_cannot_proceed_is_deleted_and_reported(pair: Pair, destination: Ipn) -> None:
    one, two = pair
    one.put(destination, b"x", confirm=True)
    carry(one, two)
    carry(two, one)
    assert one.fates() == [DeliveryStatus.HANDED_ON, DeliveryStatus.DELETED]
    assert two.take() == []


def test_a_bundle_may_be_forwarded_up_to_its_hop_limit(tmp_path: Path, clock: Clock) -> None:
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
    two = TestedNode(tmp_path, settings_of(2, 1), clock, StoreLimits(max_octets=400_000))
    for _ in range(100):
        one.put(Ipn(2, 1), bytes(5000))
    taken = 0
    while sent := one.node.sending.outgoing("ipn:2.0", 1, 10_000):
        try:
            two.node.receiving.receive("ipn:1.0", sent[0].octets)
        except StoreFull:
            one.node.sending.requeue("ipn:2.0", sent)
            taken += len(two.take())
        assert two.commit() is None
        if not two.node.inbox.depth():
            continue
        one.node.sending.mark_forwarded(sent)
        one.commit()
    assert taken
    assert taken + len(two.take()) >= 100


def test_a_full_disk_refuses_uncommitted_bundles(tmp_path: Path, clock: Clock) -> None:
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
    stored = one.node.outbox.depth()
    assert stored == 1 + put // 10 * 10
    with pytest.raises(StoreFull):
        one.node.put(Ipn(2, 1), b"x")
    one.database.read("PRAGMA max_page_count = 4000")
    one.commit()
    one.put(Ipn(2, 1), b"x")
    assert one.node.outbox.depth() == stored + 1


def test_a_malformed_bundle_is_dropped_and_counted(pair: Pair) -> None:
    one, two = pair
    one.put(Ipn(2, 1), b"good")
    carry(one, two, change=lambda octets: [b"".join(octets) + b"\x9f\x00"])
    assert two.take() == [b"good"]
    assert two.node.receiving.malformed == 1


def test_an_unreachable_destination_is_an_error_of_the_caller(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1), clock)
    for destination in (Ipn(2, 1), Ipn(1, 2), Ipn(0, 0), NONE):
        with pytest.raises(ValueError, match="no neighbour"):
            one.node.put(destination, b"x")


def test_a_store_accepts_again_once_its_disk_has_space_without_any_write(
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


def test_a_store_without_its_folder_accepts_nothing_further(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)

    def fail_without_folder(path: Path) -> None:
        raise FileNotFoundError(path)

    monkeypatch.setattr(os, "statvfs", fail_without_folder)
    one.put(Ipn(2, 1), b"the last that goes in")
    with pytest.raises(StoreFull):
        one.node.put(Ipn(2, 1), b"one too many")


def test_an_expired_bundle_is_reported_and_not_sent_though_the_link_opens_first(
    tmp_path: Path,
) -> None:
    clock = Clock()
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1), clock)
    one.put(Ipn(2, 1), b"short", lifetime_s=10.0)
    one.put(Ipn(2, 1), b"long")
    clock.utc_ms += 10_000
    carry(one, two)
    assert two.take() == [b"long"]
    one.tick()
    assert one.fates() == [DeliveryStatus.HANDED_ON, DeliveryStatus.EXPIRED]


def test_an_unlimited_lifetime_is_the_maximum_that_can_be_encoded(tmp_path: Path) -> None:
    clock = Clock()
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1), clock)
    one.put(Ipn(2, 1), b"x", lifetime_s=inf)
    carry(one, two)
    assert two.take() == [b"x"]
