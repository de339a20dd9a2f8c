"""What the console's server and its pages say to each other, as values; `encode` writes them.

Times are seconds since 1970-01-01 UTC; figures are in SI units and radians.
"""

import json
from dataclasses import dataclass, field, fields
from enum import Enum, unique
from math import isfinite
from typing import Any, ClassVar, Final

PROTOCOL: Final = 1
"""Of the messages; a page that knows another asks its operator to load it again."""

Scalar = float | int | str | bool | None


@unique
class Link(Enum):
    """The way by which something was heard of an asset, or is sent to it.

    Attributes:
        RECORDING: it was read in a recording; nothing is sent by it.
        CONSOLE: the console has measured it; nothing is sent by it.
    """

    DIRECT = "direct"
    RELAY = "relay"
    RECORDING = "recording"
    CONSOLE = "console"


@unique
class Quality(Enum):
    """What is to be known of a telemetry value.

    Attributes:
        LATE: a newer one of this parameter and link was heard before.
        INVALID: the asset says that it is not known.
    """

    GOOD = "good"
    LATE = "late"
    INVALID = "invalid"


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


@unique
class LinkState(Enum):
    """Whether an asset can be reached by a link.

    Attributes:
        SILENT: connected, but it does not answer.
    """

    CONNECTING = "connecting"
    UP = "up"
    SILENT = "silent"
    DOWN = "down"


@dataclass(frozen=True, slots=True)
class Hello:
    """The first message to a page.

    Attributes:
        instance: of the server's process; numbers of messages start anew with each.
        seq: the number of the last message that was sent to all.
        resumed: whether all that the page missed since the number it named follows.
        operator: under which name this page commands.
    """

    ty: ClassVar[str] = "hello"

    protocol: int
    instance: str
    seq: int
    utc: float
    operator: str
    resumed: bool


@dataclass(frozen=True, slots=True)
class Sample:
    """A value of a telemetry parameter.

    Attributes:
        utc: when it was sampled aboard.
        rx: when it was heard here.
        value: None when nothing valid is known; what is not finite is written as a text.
    """

    ty: ClassVar[str] = "tm"

    asset: str
    key: str
    link: Link
    utc: float
    rx: float
    value: Scalar
    q: Quality


@dataclass(frozen=True, slots=True)
class Gap:
    """So many telemetry values were not sent to this page, which is too slow."""

    ty: ClassVar[str] = "gap"

    dropped: int


@dataclass(frozen=True, slots=True)
class TreeNode:
    """A node of a behaviour tree.

    Attributes:
        path: names from the root, joined by slashes.
        kind: as `NodeKind` of the trees has it.
        look: as `Look` has it, small: a guard that does not hold is `declined`, no `failure`.
        message: what it says of itself.
        command: the one that it works on, or worked on last, as SOURCE:NUMBER; None where there is
            none.
    """

    path: str
    name: str
    depth: int
    kind: str
    look: str
    message: str
    command: str | None


@dataclass(frozen=True, slots=True)
class TreeState:
    """The behaviour tree of an asset: each message has all of it, and only the last one counts.

    Attributes:
        why: why it stands, or what moves it: one line.
        active: the command under way, as SOURCE:NUMBER.
        faults: a line for each that is not over.
        nodes: depth first.
    """

    ty: ClassVar[str] = "tree"

    asset: str
    link: Link
    utc: float
    tick: int
    mode: str
    why: str
    active: str | None
    faults: tuple[str, ...]
    nodes: tuple[TreeNode, ...]


