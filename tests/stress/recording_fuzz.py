"""Wrong recordings to all that read recordings: only RecordingError, in bounded time and memory."""

import multiprocessing
import os
import shutil
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Final

from adapters.recording import RecordingError, RunReader
from tests.stress.findings import Finding, Findings, Log
from tests.stress.recording_mutants import Mutants, originals
from tests.stress.recording_readers import (
    MAX_CPU_S,
    MAX_MB,
    READERS,
    Meter,
    Reader,
    ReaderFault,
    Taken,
)
from tests.support.figures import Figure, Goal

PORTION: Final = 250
"""Recordings that a process reads, and then tells of."""
WARM_UP: Final = 1
"""Readings of each sound recording before memory is counted."""


@dataclass(slots=True)
class Worst:
    """The largest value that a reader needed, and for what."""

    value: float = 0.0
    of: str = ""

    def add(self, value: float, of: str) -> None:
        if value > self.value:
            self.value, self.of = value, of


@dataclass(slots=True)
class Portion:
    """What some recordings came to.

    Attributes:
        known: recordings of which all is read that was read of another; only what completes torn
            ones got them.
        read, refused: readings that went well, and that ended in RecordingError.
    """

    recordings: int = 0
    known: int = 0
    read: int = 0
    refused: int = 0
    cpu_s: Worst = field(default_factory=Worst)
    grown_mb: Worst = field(default_factory=Worst)
    findings: list[Finding] = field(default_factory=list)


def measure(count: int, seed: int, log: Log, output: Path | None = None) -> list[Figure]:
    """Return how often a reader did not keep its promise.

    Args:
        count: how many recordings.
        seed: of everything random.
        log: called with a line on each of the first faults.
        output: a folder for the recordings that a reader did not bear; None keeps none.
    """
    findings, total = Findings(log), Portion()
    sizes = [min(PORTION, count - done) for done in range(0, count, PORTION)]
    with tempfile.TemporaryDirectory(prefix="rover-recordings-") as workspace:
        sound = originals(Path(workspace))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), context, initializer=_quiet) as pool:
        take = partial(read_portion, sound, output=output)
        for portion in pool.map(take, sizes, (f"{seed}.{each}" for each in range(len(sizes)))):
            for fault, about in portion.findings:
                findings.add(fault, about)
            _add(total, portion)
            log(f"{total.recordings} of {count}, {findings.counts.total()} findings")
    beside = f"{count} wrong recordings, {len(READERS)} readers, seed {seed}"
    return [
        Figure("recordings: wrong recordings", total.recordings, "", beside),
        Figure("recordings: known by what is read of them", total.known, "", "read once"),
        Figure("recordings: readings up to the damage", total.read, "", beside),
        Figure("recordings: readings refused", total.refused, "", "RecordingError"),
        *findings.figures("recordings", ReaderFault, beside),
        Figure("recordings: CPU time", total.cpu_s.value, "s", total.cpu_s.of, Goal(MAX_CPU_S)),
        Figure("recordings: memory", total.grown_mb.value, "MB", total.grown_mb.of, Goal(MAX_MB)),
    ]


def read_portion(
    sound: list[bytes],
    count: int,
    seed: str,
    readers: Mapping[str, Reader] = READERS,
    output: Path | None = None,
) -> Portion:
    """Have so many wrong recordings read by all readers, in this process."""
    mutants, portion, known = Mutants(sound, seed), Portion(), set[bytes]()
    with tempfile.TemporaryDirectory(prefix="rover-recordings-") as workspace:
        path, folder = Path(workspace, "run.mcap"), Path(workspace, "out")
        meter = _warm(sound, readers, path, folder)
        for number in range(count):
            name, octets = mutants.next()
            path.write_bytes(octets)
            content = None if name.startswith("content") else _content_of(path)
            is_known = content in known
            if content is not None:
                known.add(content)
            portion.recordings += 1
            portion.known += is_known
            for title, reader in readers.items():
                if not is_known or title == "complete":
                    taken = _taken(meter, reader, path, folder)
                    about = f"{seed}.{number} {title}: {name}"
                    if _judge(portion, taken, about) and output is not None:
                        shutil.copy(path, output / f"{seed}.{number}.mcap")
    return portion


def _warm(sound: list[bytes], readers: Mapping[str, Reader], path: Path, folder: Path) -> Meter:
    """Return a meter of a process in which everything is loaded."""
    meter = Meter()
    for octets in sound * WARM_UP:
        path.write_bytes(octets)
        for reader in readers.values():
            _taken(meter, reader, path, folder)
    return Meter()


def _taken(meter: Meter, reader: Reader, path: Path, folder: Path) -> Taken:
    folder.mkdir()
    try:
        return meter.take(reader, path, folder)
    finally:
        shutil.rmtree(folder)


def _content_of(path: Path) -> bytes:
    """Return a digest of all that any reader gets to know of a recording."""
    digest, reader = sha256(), RunReader(path)
    with suppress(RecordingError):
        for message in reader.messages():
            digest.update(message.topic.name.encode() + message.data)
    digest.update(bytes((reader.whole, reader.damaged)))
    return digest.digest()


def _judge(portion: Portion, taken: Taken, about: str) -> bool:
    """Count what a reader made of a recording; return whether it may not."""
    before = len(portion.findings)
    portion.read += taken.read
    portion.refused += not taken.read and not taken.raised
    portion.cpu_s.add(taken.cpu_s, about)
    portion.grown_mb.add(taken.grown_mb, about)
    if taken.raised:
        portion.findings.append((ReaderFault.RAISED, f"{about}: {taken.error[:300]}"))
    if taken.cpu_s > MAX_CPU_S:
        portion.findings.append((ReaderFault.SLOW, f"{about}: {taken.cpu_s:.1f} s"))
    if taken.grown_mb > MAX_MB:
        portion.findings.append((ReaderFault.LARGE, f"{about}: {taken.grown_mb:.0f} MB"))
    return len(portion.findings) > before


def _add(total: Portion, portion: Portion) -> None:
    total.recordings += portion.recordings
    total.known += portion.known
    total.read += portion.read
    total.refused += portion.refused
    total.cpu_s.add(portion.cpu_s.value, portion.cpu_s.of)
    total.grown_mb.add(portion.grown_mb.value, portion.grown_mb.of)


def _quiet() -> None:
    """Keep what readers say beside their answer, such as warnings, out of the figures."""
    import logging
    import warnings

    logging.disable()
    warnings.simplefilter("ignore")
