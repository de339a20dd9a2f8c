"""Files of recorded bundles, LTP segments and TCPCL streams, with what they are known to say."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from adapters.bundle.errors import BundleError


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