@dataclass(frozen=True, slots=True)
class StageReached:
    """A stage of a command's life.

    Attributes:
        stage: as the MRS spells it, SENT, TAKEN, PREDICTED, GIVEN_UP or UNKNOWN.
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
    link: Link
    state: CommandState
    ended: bool
    made: float
    deadline: float | None
    history: tuple[StageReached, ...]


@dataclass(frozen=True, slots=True)
class AuthorityHeld:
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
    link: Link
    utc: float
    holder: str | None
    operator: str | None
    epoch: int
    needed: bool
    lease_left: float
    lease: float
    asked_by: str | None


@dataclass(frozen=True, slots=True)
class Notified:
    """A notification of an asset.

    Attributes:
        kind: COMMAND, EVENT or LINK.
        severity: INFORMATIONAL, WARNING, ALARM, SEVERE or CRITICAL.
        command: the id of the command that it is of.
    """

    ty: ClassVar[str] = "ntf"

    asset: str
    link: Link
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
class LinkStatus:
    """How a link to an asset is.

    Attributes:
        since: when it came to be so.
        heard: when something was last heard by it; None for never.
        detail: why, for people.
    """

    ty: ClassVar[str] = "link"

    asset: str
    link: Link
    uri: str
    state: LinkState
    since: float
    heard: float | None
    detail: str


@dataclass(frozen=True, slots=True)
class AssetState:
    """What an asset is about.

    Attributes:
        mode: as the MRS spells it.
        active: the number of the command under way, as the asset tells it.
        queued: commands that wait.
        plan: the plan that has the rover.
    """

    ty: ClassVar[str] = "asset"

    asset: str
    link: Link
    utc: float
    mode: str
    active: str | None
    queued: int
    plan: str | None


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


@dataclass(frozen=True, slots=True)
class Present:
    """A page that is open."""

    console: str
    operator: str
    since: float


@dataclass(frozen=True, slots=True)
class Presence:
    """Which pages are open."""

    ty: ClassVar[str] = "presence"

    consoles: tuple[Present, ...]


@dataclass(frozen=True, slots=True)
class DictionaryChanged:
    """The dictionary has something new of an asset: ask for it again."""

    ty: ClassVar[str] = "dictionary"

    asset: str


@dataclass(frozen=True, slots=True)
class ObjectChanged:
    """An operators' object has a new revision; None, it was deleted."""

    ty: ClassVar[str] = "obj"

    key: str
    revision: int | None


Broadcast = (
    CommandStatus
    | AuthorityHeld
    | Notified
    | AlarmStatus
    | LinkStatus
    | AssetState
    | PlanProgress
    | FileChanged
    | Presence
    | DictionaryChanged
    | ObjectChanged
)
"""What is numbered, never dropped, and sent again to a page that comes back."""

Latest = TreeState | Transfer
"""What is told whole at each change, so that only the last one of a topic counts."""

Message = Hello | Sample | Latest | Gap | Broadcast


def topic_of(message: Message) -> str:
    """Return what a page subscribes to for a message: its type and asset, and which of these."""
    match message:
        case Sample(asset=asset, key=key):
            return f"{message.ty}:{asset}:{key}"
        case Transfer(asset=asset, id=name):
            return f"{message.ty}:{asset}:{name}"
        case Hello() | Gap() | Presence() | ObjectChanged():
            return message.ty
        case _:
            return f"{message.ty}:{message.asset}"


def is_wanted(topic: str, topics: frozenset[str]) -> bool:
    """Whether a topic, or a beginning of it that ends in `*`, is among those subscribed to.

    `cmd` stands for all topics of that type, as `cmd:*` does.
    """
    return topic in topics or any(
        topic.startswith(each[:-1]) if each.endswith("*") else topic.startswith(f"{each}:")
        for each in topics
    )


def plain(value: Any) -> Any:
    """Return a value, or a dataclass of values, as plain data for JSON, fields under their names.

    What is not finite becomes "NaN", "Infinity" or "-Infinity", which `Number()` reads.
    """
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return value if isfinite(value) else _NOT_FINITE.get(value, "NaN")
        case Enum():
            return value.value
        case dict():
            return {key: plain(each) for key, each in value.items()}
        case tuple() | list():
            return [plain(each) for each in value]
        case _:
            return {name: plain(getattr(value, name)) for name in _names(type(value))}


def encode(message: Message, seq: int | None = None) -> str:
    """Return a message as JSON, with its number if it has one."""
    numbered = {} if seq is None else {"seq": seq}
    return json.dumps({"ty": message.ty, **numbered, **plain(message)}, separators=(",", ":"))


def decode_command(body: dict[str, Any]) -> CommandStatus:
    """Return a command of what `encode` wrote."""
    given = {name: body[name] for name in _names(CommandStatus)}
    history = tuple(StageReached(**reached) for reached in body["history"])
    given |= {
        "link": Link(body["link"]),
        "state": CommandState(body["state"]),
        "history": history,
    }
    return CommandStatus(**given)


def decode_transfer(body: dict[str, Any]) -> Transfer:
    """Return a transfer of what `plain` made."""
    given = {name: body[name] for name in _names(Transfer)}
    return Transfer(**given | {"state": TransferState(body["state"])})


_NOT_FINITE: Final = {float("inf"): "Infinity", float("-inf"): "-Infinity"}


def _names(kind: Any) -> tuple[str, ...]:
    if kind not in _NAMES:
        _NAMES[kind] = tuple(each.name for each in fields(kind))
    return _NAMES[kind]


_NAMES: Final[dict[Any, tuple[str, ...]]] = {}
