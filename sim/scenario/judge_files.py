"""Findings about the files aboard: what was told of them, which there are, what came down."""

from collections.abc import Iterable
from zlib import crc32

from executive.files import FileEventKind
from sim.scenario.expectations import FileFetched, FileLife, FileList
from sim.scenario.finding import Finding
from sim.scenario.record import Fetched, NotFetched, Record


def file_life(expected: FileLife, record: Record) -> Finding:
    """Compare everything that was told of a file."""
    told = [
        event.kind
        for event in record.file_events
        if event.path == expected.file and event.kind is not FileEventKind.TRANSFERRED
    ]
    holds = told == list(expected.events)
    return Finding(f"file {expected.file}", _kinds(expected.events), _kinds(told), holds)


def file_list(expected: FileList, record: Record) -> Finding:
    """Compare the files that were listed."""
    wanted = f"{_paths(expected.files)} listed, asked by {expected.asked}"
    answers = [asked.files for asked in record.answers if asked.label == expected.asked]
    if not answers:
        return Finding("files", wanted, "not asked", False)
    holds = set(answers[0]) == set(expected.files)
    return Finding("files", wanted, _paths(answers[0]), holds)


def file_fetched(expected: FileFetched, record: Record) -> Finding:
    """Compare what came with what was aboard, octet for octet, and with the checksum told."""
    attempts = [each for each in record.fetched if each.path == expected.fetched]
    faults = [fault for each in attempts if (fault := _fault(each))]
    octets = [f"{len(each.came)} octets" for each in attempts if isinstance(each, Fetched)]
    return Finding(
        f"fetched {expected.fetched}",
        "octet for octet, of the checksum told",
        ", ".join([*octets, *faults]) or "never fetched",
        bool(attempts) and not faults,
    )


def _fault(attempt: Fetched | NotFetched) -> str:
    if isinstance(attempt, NotFetched):
        return attempt.why
    if attempt.came != attempt.aboard:
        return "other octets than aboard"
    came = crc32(attempt.came)
    return "" if came == attempt.checksum else f"CRC-32 {came:08x}, told {attempt.checksum:08x}"


def _kinds(kinds: Iterable[FileEventKind]) -> str:
    return " ".join(kind.name for kind in kinds) or "nothing told"


def _paths(paths: Iterable[str]) -> str:
    return ", ".join(sorted(paths)) or "no file"
