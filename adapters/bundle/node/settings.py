"""How an agent is set up: its EIDs, neighbours and limits, and what a settings file says of it."""

import os
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Final, assert_never

from adapters.bundle.codec.eid import Eid, Ipn, is_null, node_of, parse_eid
from adapters.bundle.node.database import StoreLimits
from adapters.bundle.node.security import SecuritySettings

DAY_S: Final = 86_400.0
LONGEST_LIFETIME_S: Final = 1e10
"""Three hundred years; no longer lifetime can be allowed."""
HIGHEST_PORT: Final = 65535
_DATAGRAM_OCTETS: Final = 65_507
_LEAST_BUNDLE_OCTETS: Final = 512
"""Room for a fragment with two long EIDs and a hundred octets of its payload."""
_CONFIRM_AFTER_S: Final = (0.1, 1e7)


def check_ranges(settings: object, **bounds: tuple[float, float]) -> None:
    """Raise ValueError unless fields of a settings dataclass are None or within their bounds."""
    for name, (least, most) in bounds.items():
        figure = getattr(settings, name)
        if figure is not None and not least <= figure <= most:
            raise ValueError(f"{name} must be {least:,} to {most:,}, not {figure}")


@dataclass(frozen=True, slots=True)
class Address:
    """Where something listens."""

    host: str
    port: int

    def __post_init__(self) -> None:
        try:
            fits = b"\0" not in self.host.encode("idna")
        except UnicodeError:
            fits = False
        if not fits:
            parts = "each of its parts between dots has 1 to 63 characters"
            raise ValueError(f"host {self.host!r} is no name of a host: {parts}")
        if not 0 <= self.port <= HIGHEST_PORT:
            raise ValueError(f"{self.port} is not a port of 0 to {HIGHEST_PORT}")


@dataclass(frozen=True, slots=True)
class Listen:
    """Where an agent listens for each protocol; None for not at all.

    LTP and UDP send from where they listen, so that their neighbours need an address here.
    """

    ltp: Address | None = None
    tcpcl: Address | None = None
    udp: Address | None = None


NO_ADDRESSES: Final = Listen()


@dataclass(frozen=True, slots=True)
class LtpLink:
    """A neighbour over LTP on UDP, reliable by itself.

    Attributes:
        address: where its LTP engine listens. Its engine number is its node number.
        via: the node of the router whose engine that is, such as ipn:9.0; None for its own.
        block_octets: how many octets of bundles go in one block, at most.
        bundle_octets: what is longer is fragmented.
        sessions: how many blocks may be on their way at once.
        answer_s: what the other side may take to answer, beside the light time of the plan.
        confirm_after_s: when what should have been confirmed is first sent again; the pause
            doubles each time, up to 32 times that.
    """

    address: Address
    via: str | None = None
    segment_octets: int = 1300
    block_octets: int = 24_000
    bundle_octets: int = 256_000
    sessions: int = 8
    answer_s: float = 0.5
    confirm_after_s: float = 60.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            segment_octets=(10, 65_000),  # in a datagram, with its header
            block_octets=(1, 16 << 20),
            bundle_octets=(_LEAST_BUNDLE_OCTETS, 16 << 20),
            sessions=(1, 256),
            answer_s=(0.01, DAY_S),
            confirm_after_s=_CONFIRM_AFTER_S,
        )
        if self.via is not None:
            engine_of(parse_eid(self.via))


@dataclass(frozen=True, slots=True)
class TcpclLink:
    """A neighbour over TCPCL version 3.

    Attributes:
        address: where it listens; None waits for it to dial in.
        acknowledge: whether bundles are acknowledged. NASA ION 4.1 hangs or ends where they are
            and a session breaks: False with it, and let what is sent be confirmed. Both sides have
            to say the same.
        keepalive_s: how long the session may be silent; 0 for any time.
        window_octets: how much may be on its way unacknowledged.
        redial_s: the shortest pause before dialling again; it doubles up to 30 s.
        confirm_after_s: see `LtpLink`.
    """

    address: Address | None
    acknowledge: bool = True
    keepalive_s: int = 15
    segment_octets: int = 65_536
    window_octets: int = 262_144
    redial_s: float = 1.0
    confirm_after_s: float = 10.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            keepalive_s=(0, 65_535),
            segment_octets=(1, 64 << 20),
            window_octets=(1, 1 << 30),
            redial_s=(0.01, 3600.0),
            confirm_after_s=_CONFIRM_AFTER_S,
        )


@dataclass(frozen=True, slots=True)
class UdpLink:
    """A neighbour over plain UDP, a bundle in each datagram: what the link loses is lost.

    Attributes:
        bundle_octets: what is longer is fragmented.
        rate_octets_s: how much is sent.
        confirm_after_s: see `LtpLink`.
    """

    address: Address
    bundle_octets: int = 1400
    rate_octets_s: int = 1_000_000
    confirm_after_s: float = 10.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            bundle_octets=(_LEAST_BUNDLE_OCTETS, _DATAGRAM_OCTETS),
            rate_octets_s=(1, 1 << 40),
            confirm_after_s=_CONFIRM_AFTER_S,
        )


