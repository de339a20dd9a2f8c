"""What is heard of assets again and again: values, the behaviour tree, links, modes."""

from dataclasses import dataclass
from enum import Enum, unique
from typing import ClassVar

Scalar = float | int | str | bool | None


@unique
class LinkKind(Enum):
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
    link: LinkKind
    utc: float
    rx: float
    value: Scalar
    q: Quality


@dataclass(frozen=True, slots=True)
class SamplesDropped:
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
    link: LinkKind
    utc: float
    tick: int
    mode: str
    why: str
    active: str | None
    faults: tuple[str, ...]
    nodes: tuple[TreeNode, ...]


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
    link: LinkKind
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
    link: LinkKind
    utc: float
    mode: str
    active: str | None
    queued: int
    plan: str | None
