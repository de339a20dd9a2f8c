"""Messages to the console's pages on reports, alarms, plans, files and transfers."""

from dataclasses import dataclass
from enum import Enum, unique
from typing import ClassVar

from adapters.console.messages.telemetry import LinkKind, Scalar


@dataclass(frozen=True, slots=True)
class NotificationMessage:
    """A notification of an asset.

    Attributes:
        kind: COMMAND, EVENT or LINK.
        severity: INFORMATIONAL, WARNING, ALARM, SEVERE or CRITICAL.
        command: id of its command.
        cursor: number in the ledger of the other end; None if it is not recorded.
        fault: name of the fault that began, cleared, or ended the command.
    """

    ty: ClassVar[str] = "ntf"

    asset: str
    link: LinkKind
    sequence: int
    utc: float
    rx: float
    kind: str
    severity: str
    text: str
    command: str | None
    stage: str | None
    code: int | None
    step: int | None
    steps: int | None
    figures: dict[str, Scalar]
    cursor: int | None = None
    fault: str | None = None


@dataclass(frozen=True, slots=True)
class AlarmStatus:
    """An alarm (ISA-18.2). It is open until it is both cleared and acknowledged.

    Attributes:
        source: fault, report or limit that raises it; at most one alarm of a source is open.
        severity: severity of a notification.
        command: id of its command.
        raised, last: times of its first and last occurrence, by the onboard clock.
        occurrences: number of occurrences.
        cleared: time at which its cause ended, by the onboard clock; None while it is active.
        operator, acknowledged: operator and time of the acknowledgement, by the console's clock.
        shelved: time of the last shelving, or of its end by an operator.
        shelved_until: end of the time without a count; None if it is not shelved.
        shelved_by, comment: operator and reason of the shelving.
    """

    ty: ClassVar[str] = "alarm"

    id: int
    asset: str
    source: str
    severity: str
    text: str
    command: str | None
    raised: float
    last: float
    occurrences: int
    cleared: float | None
    operator: str | None
    acknowledged: float | None
    shelved: float | None = None
    shelved_until: float | None = None
    shelved_by: str | None = None
    comment: str | None = None

    @property
    def open(self) -> bool:
        """Whether it is active or unacknowledged."""
        return self.cleared is None or self.acknowledged is None


@dataclass(frozen=True, slots=True)
class PlanProgress:
    """Progress of a plan.

    Attributes:
        node: path of the leaf that started or ended last, or of the node that was skipped.
        done: number of leaves that have ended or were skipped: in a sequence the index of the
            present step, also while suspended.
        total: number of leaves.
    """

    ty: ClassVar[str] = "plan"

    asset: str
    plan: str
    status: str
    utc: float
    node: str | None
    done: int | None
    total: int | None
    text: str


@dataclass(frozen=True, slots=True)
class QuestionStatus:
    """A question of a plan to the operators, at its begin and at its end.

    Attributes:
        question: path of its node.
        options: the possible answers.
        default: answer at the deadline; None: the node fails then.
        until: the deadline by the onboard clock; None without one.
        end: how it ended; empty if that is not known, as after the end of its plan; None while it
            is open.
    """

    ty: ClassVar[str] = "question"

    asset: str
    plan: str
    question: str
    text: str
    options: tuple[str, ...]
    default: str | None
    until: float | None
    end: str | None = None


@dataclass(frozen=True, slots=True)
class FileChanged:
    """A file aboard has changed.

    Attributes:
        rx: reception time at the console.
        event: STORED, CHANGED, DELETED or TRANSFERRED.
    """

    ty: ClassVar[str] = "file"

    asset: str
    rx: float
    event: str
    path: str
    size: int
    modified: float
    mime: str | None


@unique
class TransferState(Enum):
    """State of a file transfer.

    Attributes:
        WAITING: queued behind other transfers.
        INTERRUPTED: no data is received; it resumes by itself.
        PAUSED: paused by an operator until resumed.
        REMOVED: removed from the list.
    """

    WAITING = "waiting"
    RUNNING = "running"
    INTERRUPTED = "interrupted"
    PAUSED = "paused"
    DONE = "done"
    FAILED = "failed"
    REMOVED = "removed"


@dataclass(frozen=True, slots=True)
class Transfer:
    """A file transfer from an asset to the console.

    Attributes:
        by: operator who requested it; empty for a page that displays the file.
        done, size: received octets, and size of the file; None until known.
        rate: recent rate, octets/s; None unless it runs.
        created: time of the request.
        utc: time of this state.
        detail: human-readable reason of the state.
    """

    ty: ClassVar[str] = "transfer"

    id: str
    asset: str
    path: str
    by: str
    state: TransferState
    created: float
    utc: float
    done: int = 0
    size: int | None = None
    rate: float | None = None
    detail: str = ""
