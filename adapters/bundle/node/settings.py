"""Settings of an agent: its EIDs, neighbours and limits, and their section of a settings file."""

import os
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Final, assert_never

from adapters.bundle.codec.eid import Eid, Ipn, is_null, node_of, parse_eid
from adapters.bundle.node.database import StoreLimits
from adapters.bundle.node.security import SecuritySettings

DAY_S: Final = 86_400.0
MAX_LIFETIME_S: Final = 1e10
"""Upper bound of every lifetime setting, about 300 years."""
MAX_PORT: Final = 65535
_DATAGRAM_OCTETS: Final = 65_507
_MIN_BUNDLE_OCTETS: Final = 512
"""Minimum size of a fragment: two long EIDs and a hundred octets of payload."""
_CONFIRM_AFTER_S: Final = (0.1, 1e7)


def check_ranges(settings: object, **bounds: tuple[float, float]) -> None:
    """Raise ValueError unless each named field is None or within its bounds."""
    for name, (low, high) in bounds.items():
        figure = getattr(settings, name)
        if figure is not None and not low <= figure <= high:
            raise ValueError(f"{name} must be {low:,} to {high:,}, not {figure}")


@dataclass(frozen=True, slots=True)
class Address:
    """Host and port of a listener."""

    host: str
    port: int

    def __post_init__(self) -> None:
        try:
            fits = b"\0" not in self.host.encode("idna")
        except UnicodeError:
            fits = False
        if not fits:
            parts = "each label between dots has 1 to 63 characters"
            raise ValueError(f"host {self.host!r} is not a host name: {parts}")
        if not 0 <= self.port <= MAX_PORT:
            raise ValueError(f"port {self.port} is not in 0 to {MAX_PORT}")


@dataclass(frozen=True, slots=True)
class Listen:
    """Listen addresses of an agent, one for each protocol; None disables the protocol.

    LTP and UDP send from their listen address, so a neighbour over them needs one here.
    """

    ltp: Address | None = None
    tcpcl: Address | None = None
    udp: Address | None = None


NO_ADDRESSES: Final = Listen()


@dataclass(frozen=True, slots=True)
class LtpLink:
    """A neighbour over LTP on UDP (RFC 5326); LTP itself is reliable.

    Attributes:
        address: listen address of its LTP engine. Its engine number is its node number.
        via: node EID of the router that has this engine, such as ipn:9.0; None if it is its own.
        block_octets: maximum octets of bundles in one block.
        bundle_octets: bundles above this length are fragmented.
        sessions: maximum number of blocks in flight.
        answer_s: time that the peer may take to answer, in addition to the plan's light time.
        confirm_after_s: delay of the first retransmission of an unconfirmed bundle. It doubles
            at each repetition, up to 32 times this value.
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
            bundle_octets=(_MIN_BUNDLE_OCTETS, 16 << 20),
            sessions=(1, 256),
            answer_s=(0.01, DAY_S),
            confirm_after_s=_CONFIRM_AFTER_S,
        )
        if self.via is not None:
            engine_of(parse_eid(self.via))


@dataclass(frozen=True, slots=True)
class TcpclLink:
    """A neighbour over TCPCL version 3 (RFC 7242).

    Attributes:
        address: its listen address; None waits for the neighbour to connect.
        acknowledge: whether bundles are acknowledged; both sides need the same value. With
            acknowledgements NASA ION 4.1 hangs or ends when a session breaks: for ION use False,
            and confirmation of bundles.
        keepalive_s: maximum silence of a session; 0 for no limit.
        window_octets: maximum octets in flight without acknowledgement.
        redial_s: minimum pause before connecting again; it doubles up to 30 s.
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
    """A neighbour over plain UDP, one bundle in a datagram. Lost datagrams are lost bundles.

    Attributes:
        bundle_octets: bundles above this length are fragmented.
        rate_octets_s: maximum data rate, octets/s.
        confirm_after_s: see `LtpLink`.
    """

    address: Address
    bundle_octets: int = 1400
    rate_octets_s: int = 1_000_000
    confirm_after_s: float = 10.0

    def __post_init__(self) -> None:
        check_ranges(
            self,
            bundle_octets=(_MIN_BUNDLE_OCTETS, _DATAGRAM_OCTETS),
            rate_octets_s=(1, 1 << 40),
            confirm_after_s=_CONFIRM_AFTER_S,
        )


