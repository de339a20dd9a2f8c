"""The orbiter's settings: its node, where it listens, and the rovers behind it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.bundle import DAY_S, AgentSettings, Neighbour, NodeSettings, Peer, node_of
from adapters.mops import require_asset
from executive.commands import declared
from executive.settings import HIGHEST_PORT, SettingsError, read_yaml, require_above_zero

_STOP: Final = "MotionControl.stop"
_OPERATIONS: Final = tuple(f"{each.service}.{each.operation}" for each in declared())


@dataclass(frozen=True, slots=True, kw_only=True)
class RelayedRoverSettings(Peer):
    """A rover behind the relay.

    Attributes:
        asset: its name; in capitals it is the name of its MOPS messages.
        domain: the MAL domain that names it.
        port: the TCP port at which the MRS is served for it; 0 takes a free one.
        numbered: whether it numbers its reports, as executives do and bricks do not.
        operations: of the MRS, by service and name, which commands it knows; None for all.
    """

    asset: str
    description: str
    domain: tuple[str, ...]
    port: int
    numbered: bool = True
    operations: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where the EID, the name, the port or an operation is none."""
        Peer.__post_init__(self)
        require_asset(self.asset)
        if not 0 <= self.port <= HIGHEST_PORT:
            raise ValueError(f"port: {self.port} is not a port of 0 to {HIGHEST_PORT}")
        if self.operations is None:
            return
        for name in self.operations:
            if name not in _OPERATIONS:
                known = ", ".join(_OPERATIONS)
                raise ValueError(f"operations: {name} carries no command; there are: {known}")
        if _STOP not in self.operations:
            raise ValueError(f"operations: {_STOP} is missing: every rover can be stopped")

    def serves(self, service: str, operation: str) -> bool:
        """Return whether the rover knows the command that an operation carries."""
        return self.operations is None or f"{service}.{operation}" in self.operations


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbiterSettings(AgentSettings):
    """The relay.

    Attributes:
        lifetime_s: how long a command without a lifetime is worth sending.
        silent_after_s: a rover of which nothing is heard for so long is OFFLINE.
        old_after_s: commands that wait for longer are told of.
        ask_again_s: a command that is up, and of which the rover should have said more for so
            long, is sent once more; None for never. Longer than the way there and back.
        history_reports: how many reports of each rover are kept.
        health_interval_s: how often the relay's own health is sent.
    """

    rovers: tuple[RelayedRoverSettings, ...]
    lifetime_s: float = DAY_S
    silent_after_s: float = 60.0
    old_after_s: float = 600.0
    ask_again_s: float | None = 120.0
    history_reports: int = 100_000
    health_interval_s: float = 5.0

    def __post_init__(self) -> None:
        """Raise ValueError where the EID or a figure makes no sense."""
        AgentSettings.__post_init__(self)
        times = ("lifetime_s", "silent_after_s", "old_after_s", "ask_again_s", "health_interval_s")
        require_above_zero(self, *times, "history_reports")

    def node(self) -> NodeSettings:
        """Return the settings of the bundle agent.

        Raises:
            ValueError: a link makes no sense.
        """
        neighbours = tuple(
            Neighbour(node_of(rover.endpoint), self.link_to(rover, f"rover {name}"))
            for name, rover in _by_name(self.rovers)
        )
        return self.node_settings(neighbours, self.lifetime_s)


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
        raise ValueError("rovers is empty: an orbiter without rovers has nothing to do")
    own = node_of(settings.endpoint)
    seen: dict[tuple[str, object], str] = {}
    for name, rover in _by_name(settings.rovers):
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


def _by_name(rovers: Sequence[RelayedRoverSettings]) -> Iterator[tuple[str, RelayedRoverSettings]]:
    """Yield rovers by what they are called in errors: their place in the file, and asset."""
    for number, rover in enumerate(rovers, 1):
        yield f"{number} ({rover.asset})", rover


def _own_things(rover: RelayedRoverSettings) -> Iterator[tuple[str, object]]:
    """Yield what no two rovers may share: what it is, and its value."""
    yield "asset", rover.asset.lower()
    yield "node", node_of(rover.endpoint)
    if rover.port:
        yield "port", rover.port
    for what, link in rover.links.items():
        if link.address is not None:
            yield f"{what} address", f"{link.address.host}:{link.address.port}"
