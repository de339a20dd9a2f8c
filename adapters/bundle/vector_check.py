"""Holds recorded bundles, LTP segments and TCPCL streams against this package."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

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
from adapters.bundle.codec.report import Assertion, StatusReport, decode_report
from adapters.bundle.links.ltp_segment import (
    Data,
    Report,
    ReportAck,
    decode_segment,
    encode_segment,
)
from adapters.bundle.links.tcpcl_session import (
    VERSION,
    ContactHeader,
    MessageReader,
    encode_message,
)

_MOST_SEGMENT_OCTETS: Final = 1 << 24
_LTP_TYPES: Final = {"red data": Data, "report segment": Report, "report-ack": ReportAck}


class VectorFileError(BundleError):
    """A file is no vector file; the text is one line."""


@dataclass(frozen=True, slots=True)
class Vector:
    """Something recorded.

    Attributes:
        label: what to call it in a report.
        octets: what was on the wire.
        given: the other members of the JSON object, not checked yet.
    """

    label: str
    octets: bytes
    given: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class VectorFile:
    """What a file holds.

    Attributes:
        tcpcl_streams: messages of established TCPCL sessions, a list of pieces for each direction.
        contact_headers: TCPCL contact headers.
    """

    bundles: tuple[Vector, ...]
    ltp_segments: tuple[Vector, ...]
    tcpcl_streams: tuple[tuple[Vector, ...], ...]
    contact_headers: tuple[Vector, ...]


def load_vectors(path: Path) -> VectorFile:
    """Read a vector file.

    Raises:
        VectorFileError: it cannot be read, or is no vector file.
    """
    try:
        data = json.loads(path.read_bytes())
    except OSError as fault:
        raise VectorFileError(f"{path}: {fault.strerror}") from fault
    except (ValueError, RecursionError) as fault:
        raise VectorFileError(f"{path}: not JSON: {fault}") from fault
    if not isinstance(data, dict) or not isinstance(data.get("vectors"), list):
        raise VectorFileError(f"{path}: no list of vectors")
    try:
        header = data.get("tcpclv3_contact_header_of_ION")
        return VectorFile(
            _vectors("bundle", data["vectors"]),
            _vectors("LTP segment", data.get("ltp_segments", [])),
            _streams(data.get("tcpclv3_stream", [])),
            _vectors("TCPCL contact header", [header] if header else []),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as fault:
        raise VectorFileError(f"{path}: a vector is malformed: {fault!r}") from fault


def _vectors(kind: str, rows: list[dict[str, Any]]) -> tuple[Vector, ...]:
    for row in rows:
        blocks = row.get("fields", {}).get("blocks", [])
        if not all(isinstance(block, dict) for block in blocks):
            raise ValueError("blocks that are no objects")
    return tuple(
        Vector(
            " ".join(filter(None, (kind, str(index), str(row.get("name", row.get("type", "")))))),
            bytes.fromhex(row["hex"]),
            dict(row),
        )
        for index, row in enumerate(rows)
    )


def _streams(rows: list[dict[str, Any]]) -> tuple[tuple[Vector, ...], ...]:
    """Sort the recorded pieces of TCP streams by their direction."""
    directions: dict[tuple[str, str], list[Vector]] = {}
    for index, row in enumerate(rows):
        ports = (str(row["srcport"]), str(row["dstport"]))
        vector = Vector(f"TCPCL {index} {'>'.join(ports)}", bytes.fromhex(row["hex"]))
        directions.setdefault(ports, []).append(vector)
    return tuple(map(tuple, directions.values()))


@dataclass(frozen=True, slots=True)
class Verdict:
    """What one vector has come to; no disagreements is agreement."""

    label: str
    disagreements: tuple[str, ...]


def check_vectors(file: VectorFile) -> Iterator[Verdict]:
    """Check everything that a file holds, one verdict for each."""
    for check, vectors in (
        (_check_bundle, file.bundles),
        (_check_segment, file.ltp_segments),
        (_check_contact_header, file.contact_headers),
    ):
        for vector in vectors:
            try:
                found = tuple(check(vector))
            except DecodeError as error:
                found = (f"does not decode: {error}",)
            yield Verdict(vector.label, found)
    for stream in file.tcpcl_streams:
        yield from _check_stream(stream)


def _check_bundle(vector: Vector) -> Iterator[str]:
    bundle = decode_bundle(vector.octets)
    known = _known(bundle)
    for name, wanted in vector.given.get("fields", {}).items():
        if name == "blocks":
            yield from _compare_blocks(bundle, wanted)
        elif name != "payload_text" or wanted is not None:
            yield from _compare(name, known.get(name), wanted)
    yield from _compare_octets(encode_bundle(bundle), vector.octets)


def _known(bundle: Bundle) -> dict[str, Any]:
    """Return what a bundle says, in the words of the file. A wrong CRC would not have decoded."""
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
    times = {asserted.assertion: asserted.time_ms for asserted in report.asserted}
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
                yield from _compare(f"block {block.number} {name}", known[name], value)


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


def _check_segment(vector: Vector) -> Iterator[str]:
    segment = decode_segment(vector.octets)
    kind = str(vector.given.get("type", ""))
    for name, wanted in _LTP_TYPES.items():
        if kind.startswith(name) and not isinstance(segment, wanted):
            yield f"{type(segment).__name__}, {kind} wanted"
    if isinstance(segment, Data):
        flags = {"checkpoint": segment.checkpoint, "EORP": segment.ends_red}
        for word, there in (flags | {"EOB": segment.ends_block}).items():
            if (word in kind) != bool(there):
                yield f"{word} is {'there' if there else 'missing'}"
    yield from _compare_octets(encode_segment(segment), vector.octets)


def _check_contact_header(vector: Vector) -> Iterator[str]:
    (header,) = MessageReader(_MOST_SEGMENT_OCTETS).feed(vector.octets) or (None,)
    if not isinstance(header, ContactHeader):
        yield "no whole contact header"
        return
    fields = vector.given.get("fields", {})
    for name, found in (
        ("version", VERSION),
        ("keepalive_s", header.keepalive_s),
        ("eid", header.eid),
        ("flags", f"0x{header.flags:02x}"),
    ):
        if name in fields:
            wanted = str(fields[name]).split()[0] if name == "flags" else fields[name]
            yield from _compare(name, found, wanted)
    yield from _compare_octets(encode_message(header), vector.octets)


def _check_stream(pieces: tuple[Vector, ...]) -> Iterator[Verdict]:
    """Check one direction of a session; a message may span pieces."""
    reader = MessageReader(_MOST_SEGMENT_OCTETS, expect_header=False)
    fed = said = b""
    for piece in pieces:
        fed += piece.octets
        try:
            said += b"".join(map(encode_message, reader.feed(piece.octets)))
        except DecodeError as error:
            yield Verdict(piece.label, (f"does not decode: {error}",))
            return
        agrees = said == fed[: len(said)] and len(fed) - len(said) == reader.pending_octets
        yield Verdict(piece.label, () if agrees else ("encodes to other octets",))
    if reader.pending_octets:
        yield Verdict(pieces[-1].label, (f"{reader.pending_octets} octets of no whole message",))


def _compare(name: str, found: object, wanted: object) -> Iterator[str]:
    if found != wanted:
        yield f"{name} is {json.dumps(found)}, {json.dumps(wanted)} wanted"


def _compare_octets(encoded: bytes, wanted: bytes) -> Iterator[str]:
    if encoded != wanted:
        yield f"encodes to {encoded.hex()}"
