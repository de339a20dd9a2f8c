"""Whether a client's view is the ledger's, whatever was killed in between."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum, unique
from hashlib import sha256
from math import hypot, inf
from pathlib import Path
from typing import Final

from executive.commands.catalogue import Request, Resume, Stop, TakePicture
from executive.values.geometry import wrap_rad
from executive.values.reports import Identity, Report, Stage
from tests.stress.findings import Finding, broken_lifecycles, lifecycles
from tests.stress.kills_journal import Answer, Answered, Entry, Fetched, Received, Sent
from tests.stress.pose_log import TruePose

BRAKING_S: Final = 1.5
"""From the acceptance of a stop on; the base stops by itself after a loss of the executive."""
STILL_M: Final = 0.02
STILL_RAD: Final = 0.035
_CLOCKS_S: Final = 0.001
"""Times travel to the millisecond."""


@unique
class Fault(Enum):
    """What must not be, beside what no life of a command may show."""

    VIEW = "commands that the client sees otherwise"
    UNKNOWN = "commands taken, not in the ledger"
    CLIENT_GAP = "reports missed, or heard otherwise"
    TAKEN_TWICE = "commands taken twice"
    DUPLICATE = "answers Duplicate to what was sent once"
    FILE = "files fetched that differ"
    PICTURE = "pictures that are not aboard"
    MOVED = "stops after which the rover moved"


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is compared.

    Attributes:
        journal: the client's.
        reports: all of the ledger, in order.
        poses: where the rover truly was, in order.
        files: the folder aboard.
    """

    journal: Sequence[Entry]
    reports: Sequence[Report]
    poses: Sequence[TruePose]
    files: Path

    @property
    def requests(self) -> dict[Identity, Request]:
        """What was sent."""
        sent = (entry.command for entry in self.journal if isinstance(entry, Sent))
        return {command.identity: command.request for command in sent}


def judge(evidence: Evidence) -> Iterator[Finding]:
    yield from _views(evidence)
    yield from broken_lifecycles(evidence.reports)
    yield from _reports(evidence)
    yield from _answers(evidence.journal)
    yield from _files(evidence)
    yield from _pictures(evidence)
    yield from _standing(evidence)


def stops(evidence: Evidence) -> list[tuple[float, float]]:
    """Return from when until when, UTC, a stop was the last thing accepted."""
    requests = evidence.requests
    found, began_s = [], None
    for report in evidence.reports:
        if report.stage is not Stage.ACCEPTED or report.identity is None:
            continue
        match requests.get(report.identity):
            case Stop() if began_s is None:
                began_s = report.utc_s
            case Resume() if began_s is not None:
                found.append((began_s, report.utc_s))
                began_s = None
    return found if began_s is None else [*found, (began_s, inf)]


def _views(evidence: Evidence) -> Iterator[Finding]:
    taken = {
        entry.identity
        for entry in evidence.journal
        if isinstance(entry, Answered) and entry.answer is not Answer.REFUSED
    }
    aboard, known = lifecycles(evidence.reports), lifecycles(_received(evidence.journal))
    for identity in evidence.requests:
        if identity in taken and identity not in aboard:
            yield Fault.UNKNOWN, str(identity)
        if known[identity] != aboard[identity]:
            yield Fault.VIEW, f"{identity}: {known[identity]}, aboard {aboard[identity]}"


def _received(journal: Sequence[Entry]) -> list[Report]:
    return [entry.report for entry in journal if isinstance(entry, Received)]


def _reports(evidence: Evidence) -> Iterator[Finding]:
    received = defaultdict(list)
    for report in _received(evidence.journal):
        received[report.sequence].append(report)
    for report in evidence.reports:
        known = received.pop(report.sequence, [])
        if not known or not all(_same(report, each) for each in known):
            yield Fault.CLIENT_GAP, f"{report.sequence}: {known or 'not heard'}, aboard {report}"
    for sequence in received:
        yield Fault.CLIENT_GAP, f"{sequence} is not aboard"


def _same(aboard: Report, received: Report) -> bool:
    """Compare but for what does not travel, or is not kept on the ground."""
    near = abs(aboard.utc_s - received.utc_s) <= _CLOCKS_S
    stored = replace(aboard, utc_s=received.utc_s, link=received.link, figures=received.figures)
    return near and stored == received


def _answers(journal: Sequence[Entry]) -> Iterator[Finding]:
    times = Counter(entry.command.identity for entry in journal if isinstance(entry, Sent))
    answers = Counter(
        (entry.identity, entry.answer) for entry in journal if isinstance(entry, Answered)
    )
    for (identity, answer), count in answers.items():
        if answer is not Answer.DUPLICATE and count > 1:
            yield Fault.TAKEN_TWICE, f"{identity} {answer.value} {count} times"
        if answer is Answer.DUPLICATE and times[identity] < 2:
            yield Fault.DUPLICATE, str(identity)


def _files(evidence: Evidence) -> Iterator[Finding]:
    for entry in evidence.journal:
        if isinstance(entry, Fetched):
            aboard = (evidence.files / entry.path).read_bytes()
            if entry.sha256 != sha256(aboard).hexdigest():
                yield Fault.FILE, f"{entry.name} of {entry.path}"


def _pictures(evidence: Evidence) -> Iterator[Finding]:
    requests = evidence.requests
    for report in evidence.reports:
        identity = report.identity
        if identity is None or report.stage is not Stage.EXECUTED:
            continue
        if isinstance(requests.get(identity), TakePicture):
            path = evidence.files / f"pictures/{identity.source}-{identity.command_id}.jpg"
            if not path.exists() or not path.read_bytes().endswith(b"\xff\xd9"):
                yield Fault.PICTURE, path.name


def _standing(evidence: Evidence) -> Iterator[Finding]:
    for begin_s, end_s in stops(evidence):
        seen = [each for each in evidence.poses if begin_s + BRAKING_S < each.utc_s < end_s]
        if not seen:
            continue
        first = seen[0]
        travelled_m = max(hypot(each.x_m - first.x_m, each.y_m - first.y_m) for each in seen)
        turned_rad = max(abs(wrap_rad(each.heading_rad - first.heading_rad)) for each in seen)
        if travelled_m > STILL_M or turned_rad > STILL_RAD:
            yield Fault.MOVED, f"from {begin_s:.2f} on: {travelled_m:.3f} m, {turned_rad:.3f} rad"