@dataclass(frozen=True, slots=True)
class DaemonLink:
    """A neighbour that is reached through the agent's daemon.

    Attributes:
        endpoint: EID of the remote application.
        whole: whether the daemon carries our whole bundles as its payload. They then keep their
            identity and can be confirmed. Both ends must be attached and set this.
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
        reaches: node EIDs that are routed through it.
        default: whether it is the route to all other nodes.
    """

    node: Eid
    link: AnyLink
    reaches: tuple[Eid, ...] = ()
    default: bool = False

    @property
    def name(self) -> str:
        """Its name in the store and in logs."""
        return str(self.node)

    @property
    def next_hop(self) -> Eid:
        """Node at the other end of the link, as named in the contact plan: a router, or itself."""
        if isinstance(self.link, LtpLink) and self.link.via is not None:
            return node_of(parse_eid(self.link.via))
        return self.node


@dataclass(frozen=True, slots=True)
class NodeSettings:
    """The settings of an agent.

    Attributes:
        sender: source EID of the bundles sent.
        receivers: EIDs of the receiving endpoints.
        neighbours: nodes that it reaches directly.
        lifetime_s: default lifetime of a bundle.
        hop_limit: hop limit of own bundles; None omits the hop count block.
        max_payload_octets: maximum size of a reassembled application data unit.
        max_lifetime_s: maximum lifetime that is sent or accepted.
        max_clock_lead_s: maximum lead of a bundle's creation time over the clock here.

    Raises:
        ValueError: an EID or a value is invalid.
    """

    sender: Eid
    receivers: tuple[Eid, ...]
    neighbours: tuple[Neighbour, ...]
    lifetime_s: float = 7 * DAY_S
    hop_limit: int | None = None
    max_payload_octets: int = 16 << 20
    max_lifetime_s: float = 60 * DAY_S
    max_clock_lead_s: float = DAY_S
    limits: StoreLimits = field(default_factory=StoreLimits)

    def __post_init__(self) -> None:
        check_ranges(
            self,
            max_lifetime_s=(0.001, MAX_LIFETIME_S),
            lifetime_s=(0.001, self.max_lifetime_s),
            max_clock_lead_s=(0.0, MAX_LIFETIME_S),
            hop_limit=(1, 255),
            max_payload_octets=(1, 1 << 30),
        )
        for eid in (self.sender, *self.receivers):
            if is_null(eid) or node_of(eid) != self.node:
                raise ValueError(f"{eid} is not an endpoint of {self.node}")
        for neighbour in self.neighbours:
            if is_null(neighbour.node) or neighbour.node != node_of(neighbour.node):
                raise ValueError(f"{neighbour.node} is not a node EID such as ipn:1.0")
            if neighbour.node == self.node:
                raise ValueError(f"{neighbour.node} is its own neighbour")
            if isinstance(neighbour.link, LtpLink):
                engine_of(neighbour.next_hop)
        if any(isinstance(neighbour.link, LtpLink) for neighbour in self.neighbours):
            engine_of(self.node)

    @property
    def node(self) -> Eid:
        """The EID of the node itself, source and destination of status reports."""
        return node_of(self.sender)

    def link_to(self, neighbour: str) -> AnyLink:
        """Return the link to the neighbour with this name; raise KeyError if there is none."""
        return {other.name: other.link for other in self.neighbours}[neighbour]

    def confirms(self, neighbour: str) -> bool:
        """Return whether receivers can confirm bundles that go through a neighbour."""
        link = self.link_to(neighbour)
        return not isinstance(link, DaemonLink) or link.whole

    def acknowledges(self, neighbour: str) -> bool:
        """Return whether a neighbour, or the daemon in front of it, acknowledges bundles."""
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
        """Return the name of the neighbour that routes to a destination, or None."""
        node = node_of(destination)
        for neighbour in self.neighbours:
            if node == neighbour.node or node in neighbour.reaches:
                return neighbour.name
        return next((other.name for other in self.neighbours if other.default), None)


def engine_of(node: Eid) -> int:
    """Return the LTP engine number of a node, which is its node number.

    Raises:
        ValueError: the node has no node number.
    """
    if not isinstance(node, Ipn):
        raise ValueError(f"LTP needs a node with a number such as ipn:1.0, not {node}")
    return node.node


