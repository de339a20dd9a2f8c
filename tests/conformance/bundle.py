"""The command `rover bundle` of a checkout: recorded octets, against this bundle agent."""

import hmac
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import click

from adapters.bundle.codec.bundle import (
    Block,
    BlockType,
    Bundle,
    Crc,
    Flag,
    decode_age,
    decode_bundle,
    decode_hop_count,
    encode_bundle,
)
from adapters.bundle.codec.eid import decode_eid
from adapters.bundle.codec.errors import BundleError, DecodeError
from adapters.bundle.codec.integrity import IntegrityVariant, Key, verify
from adapters.bundle.codec.report import Assertion, StatusReport, decode_report
from adapters.bundle.commands import key
from adapters.bundle.links.ltp_segment import (
    Data,
    ReportAck,
    ReportSegment,
    decode_segment,
    encode_segment,
)
from adapters.bundle.links.tcpcl_messages import (
    VERSION,
    ContactHeader,
    MessageReader,
    encode_message,
)
from tests.conformance.vectors import (
    FILE,
    VERBOSE,
    Vector,
    Verdict,
    differing,
    differing_octets,
    judge,
    report,
)

_MAX_SEGMENT_OCTETS: Final = 1 << 24
_LTP_TYPES: Final = {"red data": Data, "report segment": ReportSegment, "report-ack": ReportAck}


@click.group()
def bundle() -> None:
    """Look into bundles of the Bundle Protocol, version 7.

    \b
    Example:
      rover bundle check vectors.json
    """


bundle.add_command(key)


@bundle.command()
@FILE
@VERBOSE
def check(path: Path, verbose: bool) -> None:
    """Check recorded bundles, LTP segments and TCPCL streams, octet for octet.

    FILE is JSON with a list of vectors, each with its octets in hex and the fields they are known
    to have. Each is decoded, its CRCs are verified, it is compared, encoded again and compared with
    itself. Bundles with an "expected_verdict" are judged by their signatures (RFC 9173, or NASA
    ION's form of it), with the key and for the targets that the vector names: one line for each.

    Exit status: 0 if everything agrees, 1 if something does not or there is nothing, 2 if FILE
    cannot be used.

    \b
    Example:
      rover bundle check vectors.json
    """
    report(path, _verdicts, verbose)


def _verdicts(data: Vector) -> Iterator[Verdict]:
    headers = [header] if (header := data.get("tcpclv3_contact_header_of_ION")) else []
    plain = [row for row in data["vectors"] if "expected_verdict" not in row]
    signed = [row for row in data["vectors"] if "expected_verdict" in row]
    yield from _check_rows("bundle", plain, _check_bundle)
    for index, row in enumerate(signed):
        yield _check_signature(index, row)
    yield from map(_check_hmac, data.get("rfc9173_ippt_examples", []))
    yield from _check_rows("LTP segment", data.get("ltp_segments", []), _check_segment)
    yield from _check_rows("TCPCL contact header", headers, _check_contact_header)
    yield from _check_streams(data.get("tcpclv3_stream", []))


def _check_rows(
    kind: str, rows: list[Vector], check: Callable[[bytes, Vector], Iterator[str]]
) -> Iterator[Verdict]:
    for index, row in enumerate(rows):
        if not all(isinstance(block, dict) for block in row.get("fields", {}).get("blocks", [])):
            raise ValueError("blocks that are no objects")
        label = f"{kind} {index} {row.get('name', row.get('type', ''))}".rstrip()
        yield judge(label, check(bytes.fromhex(row["hex"]), row), DecodeError)


def _check_signature(index: int, row: Vector) -> Verdict:
    """Compare the verdict on a bundle, by its octets and the key of its receiver."""
    octets = bytes.fromhex(row["hex"])
    wanted = row.get("required_targets") or []
    try:
        bundle = decode_bundle(octets, lenient=True)
        found, why = _judge(octets, bundle, row, set(wanted))
    except BundleError as error:
        found, why = "invalid", str(error)
    expected = row["expected_verdict"]
    differs = () if found == expected else (f"{found} ({why}), {expected} wanted",)
    return Verdict(f"signature {index} {row.get('name', '')}".rstrip(), differs, f"{found}: {why}")


def _judge(octets: bytes, bundle: Bundle, row: Vector, wanted: set[int]) -> tuple[str, str]:
    if bundle.block(BlockType.INTEGRITY) is None:
        return ("invalid", "not signed, and has to be") if wanted else ("unsigned", "no BIB")
    if not row.get("key_hex"):
        return "invalid", "there is no key"
    form = (
        IntegrityVariant.ION
        if str(row.get("ippt_form")).startswith("ion")
        else IntegrityVariant.RFC9173
    )
    checks = verify(octets, bundle, Key(bytes.fromhex(row["key_hex"]), form), lenient=True)
    for check in checks:
        if check.error:
            return "invalid", f"block {check.target}: {check.error}"
    if missing := wanted - {check.target for check in checks}:
        return "invalid", f"block {min(missing)} is not signed, and has to be"
    reported = (f"block {check.target} with scope {check.scope}" for check in checks)
    return "valid", f"{', '.join(reported)}, form {form.value}"


def _check_hmac(row: Vector) -> Verdict:
    key, octets = bytes.fromhex(row["key_hex"]), bytes.fromhex(row["ippt"])
    result = hmac.digest(key, octets, row["alg"]).hex()
    differs = () if result == row["hmac"] else (f"HMAC is {result}, {row['hmac']} wanted",)
    return Verdict(f"HMAC {row.get('name', '')}".rstrip(), differs)


