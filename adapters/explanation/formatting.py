"""Formats explanations, and the commands and reports of a log, as lines of text."""

from collections.abc import Callable

from adapters.explanation.explain import in_brackets
from adapters.explanation.explanation import Explanation
from adapters.explanation.log import Entry
from executive.history import CommandHistory
from executive.values.reasons import PREDICTED
from executive.values.reports import Report, ReportKind, Stage, printable

TimeFormatter = Callable[[float], str]
"""Formats an onboard time, seconds since 1970-01-01 UTC."""


def explanation_lines(explanation: Explanation, when: TimeFormatter) -> list[str]:
    """Return an explanation: the headline, then the steps, each with its time."""
    lines = [explanation.headline]
    if explanation.reason is not None:
        lines.append(f"  reason    {explanation.reason.name} {explanation.reason.value}")
    if explanation.evidence:
        lines.append(f"  evidence  {', '.join(map(str, explanation.evidence))}")
    width = max((len(when(each.utc_s)) for each in explanation.steps if each.utc_s), default=0)
    for each in explanation.steps:
        at = "" if each.utc_s is None else when(each.utc_s)
        lines.append(f"  {at:>{width}}  {each.text}")
    return [printable(each) for each in lines]


def entry_line(entry: Entry, when: TimeFormatter) -> str:
    """Return a command or a report on one line."""
    line = _command_line(entry, when) if isinstance(entry, CommandHistory) else _report(entry)
    return printable(f"{when(entry.utc_s)}  {line}")


def _command_line(entry: CommandHistory, when: TimeFormatter) -> str:
    link = "" if entry.link is None else f" ({entry.link})"
    stages = [
        f"{stage.name.lower()} {when(report.utc_s).strip()}"
        for stage in (Stage.ACCEPTED, Stage.STARTED)
        if (report := entry.report_at(stage)) is not None
    ]
    end = entry.end
    if end is None or end.stage is None:
        stages.append("active")
        return f"{entry.identity} {entry.name}{link}: {', '.join(stages)}"
    stages.append(f"{end.stage.name} {when(end.utc_s).strip()}")
    outcome = f": {entry.outcome}" if entry.outcome else ""
    reason = in_brackets(end.reason)
    return f"{entry.identity} {entry.name}{link}: {', '.join(stages)}{outcome}{reason}"


def _report(report: Report) -> str:
    word = report.severity.name if report.stage is None else report.stage.name
    unnamed = report.identity is None or report.kind is ReportKind.LINK  # its text has the name
    prefix = "" if unnamed else f"{report.identity} "
    step = "" if report.step is None else f"{report.step}/{report.step_count} "
    shown = [str(each) for each in report.figures if not each.name.startswith(PREDICTED)]
    figures = f" [{', '.join(shown)}]" if shown else ""
    return f"{prefix}{word} {step}{report.text}{in_brackets(report.reason)}{figures}"
