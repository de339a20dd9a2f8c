"""What the rover says: reports of command life cycles, of events aboard, and of plans."""

import re
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final

from executive.values.reasons import Figure, Reason

_FIGURES: Final = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def printable(text: str) -> str:
    """Return a text with everything escaped that is not printable, line ends included."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def without_figures(text: str) -> str:
    """Return the words of a text, so that two can be compared whose figures change all the time."""
    return _FIGURES.sub("", text)


@dataclass(frozen=True, slots=True)
class Identity:
    """Who asked, and under which number: the key under which a command is executed once."""

    source: str
    command_id: int

    def __str__(self) -> str:
        return f"{self.source}:{self.command_id}"


@unique
class Stage(Enum):
    """Where a command is in its life (thesis 5.1.2; numbers as on the MRS wire)."""

    RECEIVED = 1
    ACCEPTED = 2
    REJECTED = 3
    STARTED = 4
    PROGRESS = 5
    EXECUTED = 6
    FAILED = 7
    CANCELLED = 8
    EXPIRED = 9

    @property
    def terminal(self) -> bool:
        """Whether a command's life ends here."""
        return self in TERMINAL


TERMINAL = frozenset({Stage.REJECTED, Stage.EXECUTED, Stage.FAILED, Stage.CANCELLED, Stage.EXPIRED})


@unique
class Severity(Enum):
    """How much a report should worry the operator (numbers as on the MRS wire)."""

    INFORMATIONAL = 1
    WARNING = 2
    ALARM = 3
    SEVERE = 4
    CRITICAL = 5


@unique
class ReportKind(Enum):
    """What a report is about (numbers as on the MRS wire)."""

    COMMAND = 1
    EVENT = 2
    LINK = 3


@dataclass(frozen=True, slots=True)
class Report:
    """One fact that left the executive, numbered without gaps.

    Attributes:
        sequence: counts from 1, one more each, across restarts.
        utc_s: time aboard, seconds since 1970-01-01 UTC.
        identity: the command that it is of: if the kind is COMMAND, if a LINK is of one alone, and
            if an EVENT is the prediction of its motion.
        stage, link: set if and only if the kind is COMMAND.
        step, step_count: set on PROGRESS.
        reason: set on REJECTED, FAILED and CANCELLED, and on events that have one.
    """

    sequence: int
    utc_s: float
    kind: ReportKind
    severity: Severity
    text: str
    identity: Identity | None = None
    stage: Stage | None = None
    link: str | None = None
    step: int | None = None
    step_count: int | None = None
    reason: Reason | None = None
    figures: tuple[Figure, ...] = ()


@unique
class FileEventKind(Enum):
    """What happened to a file (numbers as on the MRS wire)."""

    STORED = 1
    CHANGED = 2
    DELETED = 3
    TRANSFERRED = 4


@dataclass(frozen=True, slots=True)
class FileEvent:
    """Something that happened to a file of the folder."""

    kind: FileEventKind
    path: str


@unique
class PlanStatus(Enum):
    """Where a plan is in its life (numbers as on the MRS wire)."""

    SUBMITTED = 1
    ACTIVATED = 2
    EXECUTING = 3
    SUSPENDED = 4
    COMPLETED = 5
    FAILED = 6
    ABORTED = 7

    @property
    def running(self) -> bool:
        """Whether the plan has the rover."""
        return self in {PlanStatus.ACTIVATED, PlanStatus.EXECUTING}


@dataclass(frozen=True, slots=True)
class PlanUpdate:
    """How far a plan has come.

    Attributes:
        node: path of the leaf that began or ended last; empty if none did.
        done: how many leaves have ended at least once.
        total: how many leaves there are.
    """

    plan_id: str
    status: PlanStatus
    utc_s: float
    node: str
    done: int
    total: int
    text: str