def _check_bundle(octets: bytes, row: Vector) -> Iterator[str]:
    bundle = decode_bundle(octets)
    known = _known(bundle)
    for name, wanted in row.get("fields", {}).items():
        if name == "blocks":
            yield from _compare_blocks(bundle, wanted)
        elif name != "payload_text" or wanted is not None:
            yield from differing(wanted, known.get(name), name)
    yield from differing_octets(octets, encode_bundle(bundle))


def _known(bundle: Bundle) -> dict[str, Any]:
    """Return the fields of a bundle by the file's names; with a wrong CRC it would not decode."""
    primary = bundle.primary
    known: dict[str, Any] = {
        "version": 7,
        "flags": primary.flags,
        "crc": int(primary.crc),
        "crc_ok": None if primary.crc is Crc.NONE else True,
        "destination": str(primary.destination),
        "source": str(primary.source),
        "report_to": str(primary.report_to),
        "creation": [primary.creation.time_ms, primary.creation.sequence],
        "lifetime_ms": primary.lifetime_ms,
        "payload_hex": bundle.payload.hex(),
        "payload_text": bundle.payload.decode(errors="replace"),
    }
    if primary.part:
        known["fragment_offset"] = primary.part.offset
        known["total_adu_length"] = primary.part.total
    if primary.flags & Flag.ADMINISTRATIVE and (report := decode_report(bundle.payload)):
        known["admin"] = _report(report)
    return known


def _report(report: StatusReport) -> list[Any]:
    times = report.asserted
    asserted = [
        [True, *(() if times[kind] is None else (times[kind],))] if kind in times else [False]
        for kind in Assertion
    ]
    scheme, name = str(report.source).split(":")
    source = [2, list(map(int, name.split(".")))] if scheme == "ipn" else [1, name]
    creation = [report.creation.time_ms, report.creation.sequence]
    return [1, [asserted, report.reason, source, creation]]


def _compare_blocks(bundle: Bundle, wanted: list[dict[str, Any]]) -> Iterator[str]:
    if len(wanted) != len(bundle.blocks):
        yield f"{len(bundle.blocks)} blocks, {len(wanted)} wanted"
    for block, fields in zip(bundle.blocks, wanted, strict=False):
        known = _known_block(block)
        for name, value in fields.items():
            if name in known:
                yield from differing(value, known[name], f"block {block.number} {name}")


def _known_block(block: Block) -> dict[str, Any]:
    known: dict[str, Any] = {
        "type": block.type,
        "number": block.number,
        "flags": block.flags,
        "crc": int(block.crc),
        "crc_ok": None if block.crc is Crc.NONE else True,
        "data": block.data.hex(),
    }
    match block.type:
        case BlockType.PREVIOUS_NODE:
            known["previous_node"] = str(decode_eid(block.data))
        case BlockType.BUNDLE_AGE:
            known["age_ms"] = decode_age(block.data)
        case BlockType.HOP_COUNT:
            hops = decode_hop_count(block.data)
            known["hop"] = [hops.limit, hops.count]
        case _:
            pass
    return known


def _check_segment(octets: bytes, row: Vector) -> Iterator[str]:
    segment = decode_segment(octets)
    kind = str(row.get("type", ""))
    for name, wanted in _LTP_TYPES.items():
        if kind.startswith(name) and not isinstance(segment, wanted):
            yield f"{type(segment).__name__}, {kind} wanted"
    if isinstance(segment, Data):
        flags = {"checkpoint": segment.checkpoint, "EORP": segment.ends_red}
        for word, there in (flags | {"EOB": segment.ends_block}).items():
            if (word in kind) != bool(there):
                yield f"{word} is {'there' if there else 'missing'}"
    yield from differing_octets(octets, encode_segment(segment))


def _check_contact_header(octets: bytes, row: Vector) -> Iterator[str]:
    (header,) = MessageReader(_MAX_SEGMENT_OCTETS).feed(octets) or (None,)
    if not isinstance(header, ContactHeader):
        yield "no whole contact header"
        return
    fields = row.get("fields", {})
    for name, found in (
        ("version", VERSION),
        ("keepalive_s", header.keepalive_s),
        ("eid", header.eid),
        ("flags", f"0x{header.flags:02x}"),
    ):
        if name in fields:
            wanted = str(fields[name]).split()[0] if name == "flags" else fields[name]
            yield from differing(wanted, found, name)
    yield from differing_octets(octets, encode_message(header))


def _check_streams(rows: list[Vector]) -> Iterator[Verdict]:
    """Check the recorded pieces of TCP streams, each direction apart."""
    directions: dict[tuple[str, str], list[tuple[str, bytes]]] = {}
    for index, row in enumerate(rows):
        ports = (str(row["srcport"]), str(row["dstport"]))
        piece = f"TCPCL {index} {'>'.join(ports)}", bytes.fromhex(row["hex"])
        directions.setdefault(ports, []).append(piece)
    for pieces in directions.values():
        yield from _check_direction(pieces)


def _check_direction(pieces: list[tuple[str, bytes]]) -> Iterator[Verdict]:
    """Check one direction of an established session; a message may span pieces."""
    reader = MessageReader(_MAX_SEGMENT_OCTETS)
    reader.feed(encode_message(ContactHeader(0, 0, "")))
    fed = message = b""
    for label, octets in pieces:
        fed += octets
        try:
            message += b"".join(map(encode_message, reader.feed(octets)))
        except DecodeError as error:
            yield Verdict(label, (str(error),))
            return
        yield Verdict(label, () if fed.startswith(message) else ("encodes to other octets",))
    if (missing := len(fed) - len(message)) > 0:
        yield Verdict(pieces[-1][0], (f"{missing} octets of no whole message",))
