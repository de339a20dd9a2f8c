"""The log of a rover: the life of each command, and each event, by what is asked for."""

from collections.abc import Iterator
from dataclasses import dataclass

from adapters.explanation.chronicle import Asked, Chronicle
from executive.commands import Mode
from executive.reports import TERMINAL, Identity, Kind, Report, Severity, Stage


@dataclass(frozen=True, slots=True)
class CommandLife:
    """What became of a command so far.

    Attributes:
        asked: how it arrived; None where that is not known.
        reports: of its stages, and what is predicted of its motion, in their order.
    """

    identity: Identity
    asked: Asked | None
    reports: tuple[Report, ...]

    @property
    def name(self) -> str:
        """What was asked for, with its arguments where they are known."""
        if self.asked is not None:
            return self.asked.text
        first = self.at(Stage.RECEIVED) or self.at(Stage.ACCEPTED)
        return "command" if first is None else first.text

    @property
    def request(self) -> str:
        """The name of the request alone."""
        return self.name.partition(" ")[0]

    @property
    def link(self) -> str | None:
        """The link by which it came; None where that is not known."""
        if self.asked is not None:
            return self.asked.link
        return next((each.link for each in self.reports if each.link is not None), None)

    @property
    def end(self) -> Report | None:
        """The report that ended it; None while it goes on."""
        return next((each for each in self.reports if each.stage in TERMINAL), None)

    def at(self, stage: Stage) -> Report | None:
        """Return the first report of a stage; None if it has not come to that."""
        return next((each for each in self.reports if each.stage is stage), None)

    @property
    def outcome(self) -> str:
        """What its end says beside how it ended; empty where that is no more than its name."""
        end = self.end
        return "" if end is None or end.text == self.request else end.text

    @property
    def utc_s(self) -> float:
        """When it was first heard of."""
        return self.reports[0].utc_s


@dataclass(frozen=True, slots=True)
class Wanted:
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


def lives_of(chronicle: Chronicle) -> dict[Identity, CommandLife]:
    """Return the life of each command, in the order in which they were first heard of."""
    asked: dict[Identity, Asked] = {}
    for each in chronicle.asked:
        asked.setdefault(each.identity, each)
    reports: dict[Identity, dict[int, Report]] = {}
    for report in chronicle.reports:
        if report.identity is not None and report.kind is not Kind.LINK:
            reports.setdefault(report.identity, {}).setdefault(report.sequence, report)
    return {
        identity: CommandLife(identity, asked.get(identity), tuple(of.values()))
        for identity, of in reports.items()
        if any(each.stage is not None for each in of.values())
    }


Entry = CommandLife | Report


def entries(chronicle: Chronicle, wanted: Wanted, unfold: bool = False) -> Iterator[Entry]:
    """Yield the lives of commands and the events that are wanted, in the order of their beginning.

    A life is wanted if one of its reports is.

    Args:
        chronicle: of what time.
        wanted: what of it.
        unfold: whether to yield each report of a command apart.
    """
    lives = lives_of(chronicle)
    chosen = [
        each for each in chronicle.reports if wanted.has(each) and _in_mode(each, chronicle, wanted)
    ]
    listed: set[Identity | int | Report] = set()
    for report in sorted(chosen, key=lambda each: each.sequence):
        life = None if unfold or report.identity is None else lives.get(report.identity)
        key = (report.sequence or report) if life is None else life.identity
        if key not in listed:
            listed.add(key)
            yield report if life is None else life


def _in_mode(report: Report, chronicle: Chronicle, wanted: Wanted) -> bool:
    if wanted.mode is None:
        return True
    mode = None
    for each in chronicle.situations:
        if each.utc_s > report.utc_s:
            break
        mode = each.mode
    return mode is wanted.mode
