"""Block integrity: what is rightly signed is taken, in both forms, and nothing else."""

import hmac
import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from cryptography.hazmat.primitives.keywrap import aes_key_wrap
from hypothesis import given
from hypothesis import strategies as st

from adapters.bundle.codec import cbor
from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    Block,
    BlockType,
    Bundle,
    Crc,
    Creation,
    Flag,
    Primary,
    decode_bundle,
    encode_bundle,
)
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import BundleError, DecodeError
from adapters.bundle.codec.integrity import IntegrityVariant, Key, Sha, sign, verify
from adapters.bundle.commands import bundle
from adapters.bundle.node.reporting import DeliveryStatus
from adapters.bundle.node.security import (
    KeySettings,
    PolicySettings,
    Security,
    SecuritySettings,
    load_security,
)
from tests.bundle.nodes import Clock, TestedNode, carry, settings_of

SECRET = bytes(range(32))
PRIMARY = Primary(Ipn(2, 1), Ipn(1, 1), Ipn(1, 0), Creation(7, 0), 1000)
PLAIN = Bundle(PRIMARY, (Block(BlockType.PAYLOAD, 1, b"drive", crc=Crc.CRC32C),))
KEYS = st.builds(Key, st.just(SECRET), st.sampled_from(IntegrityVariant), st.sampled_from(Sha))
TARGETS = st.sampled_from([(0,), (1,), (0, 1)])


@given(KEYS, TARGETS)
def test_a_signed_bundle_is_verified_on_the_wire(key: Key, targets: tuple[int, ...]) -> None:
    octets = encode_bundle(sign(PLAIN, key, Ipn(1, 0), targets))
    checks = verify(octets, decode_bundle(octets), key)
    assert [(check.target, check.error) for check in checks] == [(n, "") for n in targets]
    other = replace(key, octets=SECRET[::-1])
    assert all(check.error for check in verify(octets, decode_bundle(octets), other))


@given(KEYS, TARGETS, st.data())
def test_no_changed_octet_passes(key: Key, targets: tuple[int, ...], data: st.DataObject) -> None:
    octets = bytearray(encode_bundle(sign(PLAIN, key, Ipn(1, 0), targets)))
    octets[data.draw(st.integers(0, len(octets) - 1))] ^= data.draw(st.integers(1, 255))
    with suppress(DecodeError):
        bundle = decode_bundle(bytes(octets))
        checks = verify(bytes(octets), bundle, key)
        sound = {check.target for check in checks if not check.error}
        assert 1 not in sound or (bundle.payload, bundle.primary.source) == (b"drive", Ipn(1, 1))
        assert 0 not in sound or replace(bundle.primary, crc=Crc.NONE) == replace(
            PRIMARY, crc=Crc.NONE
        )


def test_the_two_variants_are_not_confused() -> None:
    for one, other in (IntegrityVariant, reversed(IntegrityVariant)):
        octets = encode_bundle(sign(PLAIN, Key(SECRET, one), Ipn(1, 0), (1,)))
        (check,) = verify(octets, decode_bundle(octets), Key(SECRET, other))
        assert check.error == "HMAC does not match"


def asb(
    targets: Sequence[int] = (1,),
    parameters: Sequence[tuple[int, bytes]] = ((1, b"\x05"), (3, b"\x07")),
    results: Sequence[bytes] = (bytes(32),),
    context: int = 1,
    more: bytes = b"",
) -> bytes:
    """Build the content of a BIB by hand."""
    return b"".join(
        (
            cbor.array(len(targets)),
            *map(cbor.unsigned, targets),
            cbor.unsigned(context),
            b"\x01\x82\x02\x82\x01\x00",
            cbor.array(len(parameters)),
            *(cbor.array(2) + cbor.unsigned(name) + value for name, value in parameters),
            cbor.array(len(results)),
            *(b"\x81\x82\x01" + cbor.octet_string(result) for result in results),
            more,
        )
    )


