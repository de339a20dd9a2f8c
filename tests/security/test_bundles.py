"""Attacks on the relay: forged, unsigned, replayed and foreign bundles, and what fills a store."""

import hmac
import random
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.bundle.codec import cbor
from adapters.bundle.codec.bundle import (
    Block,
    BlockType,
    Bundle,
    Creation,
    Flag,
    FragmentRange,
    Primary,
    decode_bundle,
    encode_bundle,
)
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.integrity import IntegrityVariant, Key, sign
from adapters.bundle.codec.report import Assertion, StatusReport, encode_report
from adapters.bundle.node.database import StoreLimits
from adapters.bundle.node.security import (
    KeySettings,
    PolicySettings,
    Security,
    SecuritySettings,
    SignedBlock,
)
from tests.bundle.nodes import START_UTC_MS, Clock, TestedNode, carry, settings_of
from tests.bundle.test_integrity import asb

SECRET, FOREIGN = bytes(range(32)), bytes(32)
ORBITER, ROVER = Ipn(1, 1), Ipn(2, 1)
NOW_MS = START_UTC_MS - 946_684_800_000
DAY_MS = 86_400_000


def guard(node: int, secret: bytes = SECRET) -> Security:
    settings = SecuritySettings(
        keys={"relay": KeySettings(file="relay.key")}, policies=(PolicySettings(key="relay"),)
    )
    return Security(Ipn(node, 0), settings, {"relay": Key(secret)})


@pytest.fixture
def orbiter(tmp_path: Path) -> TestedNode:
    return TestedNode(tmp_path, settings_of(1, 2), Clock(), security=guard(1))


@pytest.fixture
def rover(tmp_path: Path) -> TestedNode:
    return TestedNode(tmp_path, settings_of(2, 1), Clock(), security=guard(2))


@pytest.fixture
def open_rover(tmp_path: Path) -> TestedNode:
    """Give a rover without keys, with a small store."""
    limits = StoreLimits(max_octets=4_000_000)
    return TestedNode(tmp_path, settings_of(2, 1), Clock(), limits)


def forged(
    payload: bytes = b"drive",
    *,
    source: Ipn = ORBITER,
    sequence: int = 0,
    time_ms: int = NOW_MS,
    lifetime_ms: int = DAY_MS,
    part: FragmentRange | None = None,
    flags: int = 0,
) -> Bundle:
    flags |= int(Flag.FRAGMENT) if part else 0
    primary = Primary(
        ROVER, source, Ipn(1, 0), Creation(time_ms, sequence), lifetime_ms, flags, part=part
    )
    return Bundle(primary, (Block(BlockType.PAYLOAD, 1, payload),))


def attack(node: TestedNode, bundle: Bundle | bytes) -> None:
    octets = bundle if isinstance(bundle, bytes) else encode_bundle(bundle)
    node.node.receiving.receive("ipn:1.0", octets)
    node.commit()


@pytest.mark.parametrize("source", [ORBITER, Ipn(9, 9)])
def test_unsigned_bundles_move_nothing(rover: TestedNode, source: Ipn) -> None:
    attack(rover, forged(source=source))
    assert (rover.take(), rover.node.refusals.count) == ([], 1)


@pytest.mark.parametrize("form", IntegrityVariant)
def test_bundles_of_a_foreign_key_move_nothing(rover: TestedNode, form: IntegrityVariant) -> None:
    attack(rover, sign(forged(), Key(FOREIGN, form), Ipn(1, 0), (0, 1)))
    assert (rover.take(), rover.node.refusals.count) == ([], 1)


@pytest.mark.at_length
def test_thousands_of_refused_bundles_leave_nothing_before_a_stop(
    orbiter: TestedNode, rover: TestedNode
) -> None:
    for sequence in range(2000):
        octets = encode_bundle(forged(sequence=sequence))
        rover.node.receiving.receive("ipn:1.0", octets)
    rover.commit()
    orbiter.put(ROVER, b"stop", expedited=True)
    (sent,) = orbiter.node.sending.outgoing("ipn:2.0", 1000, 1000, expedited=True)
    attack(rover, sent.octets)
    assert (rover.take(), rover.node.refusals.count) == ([b"stop"], 2000)


def test_signatures_moved_to_other_bundles_move_nothing(
    orbiter: TestedNode, rover: TestedNode
) -> None:
    """Another payload, time, lifetime, destination or fragment under a signature that was heard."""
    orbiter.put(ROVER, b"stop")
    (sent,) = orbiter.node.sending.outgoing("ipn:2.0", 1000, 1000)
    received = decode_bundle(sent.octets)
    primary, payload = received.primary, received.blocks[-1]
    for other in (
        replace(received, blocks=(*received.blocks[:-1], replace(payload, data=b"drive"))),
        replace(received, primary=replace(primary, creation=Creation(NOW_MS, 99))),
        replace(received, primary=replace(primary, lifetime_ms=primary.lifetime_ms + DAY_MS)),
        replace(received, primary=replace(primary, destination=Ipn(2, 2))),
        replace(received, primary=replace(primary, source=Ipn(1, 2))),
        replace(
            received, primary=replace(primary, flags=int(Flag.FRAGMENT), part=FragmentRange(0, 4))
        ),
        replace(received, blocks=(payload,)),
    ):
        attack(rover, other)
    assert (rover.take(), rover.node.refusals.count) == ([], 7)
    attack(rover, received)
    assert rover.take() == [b"stop"]


