"""The rover's end of the relay: its endpoint, the orbiter, and how bundles go between them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.bundle import DAY_S, AgentSettings, Eid, Neighbour, NodeSettings, Peer, node_of
from adapters.mops import require_asset
from executive.settings import SettingsError, config_folder, read_yaml, require_above_zero

_SUFFIX: Final = ".relay.yaml"


@dataclass(frozen=True, slots=True, kw_only=True)
class RelaySettings(AgentSettings):
    """What `config/<asset>.relay.yaml` says.

    Attributes:
        asset: the rover's name in messages.
        orbiter: the other end: where notifications go, and from where commands come.
        lifetime_s: how long a report is worth sending.
        telemetry_lifetime_s: the same of telemetry.
        telemetry_queue: while more bundles than that wait, the newest telemetry waits for its turn.
        health_interval_s: how often the health of this end is sent.
    """

    asset: str
    orbiter: Peer
    lifetime_s: float = 7 * DAY_S
    telemetry_lifetime_s: float = 30.0
    telemetry_queue: int = 4
    health_interval_s: float = 5.0

    def __post_init__(self) -> None:
        """Raise ValueError where the EID, the name or a figure makes no sense."""
        AgentSettings.__post_init__(self)
        require_asset(self.asset)
        require_above_zero(self, "lifetime_s", "telemetry_lifetime_s", "health_interval_s")
        if self.telemetry_queue < 0:
            raise ValueError(f"telemetry_queue is {self.telemetry_queue}: 0 or more")

    @property
    def ground(self) -> Eid:
        """Where notifications go."""
        return self.orbiter.endpoint

    def node(self) -> NodeSettings:
        """Return the settings of the bundle agent.

        Raises:
            ValueError: the link makes no sense.
        """
        link = self.link_to(self.orbiter, "orbiter")
        orbiter = Neighbour(node_of(self.ground), link, default=True)
        return self.node_settings((orbiter,), self.lifetime_s)


def load_relay(asset: str, path: Path | None = None) -> tuple[RelaySettings, Path]:
    """Return the settings of an asset, and where they were read.

    Raises:
        SettingsError: there are none, they do not fit, or are those of another asset.
    """
    path = path or config_folder() / f"{asset}{_SUFFIX}"
    if not path.is_file():
        known = sorted(
            each.name.removesuffix(_SUFFIX) for each in config_folder().glob(f"*{_SUFFIX}")
        )
        raise SettingsError(
            f"{path}: there is none, so {asset} has no relay; there is one for"
            f" {', '.join(known) or 'nobody'}, and --config names another file"
        )
    settings = read_yaml(path, RelaySettings)
    if settings.asset != asset.upper():
        raise SettingsError(
            f"{path}: asset is {settings.asset}, and the name of {asset} in messages is"
            f" {asset.upper()}: correct it there, or say with --asset whose file it is"
        )
    try:
        if node_of(settings.endpoint) == node_of(settings.ground):
            raise ValueError(
                f"eid {settings.eid} and orbiter.eid {settings.orbiter.eid} are on one node: each"
                " needs its own"
            )
        settings.node()
    except ValueError as error:
        raise SettingsError(f"{path}: {error}") from error
    return settings, path