def check(*contents: bytes, key: Key = Key(SECRET, IntegrityVariant.ION)) -> str:  # noqa: B008 - frozen
    bibs = [Block(BlockType.INTEGRITY, 2 + n, data) for n, data in enumerate(contents)]
    octets = encode_bundle(replace(PLAIN, blocks=(*bibs, *PLAIN.blocks)))
    return verify(octets, decode_bundle(octets), key)[0].error


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (asb(results=(bytes(20),)), "NULL cipher suites"),
        (asb(parameters=((2, cbor.octet_string(bytes(20))),)), "NULL cipher suites"),
        (asb(parameters=((2, cbor.octet_string(bytes(4096))),)), "wrapped key of 4096 octets"),
        (asb(parameters=((2, cbor.octet_string(bytes(40))),)), "cannot be unwrapped"),
        (asb(parameters=((1, b"\x04"),)), "SHA variant 4"),
        (asb(parameters=((1, b"\x06"),)), "HMAC has 32 octets, SHA384 needs 48"),
        (asb(parameters=((3, b"\x08"),)), "scope flags 8"),
        (asb(targets=(0,)), "ION signs no primary block with scope flags 7"),
        (asb(targets=(9,)), "target block is missing"),
        (asb(targets=(2,), parameters=()), "ambiguous"),
        (asb(), "HMAC does not match"),
    ],
)
def test_an_invalid_signature_is_named(content: bytes, fault: str) -> None:
    assert fault in check(content)


@pytest.mark.parametrize(
    "contents",
    [
        (asb(targets=(), results=()),),
        (asb(targets=(1, 1), results=(bytes(32), bytes(32))),),
        (asb(), asb()),
        (asb(targets=(1, 0)),),
        (asb(context=2),),
        (asb(parameters=((4, b"\x00"),)),),
        (asb(parameters=((1, b"\x05"), (1, b"\x05"))),),
        (asb(more=b"\x00"),),
        (asb()[:-1],),
        (asb(targets=range(100), results=[b""] * 100),),
    ],
)
def test_a_malformed_block_is_refused(contents: tuple[bytes, ...]) -> None:
    with pytest.raises(DecodeError):
        check(*contents)


def test_a_session_key_is_unwrapped_with_the_key() -> None:
    session = bytes(32)
    signed = sign(PLAIN, Key(session, IntegrityVariant.ION), Ipn(1, 0), (1,))
    wrapped = cbor.octet_string(aes_key_wrap(SECRET, session))
    data = signed.blocks[0].data
    data = data.replace(b"\x82\x82\x01\x05", b"\x83\x82\x02" + wrapped + b"\x82\x01\x05")
    octets = encode_bundle(
        replace(signed, blocks=(replace(signed.blocks[0], data=data), *signed.blocks[1:]))
    )
    (found,) = verify(octets, decode_bundle(octets), Key(SECRET, IntegrityVariant.ION))
    assert not found.error


def security(node: int, *, key: bytes = SECRET, **policy: object) -> Security:
    settings = SecuritySettings(
        keys={"k": KeySettings(file="k")},
        policies=(PolicySettings(key="k", **policy),),  # type: ignore[arg-type]
    )
    return Security(Ipn(node, 0), settings, {"k": Key(key)})


@pytest.fixture
def signed_pair(tmp_path: Path, clock: Clock) -> tuple[TestedNode, TestedNode]:
    """Give ipn:1 and ipn:2, which sign and verify everything between them."""
    return (
        TestedNode(tmp_path, settings_of(1, 2), clock, security=security(1)),
        TestedNode(tmp_path, settings_of(2, 1), clock, security=security(2)),
    )


def test_signed_bundles_their_fragments_and_their_reports_pass_in_both_directions(
    signed_pair: tuple[TestedNode, TestedNode],
) -> None:
    one, two = signed_pair
    fragments: list[bytes] = []

    def listen(octets: list[bytes]) -> list[bytes]:
        fragments.extend(octets)
        return octets

    one.put(Ipn(2, 1), bytes(5000), confirm=True)
    carry(one, two, bundle_octets=1400, change=listen)
    assert len(fragments) > 3
    for octets in fragments:
        bundle = decode_bundle(octets)
        assert len(octets) <= 1400
        assert bundle.primary.flags & Flag.FRAGMENT
        assert bundle.block(BlockType.INTEGRITY)
    assert two.take() == [bytes(5000)]
    carry(two, one)
    assert one.fates() == [DeliveryStatus.HANDED_ON, DeliveryStatus.DELIVERED]
    assert one.node.refusals.count == two.node.refusals.count == 0


def test_a_foreign_signed_bundle_is_forwarded_unchanged_and_not_cut(
    tmp_path: Path, clock: Clock
) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock, security=security(1))
    between = TestedNode(tmp_path, settings_of(2, 3, 1), clock)
    three = TestedNode(tmp_path, settings_of(3, 2), clock, security=security(3))
    for payload in (b"x", bytes(5000)):
        one.put(Ipn(3, 1), payload)
    carry(one, between)
    carry(between, three, bundle_octets=1400)
    assert three.take() == [b"x"]


