"""Findings about the lives of commands, events, plans and files."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from zlib import crc32

from executive.reasons import Reason
from executive.reports import Kind, Report, Stage
from executive.state import FileEventKind
from sim.scenario.expectations import (
    Answer,
    CommandLife,
    Events,
    FileFetched,
    FileLife,
    FileList,
    LinkTells,
    PlanIs,
)
from sim.scenario.finding import NEVER, Finding, joined
from sim.scenario.record import ALMOST_S, Fetched, NotFetched, Record


def life(expected: CommandLife, record: Record) -> Finding:
    """Compare the life of a command."""
    reports = record.life(expected.command)
    found = joined(f"command {expected.command}", list(_aspects(expected, reports, record)))
    if found.holds or not reports:
        return found
    return Finding(found.subject, found.expected, f"{found.seen}: {reports[-1].text}", False)


def _aspects(expected: CommandLife, reports: list[Report], record: Record) -> Iterator[Finding]:
    if expected.answers is not None:
        answers = [sent.answer for sent in record.sendings if sent.label == expected.command]
        yield _aspect(_answers(expected.answers), _answers(answers))
    if expected.stages is not None:
        yield _aspect(_stages(expected.stages), _stages([report.stage for report in reports]))
    last = reports[-1] if reports else None
    if expected.ends is not None:
        ends = last.stage if last else None
        yield _aspect(f"ends {expected.ends.name}", f"ends {ends.name}" if ends else "no report")
    if expected.reason is not None:
        yield _aspect(_reason(expected.reason), _reason(last.reason if last else None))
    if expected.within_s is not None:
        ended = bool(last and last.stage and last.stage.terminal)
        took_s = record.time_of(reports[-1]) - record.time_of(reports[0]) if ended else 0.0
        yield Finding(
            "",
            f"within {expected.within_s:g} s",
            f"after {took_s:.2f} s" if ended else "no end",
            ended and took_s <= expected.within_s,
        )


def events(expected: Events, record: Record) -> Finding:
    """Count the events with a reason."""
    count = len(
        {
            report.sequence
            for report in record.reports
            if report.kind is Kind.EVENT and report.reason is expected.event
        }
    )
    return Finding(
        f"event {_reason(expected.event)}",
        f"{expected.count} ×",
        f"{count} ×",
        count == expected.count,
    )


def link_tells(expected: LinkTells, record: Record) -> Finding:
    """Count what the relay told of itself, with a severity."""
    told = [
        report.text
        for report in record.reports
        if report.kind is Kind.LINK and report.severity is expected.link
    ]
    return Finding(
        f"link {expected.link.name}",
        f"{expected.count} ×",
        "; ".join([f"{len(told)} ×", *told]),
        len(told) == expected.count,
    )


def commands_end_once(record: Record) -> Finding:
    """Hold every command that was received to one terminal report."""
    reports = {report.sequence: report for report in record.reports}.values()
    lives = {report.identity for report in reports if report.identity}
    ends = Counter(report.identity for report in reports if report.stage and report.stage.terminal)
    wrong = [f"{life} ends {ends[life]} ×" for life in lives if ends[life] != 1]
    return Finding(
        "promise",
        "every command received ends exactly once",
        ", ".join(sorted(wrong)) or f"{len(lives)} of {len(lives)} do",
        not wrong,
    )


def reports_without_gap(record: Record) -> Finding:
    """Hold the numbers of all reports to one more each."""
    numbers = sorted({r.sequence for r in record.reports if r.kind is not Kind.LINK})
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers)) if numbers else []
    return Finding(
        "promise",
        "reports are numbered without gaps",
        f"missing {', '.join(map(str, missing))}" if missing else f"{len(numbers)} reports",
        not missing,
    )


def _aspect(expected: str, seen: str) -> Finding:
    return Finding("", expected, seen, expected == seen)


def _answers(answers: Sequence[Answer]) -> str:
    return " ".join(answer.value for answer in answers) or "not sent"


def _stages(stages: Sequence[Stage | None]) -> str:
    return " ".join(stage.name for stage in stages if stage is not None) or "no report"


def _reason(reason: Reason | None) -> str:
    return f"{reason.value} {reason.name}" if reason else "no reason"


def plan(expected: PlanIs, record: Record) -> Finding:
    """Compare where a plan was in its life at a time."""
    subject, wanted = f"plan {expected.plan}", f"{expected.status.name} {expected.when}"
    time_s = record.moment(expected)
    if time_s is None:
        return Finding(subject, wanted, NEVER, False)
    told = [
        update
        for update in record.plans
        if update.plan_id == expected.plan
        and record.since_start_s(update.utc_s) <= time_s + ALMOST_S
    ]
    if not told:
        return Finding(subject, wanted, "nothing told", False)
    last = told[-1]
    seen = f"{last.status.name}, {last.done} of {last.total} leaves"
    return Finding(subject, wanted, seen, last.status is expected.status)


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
