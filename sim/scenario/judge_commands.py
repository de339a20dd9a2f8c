"""Findings about the lives of commands, and about events."""

from collections import Counter
from collections.abc import Iterator, Sequence

from executive.reasons import Reason
from executive.reports import Kind, Report, Stage
from sim.scenario.expectations import Answer, CommandLife, Events, LinkTells
from sim.scenario.finding import Finding, joined
from sim.scenario.record import Record


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
        took_s = reports[-1].utc_s - reports[0].utc_s if ended else 0.0
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