def test_a_payload_that_leaves_the_primary_block_out_is_refused_unless_allowed(
    tmp_path: Path, clock: Clock
) -> None:
    """With scope 0 anybody may send the payload again, as another bundle."""
    result = hmac.digest(SECRET, b"\x00" + cbor.octet_string(b"drive"), "sha256")
    data = asb(parameters=((1, b"\x05"), (3, b"\x00")), results=(result,))
    creation = Creation(clock.utc_ms - DTN_EPOCH_UTC_MS, 0)
    bundle = Bundle(
        replace(PRIMARY, creation=creation), (Block(BlockType.INTEGRITY, 2, data), *PLAIN.blocks)
    )
    for number, covers in enumerate((True, False)):
        folder = tmp_path / str(number)
        folder.mkdir()
        guard = security(2, covers_primary=covers)
        two = TestedNode(folder, settings_of(2, 1), clock, security=guard)
        two.node.receiving.receive("ipn:1.0", encode_bundle(bundle))
        two.commit()
        assert two.take() == ([] if covers else [b"drive"])


def test_refusals_are_counted_and_logged_now_and_then(
    tmp_path: Path, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1), clock, security=security(2))
    for _ in range(2):
        for _ in range(50):
            one.put(Ipn(2, 1), b"x")
        carry(one, two)
        clock.utc_ms += 10_000
    assert (two.node.refusals.count, two.take()) == (100, [])
    reported = [
        record.getMessage() for record in caplog.records if record.levelno == logging.WARNING
    ]
    assert [text.split(": ", 1)[1] for text in reported] == [
        "the payload is not signed",
        "the payload is not signed (49 more since the last such line)",
    ]


def test_the_first_policy_that_fits_holds(tmp_path: Path, clock: Clock) -> None:
    keys = {"a": Key(SECRET), "b": Key(SECRET[::-1])}
    files = {name: KeySettings(file=name) for name in keys}
    policies = (
        PolicySettings(key="a", source="ipn:1.*", destination="ipn:2.2"),
        PolicySettings(key="b", source="ipn:1.*"),
    )
    guard = Security(Ipn(2, 0), SecuritySettings(keys=files, policies=policies), keys)
    one = TestedNode(tmp_path, settings_of(1, 2), clock, security=security(1, key=keys["b"].octets))
    two = TestedNode(tmp_path, settings_of(2, 1), clock, security=guard)
    one.put(Ipn(2, 1), b"by b")
    one.put(Ipn(2, 2), b"by a")
    carry(one, two)
    assert two.take() == [b"by b"]
    foreign = TestedNode(tmp_path, settings_of(11, 2), clock, security=security(11))
    foreign.put(Ipn(2, 2), b"of ipn:11, which is not ipn:1.*")
    carry(foreign, two)
    assert two.take() == []


@pytest.mark.parametrize(
    ("content", "form", "fault"),
    [
        (None, IntegrityVariant.RFC9173, r"k: No such file .*; `rover bundle key"),
        (bytes(15), IntegrityVariant.RFC9173, "has 15 octets: 16 or more"),
        (bytes(33), IntegrityVariant.ION, "has 33 octets: 16, 24 or 32, without a line's end"),
    ],
)
def test_a_key_that_cannot_be_used_is_named(
    tmp_path: Path, content: bytes | None, form: IntegrityVariant, fault: str
) -> None:
    if content is not None:
        (tmp_path / "k").write_bytes(content)
    settings = SecuritySettings(
        keys={"k": KeySettings(file="k", form=form)}, policies=(PolicySettings(key="k"),)
    )
    with pytest.raises(BundleError, match=fault):
        load_security(tmp_path / "relay.yaml", settings, Ipn(1, 0))


def test_a_key_that_others_can_read_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "k").write_bytes(SECRET)
    (tmp_path / "k").chmod(0o644)
    settings = SecuritySettings(
        keys={"k": KeySettings(file="k")}, policies=(PolicySettings(key="k"),)
    )
    assert load_security(tmp_path / "relay.yaml", settings, Ipn(1, 0))
    assert "chmod 600" in caplog.text
    assert load_security(tmp_path / "relay.yaml", None, Ipn(1, 0)) is None
    with pytest.raises(ValueError, match="names the key other; keys has k"):
        SecuritySettings(keys=settings.keys, policies=(PolicySettings(key="other"),))


def test_a_key_is_made_once_and_for_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "relay.key"
    for exit_code in (0, 2):
        assert CliRunner().invoke(bundle, ["key", str(path)]).exit_code == exit_code
    assert len(path.read_bytes()) == 32
    assert path.stat().st_mode & 0o777 == 0o600
