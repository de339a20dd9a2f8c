"""Reports of command life cycles, of onboard events, and of plans."""

import re
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final

from executive.values.reasons import Figure, Reason, UnknownReason
from executive.values.reasons import Identity as Identity

_FIGURES: Final = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def printable(text: str) -> str:
    """Escape all characters of a text that are not printable, line ends included."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def without_figures(text: str) -> str:
    """Return a text without its numbers, to compare texts that differ only in figures."""
    return _FIGURES.sub("", text)


@unique
class Stage(Enum):
    """Stage of a command's life cycle (thesis 5.1.2; numbers as on the MRS wire)."""

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
        """Whether the life cycle ends at this stage."""
        return self in TERMINAL


TERMINAL = frozenset({Stage.REJECTED, Stage.EXECUTED, Stage.FAILED, Stage.CANCELLED, Stage.EXPIRED})


@unique
class Severity(Enum):
    """Severity of a report for the operator (numbers as on the MRS wire)."""

    INFORMATIONAL = 1
    WARNING = 2
    ALARM = 3
    SEVERE = 4
    CRITICAL = 5


@unique
class ReportKind(Enum):
    """Subject of a report (numbers as on the MRS wire)."""

    COMMAND = 1
    EVENT = 2
    LINK = 3


@dataclass(frozen=True, slots=True)
class Report:
    """One report of the executive; reports are numbered without gaps.

    Attributes:
        sequence: counts from 1 in steps of 1, across restarts.
        utc_s: onboard time, seconds since 1970-01-01 UTC.
        identity: the reported command: for kind COMMAND, for a LINK that concerns one command,
            and for an EVENT that predicts its motion.
        stage, link: set if and only if the kind is COMMAND.
        step, step_count: set on PROGRESS.
        reason: set on REJECTED, FAILED and CANCELLED, and on events that have one.
        fault: name of the fault that begins, that is cleared (reason FAULT_CLEARED), that made the
            pose uncertain (reason POSE_UNCERTAIN), or that ended the command.
        cause: the other command that ended this one.
        publishers: names of all other velocity publishers, set when they change.
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
    reason: Reason | UnknownReason | None = None
    figures: tuple[Figure, ...] = ()
    fault: str | None = None
    cause: Identity | None = None
    publishers: tuple[str, ...] | None = None


@unique
class FileEventKind(Enum):
    """Kind of a file event (numbers as on the MRS wire)."""

    STORED = 1
    CHANGED = 2
    DELETED = 3
    TRANSFERRED = 4


@dataclass(frozen=True, slots=True)
class FileEvent:
    """An event of one file in the monitored folder."""

    kind: FileEventKind
    path: str


@unique
class PlanStatus(Enum):
    """Status of a plan's life cycle (numbers as on the MRS wire)."""

    SUBMITTED = 1
    ACTIVATED = 2
    EXECUTING = 3
    SUSPENDED = 4
    COMPLETED = 5
    FAILED = 6
    ABORTED = 7

    @property
    def running(self) -> bool:
        """Whether the plan controls the rover."""
        return self in {PlanStatus.ACTIVATED, PlanStatus.EXECUTING}


@dataclass(frozen=True, slots=True)
class PlanUpdate:
    """Progress of a plan.

    Attributes:
        node: path of the last leaf that started or ended; empty if none did.
        done: number of leaves that have ended at least once or were skipped.
        total: number of leaves.
    """

    plan_id: str
    status: PlanStatus
    utc_s: float
    node: str
    done: int
    total: int
    text: str
