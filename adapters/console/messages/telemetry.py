"""Messages to the console's pages on the state of assets: values, behaviour tree, links, modes."""

from dataclasses import dataclass
from enum import Enum, unique
from typing import ClassVar

Scalar = float | int | str | bool | None


@unique
class LinkKind(Enum):
    """The link over which data of an asset is received, or commands are sent to it.

    Attributes:
        RECORDING: read from a recording; nothing can be sent.
        CONSOLE: measured by the console; nothing can be sent.
    """

    DIRECT = "direct"
    RELAY = "relay"
    RECORDING = "recording"
    CONSOLE = "console"


@unique
class Quality(Enum):
    """Quality of a telemetry value.

    Attributes:
        LATE: received after a newer value of this parameter and link.
        INVALID: unknown to the asset.
    """

    GOOD = "good"
    LATE = "late"
    INVALID = "invalid"


@unique
class LinkState(Enum):
    """State of a link.

    Attributes:
        SILENT: connected, but requests are not answered.
    """

    CONNECTING = "connecting"
    UP = "up"
    SILENT = "silent"
    DOWN = "down"


@dataclass(frozen=True, slots=True)
class Sample:
    """A value of a telemetry parameter.

    Attributes:
        utc: sample time aboard.
        rx: reception time at the console.
        value: None for an invalid value; `encode` writes a value that is not finite as text.
    """

    ty: ClassVar[str] = "tm"

    asset: str
    key: str
    link: LinkKind
    utc: float
    rx: float
    value: Scalar
    q: Quality


@dataclass(frozen=True, slots=True)
class SamplesDropped:
    """Number of telemetry values that were dropped for this slow page."""

    ty: ClassVar[str] = "gap"

    dropped: int


@dataclass(frozen=True, slots=True)
class TreeNode:
    """A node of a behaviour tree.

    Attributes:
        path: names from the root, joined by slashes.
        kind: value of `NodeKind`.
        status: status of its last tick; that of a guard that does not hold is `declined`, no
            `failure`.
        message: its status message.
        command: SOURCE:NUMBER of the command that it executes or executed last; None for none.
    """

    path: str
    name: str
    depth: int
    kind: str
    status: str
    message: str
    command: str | None


@dataclass(frozen=True, slots=True)
class TreeFault:
    """A fault that has not cleared, with its evidence as a text."""

    name: str
    severity: str
    text: str


@dataclass(frozen=True, slots=True)
class TreeState:
    """The complete behaviour tree of an asset. A new message replaces the previous one.

    Attributes:
        why: cause of motion or standstill, in one line.
        active: active command, as SOURCE:NUMBER.
        faults: the faults that have not cleared.
        nodes: nodes in depth-first order.
    """

    ty: ClassVar[str] = "tree"

    asset: str
    link: LinkKind
    utc: float
    tick: int
    mode: str
    why: str
    active: str | None
    faults: tuple[TreeFault, ...]
    nodes: tuple[TreeNode, ...]


@dataclass(frozen=True, slots=True)
class PosePrediction:
    """Where a command that is sent now over a delayed link finds an asset.

    Attributes:
        utc: present time.
        as_of: time aboard of the last reported pose.
        arrival: arrival time of the command.
        heading: rad.
        within: deviation of the position at 2 sigma, m.
        path: path from the reported pose to the predicted one; the asset is on it in any case.
    """

    ty: ClassVar[str] = "prediction"

    asset: str
    link: LinkKind
    utc: float
    as_of: float
    arrival: float
    x: float
    y: float
    heading: float
    within: float
    path: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """Status of a link to an asset.

    Attributes:
        since: start time of the state.
        last_received: last reception time; None for never.
        detail: human-readable reason.
        round_trip: declared round-trip time, s; 0 without a declaration.
        preconditions: whether commands over it can have preconditions.
    """

    ty: ClassVar[str] = "link"

    asset: str
    link: LinkKind
    uri: str
    state: LinkState
    since: float
    last_received: float | None
    detail: str
    round_trip: float = 0.0
    preconditions: bool = False


@dataclass(frozen=True, slots=True)
class AssetState:
    """Mode and work of an asset.

    Attributes:
        mode: mode of the MRS.
        active: number of the active command, as the asset reports it.
        queued: number of queued commands.
        plan: active plan.
    """

    ty: ClassVar[str] = "asset"

    asset: str
    link: LinkKind
    utc: float
    mode: str
    active: str | None
    queued: int
    plan: str | None
