"""Reports as rows of the ledger, and back."""

import json
from typing import Any

from executive.reasons import Figure, Reason
from executive.reports import Identity, Kind, Report, Severity, Stage


def row_of(report: Report) -> tuple[object, ...]:
    """Return a report as a row of the table `reports`."""
    identity = report.identity
    return (
        report.sequence,
        report.utc_s,
        report.kind.value,
        report.severity.value,
        report.text,
        identity.source if identity else None,
        identity.command_id if identity else None,
        report.stage.value if report.stage else None,
        report.link,
        report.step,
        report.step_count,
        report.reason.value if report.reason else None,
        json.dumps([[f.name, f.value, f.unit] for f in report.figures]),
    )


def report_of(row: tuple[Any, ...]) -> Report:
    """Return a row of the table `reports` as a report."""
    (
        sequence, utc_s, kind, severity, text, source, command_id,
        stage, link, step, step_count, reason, figures,
    ) = row  # fmt: skip
    return Report(
        sequence=sequence,
        utc_s=utc_s,
        kind=Kind(kind),
        severity=Severity(severity),
        text=text,
        identity=None if source is None else Identity(source, command_id),
        stage=None if stage is None else Stage(stage),
        link=link,
        step=step,
        step_count=step_count,
        reason=None if reason is None else Reason(reason),
        figures=tuple(Figure(*figure) for figure in json.loads(figures)),
    )
