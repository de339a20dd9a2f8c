"""What must hold when a storm is over, and what does not."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from typing import Any

from adapters.mops import Dictionary, decode, load_dictionary
from executive.record import Ledger
from executive.values.reports import Report
from tests.stress.findings import Finding
from tests.stress.journal import read_journal
from tests.stress.relay_traffic import (
    ACKNOWLEDGED,
    GIVEN,
    ORBITER_JOURNAL,
    REPORTED,
    ROVER_LEDGER,
    TOPIC_JOURNAL,
    string_of,
)


@unique
class Fault(Enum):
    """A promise that was broken."""

    LOST_UP = "acknowledged commands that did not come to the topic"
    EXECUTED_TWICE = "commands that the rover executed twice"
    CHANGED_UP = "strings at the topic that nobody sent"
    LOST_DOWN = "reports that did not come to the orbiter"
    CHANGED_DOWN = "reports that came otherwise than the rover told them"
    REPORTED_TWICE = "reports that were told to the ground twice"
    GIVEN_TWICE = "bundles that the orbiter was given twice, no kill between"


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a storm left.

    Attributes:
        acknowledged: numbers of commands for which the orbiter took responsibility.
        topic: strings that came to the topic.
        reports: of the rover, one for each execution of a command.
        known: reports of the orbiter's record.
        reported: life of the orbiter and number of each report that was told to the ground.
        given: life of the orbiter and identity of each bundle that came down.
    """

    acknowledged: Sequence[int]
    topic: Sequence[str]
    reports: Sequence[Report]
    known: Sequence[Report]
    reported: Sequence[tuple[int, int]]
    given: Sequence[tuple[int, str]]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was found.

    Attributes:
        faults: each with what it is about.
        commands: different commands at the topic.
        allowed: what may happen, and how often it did.
    """

    faults: tuple[Finding, ...]
    commands: int
    allowed: dict[str, int]


def gather(folder: Path, record: Path) -> Evidence:
    rows: defaultdict[str, list[Any]] = defaultdict(list)
    for kind, *row in read_journal(folder / ORBITER_JOURNAL):
        rows[kind].append(row)
    return Evidence(
        acknowledged=[number for (number,) in rows[ACKNOWLEDGED]],
        topic=[string for (string,) in read_journal(folder / TOPIC_JOURNAL)],
        reports=_reports(folder / ROVER_LEDGER),
        known=_reports(record),
        reported=list(map(tuple, rows[REPORTED])),
        given=list(map(tuple, rows[GIVEN])),
    )


def judge(evidence: Evidence) -> Verdict:
    """Return which promises were broken, and what is allowed and happened."""
    dictionary, strings = load_dictionary(), set(evidence.topic)
    acknowledged = set(evidence.acknowledged)
    reported = Counter(number for _, number in evidence.reported)
    executed = Counter(report.identity for report in evidence.reports)
    given = Counter(evidence.given)
    lifecycles = Counter(identity for _, identity in given)
    faults = [
        *(
            (Fault.LOST_UP, str(number))
            for number in sorted(acknowledged)
            if string_of(number, dictionary) not in strings
        ),
        *_repeated(Fault.EXECUTED_TWICE, executed),
        *((Fault.CHANGED_UP, string) for string in strings if not _is_ours(string, dictionary)),
        *_down(evidence),
        *_repeated(Fault.REPORTED_TWICE, reported),
        *_repeated(Fault.GIVEN_TWICE, given),
    ]
    allowed = {
        "commands not acknowledged": len(strings) - len(acknowledged),
        "commands published again, the ledger knows": len(evidence.topic) - len(strings),
        "bundles given again after a kill": sum(count - 1 for count in lifecycles.values()),
        "reports in two bundles": len(lifecycles) - len(evidence.known),
        "reports kept, killed before telling": len(
            {e.sequence for e in evidence.known} - set(reported)
        ),
    }
    return Verdict(tuple(faults), len(strings), allowed)


def _repeated(fault: Fault, counts: Counter[Any]) -> Iterator[Finding]:
    return ((fault, str(each)) for each, count in counts.items() if count > 1)


def _is_ours(string: str, dictionary: Dictionary) -> bool:
    number = decode(string.encode()).moe_inputs_id
    return number is not None and string == string_of(number, dictionary)


def _down(evidence: Evidence) -> Iterator[Finding]:
    known = {report.sequence: report for report in evidence.known}
    for report in evidence.reports:
        there = known.pop(report.sequence, None)
        if there is None:
            yield Fault.LOST_DOWN, str(report.sequence)
        elif (there.identity, there.stage) != (report.identity, report.stage):
            yield Fault.CHANGED_DOWN, f"{there} and not {report}"
    for number in known:
        yield Fault.CHANGED_DOWN, f"{number} was never told"


def _reports(path: Path) -> Sequence[Report]:
    ledger = Ledger(path)
    found = ledger.reports(count=1 << 30)
    ledger.abandon()
    return found
