"""`PlanNodeReport`: progress of a node of a plan; `Question`: a plan's question to operators."""

from dataclasses import dataclass
from enum import Enum, unique
from typing import Final

from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import Identity

DECISIONS: Final = ("took ", "skipped", "ended", "answered ", "begins again")
"""Begins of the texts of decisions."""


@unique
class NodeStatus(Enum):
    """Status of a node's last tick; IDLE if that did not reach it (numbers as on the wire)."""

    IDLE = 1
    RUNNING = 2
    SUCCESS = 3
    FAILURE = 4


@dataclass(frozen=True, slots=True)
class Question:
    """A question to the operators.

    Attributes:
        key: path of its node.
        default: option at the deadline; None to fail then.
        until_utc_s: the deadline, seconds since 1970-01-01 UTC; None without one.
    """

    key: str
    text: str
    options: tuple[str, ...]
    default: str | None
    until_utc_s: float | None


@dataclass(frozen=True, slots=True)
class PlanNodeReport:
    """Progress of a node of a plan. Times are seconds since 1970-01-01 UTC.

    Attributes:
        path: unique path, names from the root joined by slashes.
        kind: name of its kind in the plan's text, as `Fallback`.
        line: line of the plan's text.
        status: its present status; IDLE before it begins, and after it was reset or halted.
        result: result of its last end; None before.
        since_utc_s: when it began, ended or was halted last; None before it began.
        tries: how often it began. A node that ends at once with its last result again, as a
            condition that is tested in each tick, counts once.
        reason: number of the last failure, if it was that of a command.
        text: why it failed last; empty if it did not.
        unknown: name of the telemetry or variable that it needs and that is not known; empty.
        decision: which branch it took last, and why; empty if it is none that chooses.
        next_utc_s: end of its wait, deadline or window; None without one.
        question: its question, while it is open.
        command: its last command.
    """

    path: str
    kind: str
    line: int
    status: NodeStatus = NodeStatus.IDLE
    result: NodeStatus | None = None
    since_utc_s: float | None = None
    tries: int = 0
    reason: Reason | UnknownReason | None = None
    text: str = ""
    unknown: str = ""
    decision: str = ""
    next_utc_s: float | None = None
    question: Question | None = None
    command: Identity | None = None
