"""`RunHistory`: commands and their results, modes, executed leaves and reports of a run.

A recording contains all of it; over the MRS only the reports and the present tree are known.
Times are seconds since 1970-01-01 UTC, by the onboard clock.
"""

from dataclasses import dataclass
from typing import Final

from executive.commands import Mode, PreemptionPolicy
from executive.faults import DECLARED, Reaction
from executive.values.reasons import Reason, Refusal
from executive.values.reports import TERMINAL, Identity, Report, ReportKind, Stage

SLOWING: Final = frozenset(
    each.reason for each in DECLARED.values() if each.row.reaction is Reaction.SLOW_DOWN
)
"""Reasons of the faults with the reaction SLOW_DOWN, unless an asset's settings differ."""
DISK_WAIT: Final = "waited for the disk"
"""Figure of a report that was sent late, because its commit waited for the disk, s."""


@dataclass(frozen=True, slots=True)
class ReceivedCommand:
    """A command as it was received.

    Attributes:
        text: human-readable name and arguments.
        name: name of the request, as in its declaration.
        utc_s: time of its first examination.
        created_utc_s, lifetime_s: creation time and lifetime, as given by its sender.
    """

    identity: Identity
    text: str
    name: str
    link: str
    utc_s: float
    preemption: PreemptionPolicy = PreemptionPolicy.APPEND
    created_utc_s: float | None = None
    lifetime_s: float | None = None


@dataclass(frozen=True, slots=True)
class CommandHistory:
    """The life cycle of a command up to now.

    Attributes:
        received: the command as received; None if unknown.
        reports: its stages and the predictions of its motion, in order.
    """

    identity: Identity
    received: ReceivedCommand | None
    reports: tuple[Report, ...]

    @property
    def name(self) -> str:
        """The request with its arguments if known, otherwise its name as reported."""
        if self.received is not None:
            return self.received.text
        first = self.report_at(Stage.RECEIVED) or self.report_at(Stage.ACCEPTED)
        return "command" if first is None else first.text

    @property
    def request(self) -> str:
        """The name of the request alone."""
        return self.name if self.received is None else self.received.name

    @property
    def link(self) -> str | None:
        """The link over which the command was received; None if unknown."""
        if self.received is not None:
            return self.received.link
        return next((each.link for each in self.reports if each.link is not None), None)

    @property
    def end(self) -> Report | None:
        """The report of its terminal stage; None before."""
        return next((each for each in self.reports if each.stage in TERMINAL), None)

    @property
    def stages(self) -> tuple[Report, ...]:
        """The reports of its stages."""
        return tuple(each for each in self.reports if each.stage is not None)

    def report_at(self, stage: Stage) -> Report | None:
        """Return the first report of a stage; None if it was not reached."""
        return next((each for each in self.reports if each.stage is stage), None)

    def disk_wait_s(self, stage: Stage) -> float:
        """Return how long the report of a stage, and a start after it, waited for the disk."""
        report = self.report_at(stage)
        figures = () if report is None else report.figures
        return next((each.value for each in figures if each.name == DISK_WAIT), 0.0)

    @property
    def outcome(self) -> str:
        """Text of the terminal report; empty if it is only the request's name."""
        end = self.end
        return "" if end is None or end.text == self.request else end.text

    @property
    def utc_s(self) -> float:
        """Time of the first report."""
        return self.reports[0].utc_s


@dataclass(frozen=True, slots=True)
class RejectedSubmission:
    """A submission that was rejected under its number, so that it has no life cycle."""

    identity: Identity
    utc_s: float
    refusal: Refusal


@dataclass(frozen=True, slots=True)
class Situation:
    """The state of the rover from a time on.

    Attributes:
        why: one line on the rover's motion and its reason.
        fault: name of the fault that holds the rover, if any.
        cause: the stop that holds the rover, if any.
    """

    utc_s: float
    mode: Mode
    active: Identity | None
    why: str
    fault: str | None = None
    cause: Identity | None = None


@dataclass(frozen=True, slots=True)
class LeafRun:
    """An interval during which a leaf ran, or a decision of a plan's node was in force.

    Attributes:
        path: path of the leaf, names from the root joined by slashes.
        ended_utc_s: end of the interval; None while it runs.
        message: its last feedback message; of a node of a plan its command or its decision.
    """

    path: str
    began_utc_s: float
    ended_utc_s: float | None
    message: str

    @property
    def name(self) -> str:
        """The name of the leaf."""
        return self.path.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class PeakSpeed:
    """The maximum speed, without sign, that was commanded during a command.

    Attributes:
        allowed_mps: the asset's maximum speed.
    """

    identity: Identity
    travel_mps: float
    allowed_mps: float


@dataclass(frozen=True, slots=True)
class RunHistory:
    """The history of a run, or of a part of it.

    Attributes:
        until_utc_s: end of the history.
        received: commands in order of arrival.
        reports: reports in order of their numbers.
        situations, leaves: in order of time; empty if unknown.
        slowing: reasons of the faults that slow the rover down.
        absences: intervals without a running executive.
    """

    until_utc_s: float
    reports: tuple[Report, ...]
    received: tuple[ReceivedCommand, ...] = ()
    declined: tuple[RejectedSubmission, ...] = ()
    situations: tuple[Situation, ...] = ()
    leaves: tuple[LeafRun, ...] = ()
    fastest: tuple[PeakSpeed, ...] = ()
    slowing: frozenset[Reason] = SLOWING
    absences: tuple[tuple[float, float], ...] = ()

    def command_histories(self) -> dict[Identity, CommandHistory]:
        """Return the life cycle of each command, in the order of their first reports."""
        received: dict[Identity, ReceivedCommand] = {}
        for each in self.received:
            received.setdefault(each.identity, each)
        reports: dict[Identity, dict[int, Report]] = {}
        for report in self.reports:
            if report.identity is not None and report.kind is not ReportKind.LINK:
                reports.setdefault(report.identity, {}).setdefault(report.sequence, report)
        return {
            identity: CommandHistory(identity, received.get(identity), tuple(of.values()))
            for identity, of in reports.items()
            if any(each.stage is not None for each in of.values())
        }
