"""How an agent is set up: its EIDs, its neighbours, its limits."""

from dataclasses import dataclass, field
from typing import Final, assert_never

from adapters.bundle.codec.eid import Eid, Ipn, is_null, node_of
from adapters.bundle.node.database import Limits

DAY_S: Final = 86_400.0
LONGEST_LIFETIME_S: Final = 1e10
"""Three hundred years; longer lifetimes are cut to it."""
HIGHEST_PORT: Final = 65535
_DATAGRAM_OCTETS: Final = 65_507
_LEAST_BUNDLE_OCTETS: Final = 512
"""Room for a fragment with two long EIDs and a hundred octets of its payload."""
_CONFIRM_AFTER_S: Final = (0.1, 1e7)


def check_ranges(settings: object, **bounds: tuple[float, float]) -> None:
    """Check that fields of a settings dataclass are within bounds, or None.

    Args:
        settings: the dataclass.
        **bounds: by the names of its fields, the least and the most that makes sense.

    Raises:
        ValueError: one is not.
    """
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
        block_octets: how many octets of bundles go in one block, at most.
        bundle_octets: what is longer is fragmented.
        sessions: how many blocks may be on their way at once.
        answer_s: what the other side may take to answer, beside the light time of the plan.
        confirm_after_s: when what should have been confirmed is first sent again; the pause
            doubles each time.
    """

    address: Address
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
        """What it is called in the store, in logs and in the contact plan."""
        return str(self.node)


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
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        check_ranges(
            self,
            lifetime_s=(0.001, LONGEST_LIFETIME_S),
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
                engine_of(neighbour.node)
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

    def must_confirm(self, destination: Eid) -> bool:
        """Return whether what goes there may get lost unless its receiver confirms it."""
        neighbour = self.neighbour_of(destination)
        match None if neighbour is None else self.link_to(neighbour):
            case UdpLink():
                return True
            case TcpclLink(acknowledge=acknowledge):
                return not acknowledge
            case LtpLink() | DaemonLink() | None:
                return False
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
