"""What happened: reports, alarms, plans, files and their transfers."""

from dataclasses import dataclass
from enum import Enum, unique
from typing import ClassVar

from adapters.console.messages.telemetry import LinkKind, Scalar


@dataclass(frozen=True, slots=True)
class Notified:
    """A notification of an asset.

    Attributes:
        kind: COMMAND, EVENT or LINK.
        severity: INFORMATIONAL, WARNING, ALARM, SEVERE or CRITICAL.
        command: the id of the command that it is of.
        cursor: its place in the order of recording at the other end; None if it is not recorded.
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


@dataclass(frozen=True, slots=True)
class AlarmStatus:
    """An alarm (ISA-18.2): it stands until it is both cleared and acknowledged.

    Attributes:
        source: what it is an alarm of; one of a source stands at a time.
        severity: as of a notification.
        command: the id of the command that it is of.
        raised, last: when it occurred first and last, by the clock aboard.
        occurrences: how often it occurred.
        cleared: when what it tells of was over, by the clock aboard; None while it is active.
        operator, acknowledged: who acknowledged it, and when, by the console's clock.
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

    @property
    def standing(self) -> bool:
        """Whether something is still to be done about it."""
        return self.cleared is None or self.acknowledged is None


@dataclass(frozen=True, slots=True)
class PlanProgress:
    """How far a plan has come.

    Attributes:
        node: the path of the leaf that began or ended last.
        done, total: leaves.
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
class FileChanged:
    """Something happened to a file aboard.

    Attributes:
        rx: when it was heard here.
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
    """How a transfer of a file is.

    Attributes:
        WAITING: others are under way.
        INTERRUPTED: nothing comes; it goes on where it stopped, by itself.
        PAUSED: an operator has it wait until an operator resumes it.
        REMOVED: it is not in the list any more.
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
    """A file on its way between an asset and the console.

    Attributes:
        by: the operator who asked for it; empty for a page that shows the file.
        done, size: octets that have come, and those of the whole; None until it is known.
        rate: octets a second, lately; None unless it runs.
        made: when it was asked for.
        utc: when this was so.
        detail: why it is so, for people.
    """

    ty: ClassVar[str] = "transfer"

    id: str
    asset: str
    path: str
    by: str
    state: TransferState
    made: float
    utc: float
    done: int = 0
    size: int | None = None
    rate: float | None = None
    detail: str = ""
