"""The history of a run: what became of commands, the modes, the leaves that ran, what was reported.

A recording knows all of it; by the MRS the reports are known, and the state of the tree now. Times
are seconds since 1970-01-01 UTC, by the clock aboard.
"""

from dataclasses import dataclass
from typing import Final

from executive.commands import Mode, PreemptionPolicy
from executive.faults import DECLARED, Reaction
from executive.values.reasons import Reason, Refusal
from executive.values.reports import TERMINAL, Identity, Report, ReportKind, Stage

SLOWING: Final = frozenset(
    each.reason for each in DECLARED.values() if each.row.then is Reaction.SLOW_DOWN
)
"""Unless the settings of an asset say otherwise."""


@dataclass(frozen=True, slots=True)
class ReceivedCommand:
    """A command as it was received.

    Attributes:
        text: its name and arguments, for people.
        name: of the request, as in its declaration.
        utc_s: when it was looked at first.
        created_utc_s, lifetime_s: when it was made and how long it may wait, by its sender.
    """

    identity: Identity
    text: str
    name: str
    link: str
    utc_s: float
    arrival: PreemptionPolicy = PreemptionPolicy.APPEND
    created_utc_s: float | None = None
    lifetime_s: float | None = None


@dataclass(frozen=True, slots=True)
class CommandHistory:
    """What became of a command so far.

    Attributes:
        received: how it was received; None where that is not known.
        reports: of its stages, and what is predicted of its motion, in their order.
    """

    identity: Identity
    received: ReceivedCommand | None
    reports: tuple[Report, ...]

    @property
    def name(self) -> str:
        """The request with its arguments where they are known, else its name."""
        if self.received is not None:
            return self.received.text
        first = self.at(Stage.RECEIVED) or self.at(Stage.ACCEPTED)
        return "command" if first is None else first.text

    @property
    def request(self) -> str:
        """The name of the request alone."""
        return self.name.partition(" ")[0]

    @property
    def link(self) -> str | None:
        """The link by which it came; None where that is not known."""
        if self.received is not None:
            return self.received.link
        return next((each.link for each in self.reports if each.link is not None), None)

    @property
    def end(self) -> Report | None:
        """The report that ended it; None while it goes on."""
        return next((each for each in self.reports if each.stage in TERMINAL), None)

    @property
    def stages(self) -> tuple[Report, ...]:
        """The reports of its stages."""
        return tuple(each for each in self.reports if each.stage is not None)

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
        """When it was reported on first."""
        return self.reports[0].utc_s


@dataclass(frozen=True, slots=True)
class RejectedSubmission:
    """A command that was not taken under its number, so that it has no life of its own."""

    identity: Identity
    utc_s: float
    refusal: Refusal


@dataclass(frozen=True, slots=True)
class Situation:
    """What the rover was about from a time on.

    Attributes:
        why: one line on why the rover stood, or what moved it.
    """

    utc_s: float
    mode: Mode
    active: Identity | None
    why: str


@dataclass(frozen=True, slots=True)
class LeafRun:
    """A time for which a leaf of the tree ran.

    Attributes:
        path: of the leaf, names from the root joined by slashes.
        ended_utc_s: None while it runs.
        message: its last feedback message.
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
    """The greatest speeds, without sign, that the rover was commanded within a command.

    Attributes:
        allowed_mps: the greatest that the asset allows.
    """

    identity: Identity
    travel_mps: float
    allowed_mps: float


@dataclass(frozen=True, slots=True)
class RunHistory:
    """What is known of a run, or of a part of it.

    Attributes:
        until_utc_s: when it ends.
        received: commands in the order of their arrival.
        reports: in the order of their numbers.
        situations, leaves: in their order; empty where they are not known.
        slowing: the reasons of the faults for which the rover slows down.
        absences: from when to when no executive ran.
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

    def lives(self) -> dict[Identity, CommandHistory]:
        """Return the life of each command, in the order in which they were first reported on."""
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