@dataclass(frozen=True, slots=True)
class DaemonLink:
    """A neighbour that is reached by the daemon to which this agent is attached.

    Attributes:
        endpoint: where the application beyond receives.
        whole: whether the daemon carries whole bundles of ours, as its payload, so that they keep
            their identity and can be confirmed. Both ends have to be attached, and say so.
        confirm_after_s: see `LtpLink`.
    """

    endpoint: Eid
    whole: bool = False
    confirm_after_s: float = 60.0

    def __post_init__(self) -> None:
        check_ranges(self, confirm_after_s=_CONFIRM_AFTER_S)


AnyLink = LtpLink | TcpclLink | UdpLink | DaemonLink


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A node that is reached directly.

    Attributes:
        node: its node EID, such as ipn:1.0.
        link: how it is reached.
        reaches: nodes beyond it, by their node EIDs.
        default: whether it takes what is for all other nodes.
    """

    node: Eid
    link: AnyLink
    reaches: tuple[Eid, ...] = ()
    default: bool = False

    @property
    def name(self) -> str:
        """What it is called in the store and in logs."""
        return str(self.node)

    @property
    def next_hop(self) -> Eid:
        """The node that the link leads to, and the contact plan speaks of: a router, or itself."""
        if isinstance(self.link, LtpLink) and self.link.via is not None:
            return node_of(parse_eid(self.link.via))
        return self.node


@dataclass(frozen=True, slots=True)
class NodeSettings:
    """The settings of an agent.

    Attributes:
        sender: the EID of what is sent.
        receivers: the EIDs at which it receives.
        neighbours: whom it reaches directly.
        lifetime_s: how long a bundle is wanted where nothing else is said.
        hop_limit: how often a bundle may be forwarded; None puts no hop count into it.
        most_payload_octets: the longest application data unit that is reassembled.
        most_lifetime_s: the longest lifetime that is given or taken.
        most_ahead_s: how far ahead of the clock here a bundle may have been made.
        limits: how much the store may take.

    Raises:
        ValueError: the EIDs or a figure make no sense.
    """

    sender: Eid
    receivers: tuple[Eid, ...]
    neighbours: tuple[Neighbour, ...]
    lifetime_s: float = 7 * DAY_S
    hop_limit: int | None = None
    most_payload_octets: int = 16 << 20
    most_lifetime_s: float = 60 * DAY_S
    most_ahead_s: float = DAY_S
    limits: StoreLimits = field(default_factory=StoreLimits)

    def __post_init__(self) -> None:
        check_ranges(
            self,
            most_lifetime_s=(0.001, LONGEST_LIFETIME_S),
            lifetime_s=(0.001, self.most_lifetime_s),
            most_ahead_s=(0.0, LONGEST_LIFETIME_S),
            hop_limit=(1, 255),
            most_payload_octets=(1, 1 << 30),
        )
        for eid in (self.sender, *self.receivers):
            if is_null(eid) or node_of(eid) != self.node:
                raise ValueError(f"{eid} is no endpoint of {self.node}")
        for neighbour in self.neighbours:
            if is_null(neighbour.node) or neighbour.node != node_of(neighbour.node):
                raise ValueError(f"{neighbour.node} is no node, such as ipn:1.0")
            if neighbour.node == self.node:
                raise ValueError(f"{neighbour.node} is its own neighbour")
            if isinstance(neighbour.link, LtpLink):
                engine_of(neighbour.next_hop)
        if any(isinstance(neighbour.link, LtpLink) for neighbour in self.neighbours):
            engine_of(self.node)

    @property
    def node(self) -> Eid:
        """The EID of the node itself, where reports are sent from and to."""
        return node_of(self.sender)

    def link_to(self, neighbour: str) -> AnyLink:
        """Return the link of a neighbour by its name; raises KeyError if there is none."""
        return {other.name: other.link for other in self.neighbours}[neighbour]

    def confirms(self, neighbour: str) -> bool:
        """Return whether what goes through a neighbour can be confirmed by its receiver."""
        link = self.link_to(neighbour)
        return not isinstance(link, DaemonLink) or link.whole

    def acknowledges(self, neighbour: str) -> bool:
        """Return whether a neighbour, or the daemon before it, says what it has."""
        match self.link_to(neighbour):
            case UdpLink():
                return False
            case TcpclLink(acknowledge=acknowledge):
                return acknowledge
            case LtpLink() | DaemonLink():
                return True
            case link:
                assert_never(link)

    def neighbour_of(self, destination: Eid) -> str | None:
        """Return the name of the neighbour through which a destination is reached, if any."""
        node = node_of(destination)
        for neighbour in self.neighbours:
            if node == neighbour.node or node in neighbour.reaches:
                return neighbour.name
        return next((other.name for other in self.neighbours if other.default), None)


def engine_of(node: Eid) -> int:
    """Return the LTP engine number of a node, which is its node number.

    Raises:
        ValueError: the node has no number.
    """
    if not isinstance(node, Ipn):
        raise ValueError(f"LTP goes between nodes with a number, not {node}")
    return node.node


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
        check_ranges(self, answer_s=(0.1, DAY_S), look_s=(0.05, DAY_S))


class Agent(Enum):
    """Who sends and receives: links of the agent, or NASA ION on the same machine."""

    EMBEDDED = "embedded"
    ION = "ion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Application:
    """An application that sends and receives.

    Attributes:
        eid: where it receives, and from where it sends.
    """

    eid: str

    def __post_init__(self) -> None:
        try:
            null = is_null(self.endpoint)
        except ValueError as error:
            raise ValueError(f"eid: {error}") from error
        if null:
            raise ValueError(f"eid: {self.eid} is the null endpoint")

    @property
    def endpoint(self) -> Eid:
        """The EID as a value."""
        return parse_eid(self.eid)


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer(Application):
    """Another application, and how the agent of its node is reached.

    Attributes:
        ltp, tcpcl, udp: one of them; none where a daemon reaches it.
    """

    ltp: LtpLink | None = None
    tcpcl: TcpclLink | None = None
    udp: UdpLink | None = None

    @property
    def links(self) -> dict[str, LtpLink | TcpclLink | UdpLink]:
        """The links that are given, by their keys."""
        links = {"ltp": self.ltp, "tcpcl": self.tcpcl, "udp": self.udp}
        return {key: link for key, link in links.items() if link is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentSettings(Application):
    """The application's own side: the agent of its node.

    Attributes:
        listen: where others reach this node, for each protocol that is spoken.
        contact_plan: the file of planned contacts, beside this one; None for always.
        agent: who sends and receives the bundles; ion: how that node is reached.
        security: who signs what, with which key; None for nobody.
        most_lifetime_s, most_ahead_s: see `NodeSettings`.
    """

    listen: Listen = NO_ADDRESSES
    contact_plan: str | None = None
    agent: Agent = Agent.EMBEDDED
    ion: IonSettings | None = None
    security: SecuritySettings | None = None
    most_lifetime_s: float = 60 * DAY_S
    most_ahead_s: float = DAY_S

    @property
    def daemon(self) -> IonSettings | None:
        """The node of ION that sends and receives; None where the agent has links of its own.

        Raises:
            ValueError: there are settings of ION, and it is not asked for.
        """
        if self.agent is Agent.ION:
            return self.ion or IonSettings()
        if self.ion is not None:
            raise ValueError(
                f"agent is {self.agent.value}, and there are settings of another: remove section"
                " ion, or say agent: ion"
            )
        return None

    def node_settings(self, neighbours: tuple[Neighbour, ...], lifetime_s: float) -> NodeSettings:
        """Return the settings of the agent, which has one endpoint.

        Raises:
            ValueError: they make no sense together.
        """
        return NodeSettings(
            self.endpoint,
            (self.endpoint,),
            neighbours,
            lifetime_s,
            most_lifetime_s=self.most_lifetime_s,
            most_ahead_s=self.most_ahead_s,
        )

    def link_to(self, other: Peer, name: str) -> AnyLink:
        """Return the link to a peer, named so in errors: that of its settings, or the daemon's.

        Raises:
            ValueError: there are too many, or none, or bundles could not go by it both ways.
        """
        links, daemon = other.links, self.daemon
        if daemon is not None:
            self._leave_to_daemon(other, name)
            return DaemonLink(other.endpoint, daemon.whole)
        if len(links) != 1:
            given = f"it has {' and '.join(links)}, keep one" if links else "give it one"
            raise ValueError(f"{name} is reached by one of ltp, tcpcl, udp: {given}")
        ((key, link),) = links.items()
        if link.address is not None and link.address.port == 0:
            raise ValueError(f"{key}.address of {name} has port 0: say where it listens")
        if link.address is None and self.listen.tcpcl is None:
            raise ValueError(
                f"tcpcl.address of {name} is null, and section listen has no tcpcl: neither could"
                " call the other, give one of them"
            )
        if not isinstance(link, TcpclLink) and getattr(self.listen, key) is None:
            raise ValueError(
                f"section listen lacks {key}, by which {name} is reached, and which sends from"
                f" where it listens: give listen.{key} the host and port that {name} has for us"
            )
        return link

    def _leave_to_daemon(self, other: Peer, name: str) -> None:
        agent = f"agent is {self.agent.value}, a daemon that"
        if other.links:
            raise ValueError(
                f"{agent} reaches {name}: remove {' and '.join(other.links)} of {name}, and section"
                " listen"
            )
        if self.listen != NO_ADDRESSES:
            raise ValueError(f"{agent} listens itself: remove section listen")


def listen_error(error: OSError, listen: Listen, settings_file: Path) -> str:
    """Return why an agent cannot listen, and what to do."""
    addresses = (listen.ltp, listen.tcpcl, listen.udp)
    where = ", ".join(f"{each.host}:{each.port}" for each in addresses if each is not None)
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
    return (
        f"cannot listen for bundles at {where}: {why}; choose another address in section listen of"
        f" {settings_file}, and tell it to the other end"
    )