@dataclass(frozen=True, slots=True)
class IonSettings:
    """NASA ION on this machine, attached through pyion.

    Attributes:
        python: interpreter that has pyion; None for the present interpreter.
        node_list: ION_NODE_LIST_DIR, if several nodes share the machine; None for the value of
            the environment.
        whole: see `DaemonLink`.
        answer_s: silence after which the bridge or ION counts as hanging.
        poll_period_s: period of the liveness check of ION.
    """

    python: str | None = None
    node_list: str | None = None
    whole: bool = False
    answer_s: float = 30.0
    poll_period_s: float = 15.0

    def __post_init__(self) -> None:
        check_ranges(self, answer_s=(0.1, DAY_S), poll_period_s=(0.05, DAY_S))


class Agent(Enum):
    """Implementation of sending and receiving: own links, or NASA ION on the same machine."""

    EMBEDDED = "embedded"
    ION = "ion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Application:
    """An application that sends and receives.

    Attributes:
        eid: its endpoint, for sending and receiving.
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
    """Another application, and the link to the agent of its node.

    Attributes:
        ltp, tcpcl, udp: exactly one is set; none if a daemon reaches it.
    """

    ltp: LtpLink | None = None
    tcpcl: TcpclLink | None = None
    udp: UdpLink | None = None

    @property
    def links(self) -> dict[str, LtpLink | TcpclLink | UdpLink]:
        """The links that are set, by their keys."""
        links = {"ltp": self.ltp, "tcpcl": self.tcpcl, "udp": self.udp}
        return {key: link for key, link in links.items() if link is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentSettings(Application):
    """Settings of the application's own node and agent.

    Attributes:
        listen: listen addresses of this node, one for each protocol in use.
        contact_plan: file of planned contacts, relative to this file; None for permanent contact.
        agent: implementation that sends and receives; ion: access to that node.
        security: signature policies and keys; None disables signatures.
        max_lifetime_s, max_clock_lead_s: see `NodeSettings`.
    """

    listen: Listen = NO_ADDRESSES
    contact_plan: str | None = None
    agent: Agent = Agent.EMBEDDED
    ion: IonSettings | None = None
    security: SecuritySettings | None = None
    max_lifetime_s: float = 60 * DAY_S
    max_clock_lead_s: float = DAY_S

    @property
    def daemon(self) -> IonSettings | None:
        """The ION node that sends and receives; None if the agent has links of its own.

        Raises:
            ValueError: there is a section `ion` although the agent is another.
        """
        if self.agent is Agent.ION:
            return self.ion or IonSettings()
        if self.ion is not None:
            raise ValueError(
                f"agent is {self.agent.value}, but there is a section ion: remove it, or set"
                " agent: ion"
            )
        return None

    def node_settings(self, neighbours: tuple[Neighbour, ...], lifetime_s: float) -> NodeSettings:
        """Return the settings of a node with one endpoint.

        Raises:
            ValueError: the values contradict each other.
        """
        return NodeSettings(
            self.endpoint,
            (self.endpoint,),
            neighbours,
            lifetime_s,
            max_lifetime_s=self.max_lifetime_s,
            max_clock_lead_s=self.max_clock_lead_s,
        )

    def link_to(self, other: Peer, name: str) -> AnyLink:
        """Return the link to a peer: the link of its settings, or that of the daemon.

        Raises:
            ValueError: not exactly one link is set, or it cannot carry bundles in both directions.
        """
        links, daemon = other.links, self.daemon
        if daemon is not None:
            self._leave_to_daemon(other, name)
            return DaemonLink(other.endpoint, daemon.whole)
        if len(links) != 1:
            given = f"it has {' and '.join(links)}, remove all except one" if links else "add one"
            raise ValueError(f"{name} needs exactly one of ltp, tcpcl, udp: {given}")
        ((key, link),) = links.items()
        if link.address is not None and link.address.port == 0:
            raise ValueError(f"{key}.address of {name} has port 0: set the port it listens at")
        if link.address is None and self.listen.tcpcl is None:
            raise ValueError(
                f"tcpcl.address of {name} is null, and section listen has no tcpcl: neither side"
                " can connect: set one of them"
            )
        if not isinstance(link, TcpclLink) and getattr(self.listen, key) is None:
            raise ValueError(
                f"section listen lacks {key}, which the link to {name} needs as its source address:"
                f" set listen.{key} to the host and port that {name} uses for this node"
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
    """Return the text for an agent that cannot listen: cause and remedy."""
    addresses = (listen.ltp, listen.tcpcl, listen.udp)
    where = ", ".join(f"{each.host}:{each.port}" for each in addresses if each is not None)
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
    return (
        f"cannot listen for bundles at {where}: {why}; choose another address in section listen of"
        f" {settings_file}, and change it at the other end"
    )
