"""`OrbiterSettings` of `rover-mops`: its node, its listen addresses, the rovers behind it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.bundle import DAY_S, AgentSettings, Neighbour, NodeSettings, Peer, node_of
from adapters.mops import require_asset
from executive.commands import all_declarations
from executive.settings import MAX_PORT, SettingsError, read_yaml, require_above_zero

_STOP: Final = "MotionControl.stop"
_OPERATIONS: Final = tuple(f"{each.service}.{each.operation}" for each in all_declarations())


@dataclass(frozen=True, slots=True, kw_only=True)
class RelayedRoverSettings(Peer):
    """A rover behind the relay.

    Attributes:
        asset: its name; in capitals it is the name in MOPS messages.
        domain: its MAL domain.
        port: TCP port of its MRS; 0 selects a free port.
        numbers_reports: whether it numbers its reports, as executives do and bricks do not.
        operations: MRS operations whose commands it supports, by service and name; None for all.
    """

    asset: str
    description: str
    domain: tuple[str, ...]
    port: int
    numbers_reports: bool = True
    operations: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Raise ValueError if the EID, the name, the port or an operation is invalid."""
        Peer.__post_init__(self)
        require_asset(self.asset)
        if not 0 <= self.port <= MAX_PORT:
            raise ValueError(f"port: {self.port} is not in 0 to {MAX_PORT}")
        if self.operations is None:
            return
        for name in self.operations:
            if name not in _OPERATIONS:
                known = ", ".join(_OPERATIONS)
                raise ValueError(f"operations: {name} carries no command; known are: {known}")
        if _STOP not in self.operations:
            raise ValueError(f"operations: {_STOP} is missing: every rover must support stop")

    def serves(self, service: str, operation: str) -> bool:
        """Return whether the rover supports the command of an operation."""
        return self.operations is None or f"{service}.{operation}" in self.operations


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbiterSettings(AgentSettings):
    """Settings of the orbiter.

    Attributes:
        lifetime_s: lifetime of commands that have none.
        link_timeout_s: time without reception after which a rover is OFFLINE.
        queue_warning_s: waiting time after which a command is notified as old.
        retransmit_after_s: time without a further report after which a command in flight is
            retransmitted; None for never. Must exceed the round-trip time.
        retained_reports: maximum number of stored reports of each rover.
        health_interval_s: period of the relay's health parameters.
    """

    rovers: tuple[RelayedRoverSettings, ...]
    lifetime_s: float = DAY_S
    link_timeout_s: float = 60.0
    queue_warning_s: float = 600.0
    retransmit_after_s: float | None = 120.0
    retained_reports: int = 100_000
    health_interval_s: float = 5.0

    def __post_init__(self) -> None:
        """Raise ValueError if the EID or a value is invalid."""
        AgentSettings.__post_init__(self)
        times = (
            "lifetime_s",
            "link_timeout_s",
            "queue_warning_s",
            "retransmit_after_s",
            "health_interval_s",
        )
        require_above_zero(self, *times, "retained_reports")

    def node(self) -> NodeSettings:
        """Return the settings of the bundle agent.

        Raises:
            ValueError: a link is invalid.
        """
        neighbours = tuple(
            Neighbour(node_of(rover.endpoint), self.link_to(rover, f"rover {name}"))
            for name, rover in _by_name(self.rovers)
        )
        return self.node_settings(neighbours, self.lifetime_s)


def load_orbiter(path: Path) -> OrbiterSettings:
    """Return the settings of a file.

    Raises:
        SettingsError: the file cannot be read, or is invalid.
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
        raise ValueError("rovers is empty: an orbiter needs at least one rover")
    own = node_of(settings.endpoint)
    seen: dict[tuple[str, object], str] = {}
    for name, rover in _by_name(settings.rovers):
        if node_of(rover.endpoint) == own:
            raise ValueError(
                f"eid {rover.eid} of rover {name} and eid {settings.eid} of the orbiter are on one"
                f" node, {own}: each needs a node of its own"
            )
        for what, value in _unique_values(rover):
            other = seen.setdefault((what, value), name)
            if other != name:
                raise ValueError(
                    f"rovers {other} and {name} have the same {what}, {value}: each needs its own"
                )


def _by_name(rovers: Sequence[RelayedRoverSettings]) -> Iterator[tuple[str, RelayedRoverSettings]]:
    """Yield rovers with their name in errors: position in the file, and asset."""
    for number, rover in enumerate(rovers, 1):
        yield f"{number} ({rover.asset})", rover


def _unique_values(rover: RelayedRoverSettings) -> Iterator[tuple[str, object]]:
    """Yield values that must be unique to each rover, with their names."""
    yield "asset", rover.asset.lower()
    yield "node", node_of(rover.endpoint)
    if rover.port:
        yield "port", rover.port
    for what, link in rover.links.items():
        if link.address is not None:
            yield f"{what} address", f"{link.address.host}:{link.address.port}"
