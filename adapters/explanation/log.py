"""The log of a rover: the life of each command, and each event, by what is asked for."""

from collections.abc import Iterator
from dataclasses import dataclass

from executive.commands import Mode
from executive.history import CommandHistory, RunHistory, Situation
from executive.values.reports import Identity, Report, Severity


@dataclass(frozen=True, slots=True)
class LogFilter:
    """What of a log is wanted; None and empty for all.

    Attributes:
        command: the number of a command, of any source, or `SOURCE:NUMBER`.
        severity: the least.
        since_utc_s, until_utc_s: by the clock aboard, both included.
        mode: in which the rover was; nothing has a mode where situations are not known.
    """

    command: str | None = None
    source: str | None = None
    severity: Severity = Severity.INFORMATIONAL
    since_utc_s: float | None = None
    until_utc_s: float | None = None
    mode: Mode | None = None

    def has(self, report: Report) -> bool:
        """Whether a report is wanted, the mode apart."""
        identity = report.identity
        return (
            (self.command is None or (identity is not None and names(self.command, identity)))
            and (self.source is None or (identity is not None and identity.source == self.source))
            and report.severity.value >= self.severity.value
            and (self.since_utc_s is None or report.utc_s >= self.since_utc_s)
            and (self.until_utc_s is None or report.utc_s <= self.until_utc_s)
        )


def names(command: str, identity: Identity) -> bool:
    """Whether a text is the number of a command, or its source and number."""
    return command in {str(identity), str(identity.command_id)}


Entry = CommandHistory | Report


def entries(history: RunHistory, wanted: LogFilter, unfold: bool = False) -> Iterator[Entry]:
    """Yield the lives of commands and the events that are wanted, in the order of their beginning.

    A life is wanted if one of its reports is; unfolded, these are yielded in its place.
    """
    lives = history.lives()
    chosen = [
        each for each in history.reports if wanted.has(each) and _in_mode(each, history, wanted)
    ]
    listed: set[Identity | int | Report] = set()
    for report in sorted(chosen, key=lambda each: each.sequence):
        life = None if unfold or report.identity is None else lives.get(report.identity)
        key = (report.sequence or report) if life is None else life.identity
        if key not in listed:
            listed.add(key)
            yield report if life is None else life


def _in_mode(report: Report, history: RunHistory, wanted: LogFilter) -> bool:
    then = situation_at(history, report.utc_s)
    return wanted.mode is None or (then is not None and then.mode is wanted.mode)


def situation_at(history: RunHistory, utc_s: float) -> Situation | None:
    """Return what the rover was about at a time; None before the first that is known."""
    then = [each for each in history.situations if each.utc_s <= utc_s]
    return then[-1] if then else None
