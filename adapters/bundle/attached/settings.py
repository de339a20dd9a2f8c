"""Which agent carries the bundles of a node, as the settings files of its applications say it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from adapters.bundle.eid import Eid
from adapters.bundle.settings import Address, AnyLink, DaemonLink, LtpLink, TcpclLink, UdpLink


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
        """Raise ValueError unless there is one way to it."""
        if (self.socket is None) == (self.tcp is None):
            raise ValueError("a uD3TN daemon is reached by one of socket, tcp")

    @property
    def where(self) -> str:
        """Return where it is, for people."""
        tcp = self.tcp
        return str(self.socket) if tcp is None else f"{tcp.host}:{tcp.port}"


DaemonSettings = IonSettings | Aap2Settings
_KEYS: Final[Mapping[type[AnyLink], str]] = {LtpLink: "ltp", TcpclLink: "tcpcl", UdpLink: "udp"}


def daemon_of(
    agent: Agent, ion: IonSettings | None, aap2: Aap2Settings | None
) -> DaemonSettings | None:
    """Return the settings of the daemon that an agent is attached to; None for our own links.

    Raises:
        ValueError: there are settings of another, or none where they are needed.
    """
    others = {Agent.ION: ion, Agent.AAP2: aap2}
    chosen = others.pop(agent, None)
    if any(other is not None for other in others.values()):
        raise ValueError(f"the agent is {agent.value}, and there are settings of another")
    if agent is Agent.ION:
        return chosen or IonSettings()
    if agent is Agent.AAP2 and chosen is None:
        raise ValueError("the agent is aap2: say where, by aap2: {socket: PATH}")
    return chosen


def way_to(
    endpoint: Eid,
    links: Sequence[LtpLink | TcpclLink | UdpLink | None],
    daemon: DaemonSettings | None,
) -> AnyLink:
    """Return how a neighbour is reached: by the one link it has, or by the daemon and no link.

    Args:
        endpoint: where its application receives.
        links: those that may have been given.
        daemon: to which the agent is attached, if it is.

    Raises:
        ValueError: there are too many, or none.
    """
    given = [link for link in links if link is not None]
    if daemon is not None:
        if given:
            keys = ", ".join(_KEYS[type(link)] for link in given)
            raise ValueError(
                f"agent is a daemon, which reaches {endpoint}: remove {keys} beside eid {endpoint},"
                " and section listen"
            )
        return DaemonLink(endpoint, daemon.whole)
    if len(given) != 1:
        raise ValueError(f"{endpoint} is reached by one of ltp, tcpcl, udp")
    return given[0]
