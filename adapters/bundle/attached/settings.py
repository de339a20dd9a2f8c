"""Which agent carries the bundles of a node, as the settings files of its applications say it."""

from dataclasses import dataclass
from enum import Enum

from adapters.bundle.figures import require_within
from adapters.bundle.settings import DAY_S, Address


class Agent(Enum):
    """The three ways behind the port: our own links, NASA ION, or a uD3TN daemon by AAP 2.0."""

    EMBEDDED = "embedded"
    ION = "ion"
    AAP2 = "aap2"


@dataclass(frozen=True, slots=True)
class IonSettings:
    """NASA ION on this machine, through pyion.

    Attributes:
        python: the interpreter that has pyion; None for the one that runs this.
        node_list: ION_NODE_LIST_DIR, where several nodes share the machine; None for what the
            environment says.
        whole: see `DaemonLink`.
        answer_s: a bridge or an ION that is silent for so long counts as hanging.
        look_s: how often ION is asked whether it answers.
    """

    python: str | None = None
    node_list: str | None = None
    whole: bool = False
    answer_s: float = 30.0
    look_s: float = 15.0

    def __post_init__(self) -> None:
        """Raise ValueError where a figure makes no sense."""
        require_within(self, answer_s=(0.1, DAY_S), look_s=(0.05, DAY_S))


@dataclass(frozen=True, slots=True)
class Aap2Settings:
    """A uD3TN daemon on this machine, or one that this machine trusts.

    Attributes:
        socket: the path of its AAP 2.0 socket, or
        tcp: where it listens.
        secret: for the endpoint, if it was registered with one; None makes one up.
        whole: see `DaemonLink`.
        keepalive_s: how often both sides say that they are there; silence for twice as long ends
            the connection.
        answer_s: how long the daemon may take to answer.
    """

    socket: str | None = None
    tcp: Address | None = None
    secret: str | None = None
    whole: bool = False
    keepalive_s: int = 15
    answer_s: float = 30.0

    def __post_init__(self) -> None:
        """Raise ValueError unless there is one way to it, or where a figure makes no sense."""
        if (self.socket is None) == (self.tcp is None):
            raise ValueError("a uD3TN daemon is reached by one of socket, tcp")
        require_within(self, keepalive_s=(1, 65_535), answer_s=(0.1, DAY_S))

    @property
    def where(self) -> str:
        """Return where it is, for people."""
        tcp = self.tcp
        return str(self.socket) if tcp is None else f"{tcp.host}:{tcp.port}"


DaemonSettings = IonSettings | Aap2Settings
