"""The orbiter's settings: its node, where it listens, and the rovers behind it."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from adapters.bundle.attached.settings import (
    Aap2Settings,
    Agent,
    DaemonSettings,
    IonSettings,
    daemon_of,
    way_to,
)
from adapters.bundle.eid import Eid, node_of, parse_eid
from adapters.bundle.links import NOWHERE, Listen
from adapters.bundle.settings import (
    LtpLink,
    Neighbour,
    NodeSettings,
    TcpclLink,
    UdpLink,
)
from executive.settings import HIGHEST_PORT, SettingsError, read_yaml, require_above_zero


@dataclass(frozen=True, slots=True)
class RoverSettings:
    """A rover behind the relay.

    Attributes:
        asset: its name; in capitals it is the name of its MOPS messages.
        domain: the MAL domain that names it.
        eid: where it takes commands, and from where its reports come.
        port: the TCP port at which the MRS is served for it; 0 takes a free one.
        ltp, tcpcl, udp: how its bundle agent is reached, by one of them; by none where a daemon
            reaches it.
        numbered: whether it numbers its reports, as executives do and bricks do not.
    """

    asset: str
    description: str
    domain: tuple[str, ...]
    eid: str
    port: int
    ltp: LtpLink | None = None
    tcpcl: TcpclLink | None = None
    udp: UdpLink | None = None
    numbered: bool = True

    def __post_init__(self) -> None:
        """Raise ValueError where the port is none."""
        if not 0 <= self.port <= HIGHEST_PORT:
            raise ValueError(f"{self.port} is not a port of 0 to {HIGHEST_PORT}")

    @property
    def endpoint(self) -> Eid:
        """The EID as a value; raises ValueError if it is none."""
        return parse_eid(self.eid)


@dataclass(frozen=True, slots=True)
class OrbiterSettings:
    """The relay.

    Attributes:
        eid: from where commands go, and where reports come.
        listen: where rovers reach this node, for each protocol that is spoken.
        contact_plan: the file of planned contacts, beside this one; None for always.
        lifetime_s: how long a command without a lifetime is worth sending.
        silent_after_s: a rover of which nothing is heard for so long is OFFLINE.
        old_after_s: commands that wait for longer are told of.
        ask_again_s: a command that is up, and of which the rover should have said more for so
            long, is sent once more; None for never. Longer than the way there and back.
        history_reports: how many reports of each rover are kept.
        health_interval_s: how often the relay's own health is sent.
        agent: who carries the bundles; ion, aap2: where that one is.
    """

    eid: str
    rovers: tuple[RoverSettings, ...]
    listen: Listen = NOWHERE
    contact_plan: str | None = None
    lifetime_s: float = 86_400.0
    silent_after_s: float = 60.0
    old_after_s: float = 600.0
    ask_again_s: float | None = 120.0
    history_reports: int = 100_000
    health_interval_s: float = 5.0
    agent: Agent = Agent.EMBEDDED
    ion: IonSettings | None = None
    aap2: Aap2Settings | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where a figure makes no sense."""
        times = ("lifetime_s", "silent_after_s", "old_after_s", "ask_again_s", "health_interval_s")
        require_above_zero(self, *times, "history_reports")

    @property
    def daemon(self) -> DaemonSettings | None:
        """Who carries the bundles; None where the agent does so itself."""
        return daemon_of(self.agent, self.ion, self.aap2)

    def node(self) -> NodeSettings:
        """Return the settings of the bundle agent; raises ValueError if EIDs make no sense."""
        own = parse_eid(self.eid)
        neighbours = tuple(self._neighbour(rover) for rover in self.rovers)
        return NodeSettings(own, (own,), neighbours, self.lifetime_s)

    def _neighbour(self, rover: RoverSettings) -> Neighbour:
        links = (rover.ltp, rover.tcpcl, rover.udp)
        return Neighbour(node_of(rover.endpoint), way_to(rover.endpoint, links, self.daemon))


def load_orbiter(path: Path) -> OrbiterSettings:
    """Return the settings of a file.

    Raises:
        SettingsError: it cannot be read, or does not fit.
    """
    settings = read_yaml(path, OrbiterSettings)
    try:
        _require_distinct(settings)
        settings.node()
    except ValueError as error:
        raise SettingsError(f"{path}: {error}") from error
    return settings


def _require_distinct(settings: OrbiterSettings) -> None:
    if not settings.rovers:
        raise ValueError("an orbiter without rovers has nothing to do")
    own = node_of(parse_eid(settings.eid))
    seen: dict[tuple[str, object], str] = {}
    for number, rover in enumerate(settings.rovers, 1):
        name = f"{number} ({rover.asset})"
        if node_of(rover.endpoint) == own:
            raise ValueError(
                f"eid {rover.eid} of rover {name} and eid {settings.eid} of the orbiter are on one"
                f" node, {own}: each needs its own"
            )
        for what, value in _own_things(rover):
            other = seen.setdefault((what, value), name)
            if other != name:
                raise ValueError(
                    f"rovers {other} and {name} have the same {what}, {value}: each needs its own"
                )


def _own_things(rover: RoverSettings) -> Iterator[tuple[str, object]]:
    """Yield what no two rovers may share: what it is, and its value."""
    yield "asset", rover.asset
    yield "node", node_of(rover.endpoint)
    if rover.port:
        yield "port", rover.port
    for what, link in (("ltp", rover.ltp), ("tcpcl", rover.tcpcl), ("udp", rover.udp)):
        if link is not None and link.address is not None:
            yield f"{what} address", f"{link.address.host}:{link.address.port}"
