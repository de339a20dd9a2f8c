"""`entries`: the log of a rover, with the life cycle of each command and each event, filtered."""

from collections.abc import Iterator
from dataclasses import dataclass

from executive.commands import Mode
from executive.history import CommandHistory, RunHistory, Situation
from executive.values.reports import Identity, Report, ReportKind, Severity


@dataclass(frozen=True, slots=True)
class LogFilter:
    """Filter of a log; None and empty accept all.

    Attributes:
        command: the number of a command, of any source, or `SOURCE:NUMBER`.
        severity: minimum severity.
        since_utc_s, until_utc_s: onboard time, both inclusive.
        mode: mode of the rover; no entry matches if situations are unknown.
    """

    command: str | None = None
    source: str | None = None
    severity: Severity = Severity.INFORMATIONAL
    since_utc_s: float | None = None
    until_utc_s: float | None = None
    mode: Mode | None = None

    def matches(self, report: Report) -> bool:
        """Return whether a report passes the filter, apart from the mode."""
        identity = report.identity
        return (
            (
                self.command is None
                or (identity is not None and matches_command(self.command, identity))
            )
            and (self.source is None or (identity is not None and identity.source == self.source))
            and report.severity.value >= self.severity.value
            and (self.since_utc_s is None or report.utc_s >= self.since_utc_s)
            and (self.until_utc_s is None or report.utc_s <= self.until_utc_s)
        )


def matches_command(command: str, identity: Identity) -> bool:
    """Return whether a text is the number of a command, or its source and number."""
    return command in {str(identity), str(identity.command_id)}


Entry = CommandHistory | Report


def entries(history: RunHistory, wanted: LogFilter, unfold: bool = False) -> Iterator[Entry]:
    """Yield the commands and events that pass a filter, in the order of their start.

    A command passes if one of its reports does; with `unfold`, its reports are yielded instead.
    A report of the link is yielded by itself.
    """
    histories = history.command_histories()
    chosen = [
        each for each in history.reports if wanted.matches(each) and _in_mode(each, history, wanted)
    ]
    listed: set[Identity | int | Report] = set()
    for report in sorted(chosen, key=lambda each: each.sequence):
        identity = None if unfold or report.kind is ReportKind.LINK else report.identity
        entry = None if identity is None else histories.get(identity)
        key = (report.sequence or report) if entry is None else entry.identity
        if key not in listed:
            listed.add(key)
            yield report if entry is None else entry


def _in_mode(report: Report, history: RunHistory, wanted: LogFilter) -> bool:
    then = situation_at(history, report.utc_s)
    return wanted.mode is None or (then is not None and then.mode is wanted.mode)


def situation_at(history: RunHistory, utc_s: float) -> Situation | None:
    """Return the situation at a time; None before the first known one."""
    then = [each for each in history.situations if each.utc_s <= utc_s]
    return then[-1] if then else None
