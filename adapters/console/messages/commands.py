"""Messages to the console's pages on the life cycle of commands and on the authority."""

from dataclasses import dataclass, field
from enum import Enum, unique
from typing import Any, ClassVar, Final

from adapters.console.messages.telemetry import LinkKind, Scalar
from executive.values.reports import TERMINAL


@unique
class CommandState(Enum):
    """State of a command, as far as known.

    Attributes:
        SENDING: sent, not answered yet.
        ACKNOWLEDGED: acknowledged by the other end of the link.
        LOST: lost: the relay expects no report; the rover may have received it.
        UNKNOWN: no report in time, or none of its end; the rover may have executed it.
    """

    SENDING = "sending"
    ACKNOWLEDGED = "acknowledged"
    RECEIVED = "received"
    ACCEPTED = "accepted"
    STARTED = "started"
    EXECUTED = "executed"
    REJECTED = "rejected"
    FAILED = "failed"
    CANCELLED = "cancelled"
    EXPIRED = "expired"
    LOST = "lost"
    UNKNOWN = "unknown"


TERMINAL_STATES: Final = frozenset(CommandState[stage.name] for stage in TERMINAL)
"""Terminal states."""


@dataclass(frozen=True, slots=True)
class StageEntry:
    """A stage of a command's life cycle.

    Attributes:
        stage: stage of the MRS, or one of the console (`command_states`).
        node: reporting node: `console`, `orbiter` or the asset.
        utc: time by the clock of the node.
        rx: reception time at the console.
        code: number of the reason of a refusal or failure.
        sequence: number of the notification; None without one.
    """

    stage: str
    node: str
    utc: float
    rx: float
    detail: str
    code: int | None = None
    step: int | None = None
    steps: int | None = None
    sequence: int | None = None
    figures: dict[str, Scalar] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class CommandStatus:
    """A command with its complete life cycle so far.

    Attributes:
        id: created by the page; ASSET:SOURCE:NUMBER for stops and for commands of other clients.
        name: name of the request in the dictionary.
        args: posted arguments; None if unknown to this console.
        by: operator, or source.
        source, number: command id at the asset.
        created: time of posting.
        deadline: time of the first report, after which it is UNKNOWN; None once reported.
    """

    ty: ClassVar[str] = "cmd"

    id: str
    asset: str
    name: str
    args: dict[str, Any] | None
    by: str
    source: str
    number: int
    link: LinkKind
    state: CommandState
    ended: bool
    created: float
    deadline: float | None
    history: tuple[StageEntry, ...]


@unique
class StopState(Enum):
    """State of a stop that an operator pressed.

    Attributes:
        WAITING: without an answer of the asset; the console repeats it.
        EXPIRED: without an answer at its maximum age.
    """

    WAITING = "waiting"
    ANSWERED = "answered"
    REFUSED = "refused"
    CALLED_OFF = "called_off"
    EXPIRED = "expired"


@dataclass(frozen=True, slots=True)
class StopStatus:
    """The last stop that an operator pressed at this console.

    Attributes:
        command: id of its command.
        operator: its operator.
        pressed: time of the press.
        utc: start time of the state.
        detail: human-readable reason of the state.
    """

    ty: ClassVar[str] = "stop"

    asset: str
    command: str
    operator: str
    pressed: float
    utc: float
    state: StopState
    detail: str = ""


@dataclass(frozen=True, slots=True)
class AuthorityMessage:
    """The authority over an asset.

    Attributes:
        holder: source that holds it at the asset; None for no holder.
        operator: operator for whom the holder has it; None if unknown.
        needed: whether commands need it.
        lease_left: remaining lease at `utc`, s, without a renewal.
        lease: duration of the lease, s.
        requested_by: last operator or source that requested it since the grant.
    """

    ty: ClassVar[str] = "auth"

    asset: str
    link: LinkKind
    utc: float
    holder: str | None
    operator: str | None
    epoch: int
    needed: bool
    lease_left: float
    lease: float
    requested_by: str | None
