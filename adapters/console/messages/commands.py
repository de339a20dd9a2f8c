"""The life of commands, and who may send them."""

from dataclasses import dataclass, field
from enum import Enum, unique
from typing import Any, ClassVar, Final

from adapters.console.messages.telemetry import LinkKind, Scalar


@unique
class CommandState(Enum):
    """How far a command is known to be.

    Attributes:
        SENDING: it is on its way, and not answered.
        TAKEN: the other end of the link has it.
        GIVEN_UP: the relay gave it up; whether the rover got it is not known.
        UNKNOWN: nothing was heard of it in time, or not how it ended; the rover may have carried
            it out.
    """

    SENDING = "sending"
    TAKEN = "taken"
    RECEIVED = "received"
    ACCEPTED = "accepted"
    STARTED = "started"
    EXECUTED = "executed"
    REJECTED = "rejected"
    FAILED = "failed"
    CANCELLED = "cancelled"
    EXPIRED = "expired"
    GIVEN_UP = "given_up"
    UNKNOWN = "unknown"


ENDED: Final = frozenset(
    {
        CommandState.EXECUTED,
        CommandState.REJECTED,
        CommandState.FAILED,
        CommandState.CANCELLED,
        CommandState.EXPIRED,
    }
)
"""States that no other follows."""


@dataclass(frozen=True, slots=True)
class StageEntry:
    """A stage of a command's life.

    Attributes:
        stage: as the MRS spells it, SENT, TAKEN, FORWARDED, PREDICTED, GIVEN_UP or UNKNOWN.
        node: who says so: `console`, `orbiter` or the asset.
        utc: by the clock of who says so.
        rx: when it was heard here.
        code: the reason's number, of what is refused or failed.
        sequence: of the notification; None where there was none.
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
    """A command and its life so far; each message has all of it.

    Attributes:
        id: made by who posted it; ASSET:SOURCE:NUMBER of a stop, and of what came from elsewhere.
        name: of the request, as in the dictionary.
        args: as they were posted; None where they are not known here.
        by: the operator, or the source.
        source, number: what the asset knows it by.
        made: when it was posted.
        deadline: by then something is to be heard of it, else it is UNKNOWN; None once it was.
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
    made: float
    deadline: float | None
    history: tuple[StageEntry, ...]


@dataclass(frozen=True, slots=True)
class AuthorityMessage:
    """Who may command an asset.

    Attributes:
        holder: its name, as the asset knows it; None if nobody holds it.
        operator: for whom of the operators the holder has it; None where that is not known.
        needed: whether commands need it.
        lease_left: seconds, at `utc`, until it ends if its holder is silent.
        lease: seconds for which its holder may be silent.
        asked_by: who asked for it last, since it was granted.
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
    asked_by: str | None