def test_replayed_bundles_move_nothing_again(orbiter: TestedNode, rover: TestedNode) -> None:
    orbiter.put(ROVER, b"drive", lifetime_s=60.0)
    (sent,) = orbiter.node.sending.outgoing("ipn:2.0", 1000, 1000)
    attack(rover, sent.octets)
    assert rover.take() == [b"drive"]
    for wait_ms in (0, 59_000, 1000, DAY_MS):
        rover.clock.utc_ms += wait_ms
        rover.tick()
        attack(rover, sent.octets)
        assert rover.take() == []
        rover.restart()


def test_a_forged_report_confirms_nothing(orbiter: TestedNode) -> None:
    """What is to be confirmed stays, whoever says that it was delivered."""
    orbiter.put(ROVER, b"drive", confirm=True)
    (sent,) = orbiter.node.sending.outgoing("ipn:2.0", 1000, 1000)
    reported = decode_bundle(sent.octets).primary.creation
    report = encode_report(StatusReport({Assertion.DELIVERED: None}, 0, ORBITER, reported))
    bundle = forged(report, source=Ipn(2, 0), flags=int(Flag.ADMINISTRATIVE))
    attack(orbiter, replace(bundle, primary=replace(bundle.primary, destination=Ipn(1, 0))))
    assert (orbiter.node.outbox.depth(), orbiter.node.refusals.count) == (1, 1)


def test_random_octets_of_a_signature_end_no_process(
    orbiter: TestedNode, rover: TestedNode
) -> None:
    chance = random.Random(1)
    orbiter.put(ROVER, b"drive")
    (sent,) = orbiter.node.sending.outgoing("ipn:2.0", 1000, 1000)
    for _ in range(2000):
        octets = bytearray(sent.octets)
        for _ in range(chance.randrange(1, 4)):
            octets[chance.randrange(len(octets))] = chance.randrange(256)
        if octets != sent.octets:
            attack(rover, bytes(octets))
    # What no signature covers may differ: who signed, spare bits.
    assert rover.take() in ([], [b"drive"])


@pytest.mark.parametrize(
    ("time_ms", "lifetime_ms", "why"),
    [
        (NOW_MS + 365 * DAY_MS, DAY_MS, "creation time is 31536000 s ahead of the clock here"),
        (2**63, 0, "ahead of the clock here"),
        (NOW_MS, 2**63, "max_lifetime_s is 5184000"),
        (NOW_MS, 34 * 365 * DAY_MS, "max_lifetime_s is 5184000"),
    ],
)
def test_times_without_measure_are_refused(
    open_rover: TestedNode,
    time_ms: int,
    lifetime_ms: int,
    why: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    attack(open_rover, forged(time_ms=time_ms, lifetime_ms=lifetime_ms))
    assert (open_rover.take(), open_rover.node.refusals.count) == ([], 1)
    assert why in caplog.text


@pytest.mark.parametrize("sources", [1, 40])
def test_forged_fragments_use_a_part_of_the_store_and_whole_bundles_are_accepted(
    open_rover: TestedNode, sources: int
) -> None:
    """700 fragments of 50 kB filled the store and shut the rover off, a stop included."""
    for number in range(700):
        source = Ipn(100 + number % sources, 1)
        part = FragmentRange(0, 500_000)
        attack(open_rover, forged(bytes(50_000), source=source, sequence=number, part=part))
    held = open_rover.database.read("SELECT sum(length) FROM fragments")[0][0]
    assert held <= (1_100_000 if sources == 1 else 2_100_000)
    assert open_rover.node.refusals.count > 600
    attack(open_rover, forged(b"a command", sequence=1))
    for at in (0, 4000):
        attack(open_rover, forged(bytes(4000), sequence=2, part=FragmentRange(at, 8000)))
    assert open_rover.take() == [b"a command", bytes(8000)]


def test_overlapping_fragments_use_only_their_part(open_rover: TestedNode) -> None:
    """One unit, of which ever longer pieces come, under ever other total lengths."""
    for number in range(300):
        part = FragmentRange(number, 100_000 + number)
        attack(open_rover, forged(bytes(50_000 + number), part=part))
    held = open_rover.database.read("SELECT sum(length) FROM fragments")[0][0]
    assert held <= 1_100_000
    attack(open_rover, forged(b"a command", sequence=1))
    assert open_rover.take() == [b"a command"]


def test_where_keys_are_set_forged_fragments_take_nothing(
    orbiter: TestedNode, rover: TestedNode
) -> None:
    for number in range(100):
        attack(rover, forged(bytes(1000), sequence=number, part=FragmentRange(0, 2000)))
    assert rover.database.read("SELECT count(*) FROM fragments") == [(0,)]
    orbiter.put(ROVER, bytes(5000))
    carry(orbiter, rover, bundle_octets=1400)
    assert rover.take() == [bytes(5000)]


def test_a_payload_that_is_not_tied_to_the_primary_block_is_refused() -> None:
    """One of another bundle, under a primary block that is rightly signed beside it."""
    both = PolicySettings(key="relay", targets=(SignedBlock.PAYLOAD, SignedBlock.PRIMARY))
    settings = SecuritySettings(keys={"relay": KeySettings(file="relay.key")}, policies=(both,))
    security = Security(Ipn(2, 0), settings, {"relay": Key(SECRET)})
    signed = sign(forged(), Key(SECRET), Ipn(1, 0), (0, 1))
    result = hmac.digest(SECRET, b"\x00" + cbor.octet_string(b"drive"), "sha256")
    free = asb(parameters=((1, b"\x05"), (3, b"\x00")), results=(result,))
    blocks = (signed.blocks[0], Block(BlockType.INTEGRITY, 3, free), *forged().blocks)
    moved = replace(signed, blocks=blocks)
    assert security.signature_error(signed, encode_bundle(signed), local=True) == ""
    assert "primary" in security.signature_error(moved, encode_bundle(moved), local=True)
