"""The recorded traces: those of the ordinary suite in full, those of the stress test as digests."""

import hashlib
import json
import lzma
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.support.random_plans import RandomPlan, random_plan

FOLDER: Final = Path(__file__).parent / "recorded"
FULL: Final = FOLDER / "traces.jsonl.xz"
DIGESTS: Final = FOLDER / "digests.bin.xz"
DIFFERENCES: Final = FOLDER / "differences.json"
SCRIPTS: Final = FOLDER / "scripts.json.xz"
DIGEST_OCTETS: Final = 4
NOT_RECORDED: Final = bytes(DIGEST_OCTETS)

CellChange = tuple[int, str, float | str]
"""Number of the subtree, name, new value."""


@dataclass(frozen=True, slots=True)
class TracedTick:
    """What one tick did.

    Attributes:
        result: letter of the root's status (K: skipped, H: halted).
        statuses: letter of the status of each node after the tick, parents before children.
        cells: changed entries of the blackboards, by subtree and name.
        leaves: starts (+) and halts (-) of commands with the number of the node, and with the
            arguments pan and tilt at the start of a setCameraAngles.
    """

    result: str
    statuses: str
    cells: tuple[CellChange, ...] = ()
    leaves: tuple[tuple[str | float, ...], ...] = ()

    def values(self) -> list[object]:
        """Return the tick as JSON."""
        return [self.result, self.statuses, self.cells, self.leaves]


Trace = tuple[TracedTick, ...]


@dataclass(frozen=True, slots=True)
class RecordedPlan:
    """A random plan with its trace.

    Attributes:
        corrections: nodes whose faults of 4.10 change the trace; it was recorded without them.
        bounded: whether 4.10 would repeat a tick for ever.
    """

    seed: int
    trace: Trace
    corrections: tuple[str, ...]
    bounded: bool

    @property
    def plan(self) -> RandomPlan:
        """The plan."""
        return random_plan(self.seed)


def trace_of(ticks: Sequence[Sequence[object]]) -> Trace:
    """Return a trace that was stored as JSON."""
    return tuple(
        TracedTick(str(result), str(statuses), _rows(cells), _rows(leaves))
        for result, statuses, cells, leaves in ticks
    )


def _rows(rows: object) -> tuple[tuple[int, str, float | str], ...]:
    assert isinstance(rows, list | tuple)
    return tuple(tuple(row) for row in rows)


def digest_of(trace: Trace) -> bytes:
    """Return a digest that is never that of a trace not recorded."""
    content = json.dumps([tick.values() for tick in trace], separators=(",", ":")).encode()
    digest = hashlib.sha256(content).digest()[:DIGEST_OCTETS]
    return digest if digest != NOT_RECORDED else b"\1" * DIGEST_OCTETS


def recorded_plans() -> Iterator[RecordedPlan]:
    """Yield the plans whose traces are stored in full."""
    with lzma.open(FULL, "rt", encoding="utf-8") as lines:
        for line in lines:
            seed, corrections, bounded, ticks = json.loads(line)
            yield RecordedPlan(seed, trace_of(ticks), tuple(corrections), bounded)


def recorded_digests() -> dict[int, bytes]:
    """Return the digests of the other traces, by seed."""
    content = lzma.decompress(DIGESTS.read_bytes())
    parts = (content[at : at + DIGEST_OCTETS] for at in range(0, len(content), DIGEST_OCTETS))
    return {seed: part for seed, part in enumerate(parts) if part != NOT_RECORDED}


def recorded_scripts() -> list[float | str | None]:
    """Return the result of the random script of each seed; None for an exception."""
    found: list[float | str | None] = json.loads(lzma.decompress(SCRIPTS.read_bytes()))
    return found
