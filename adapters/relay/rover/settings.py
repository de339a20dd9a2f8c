"""`RelaySettings` of `rover-relay`: its endpoint, the orbiter, and the link between them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.bundle import DAY_S, AgentSettings, Eid, Neighbour, NodeSettings, Peer, node_of
from adapters.mops import require_asset
from executive.settings import SettingsError, config_folder, read_yaml, require_above_zero

_SUFFIX: Final = ".relay.yaml"


@dataclass(frozen=True, slots=True, kw_only=True)
class RelaySettings(AgentSettings):
    """Content of `config/<asset>.relay.yaml`.

    Attributes:
        asset: the rover's name in messages.
        orbiter: the other end: destination of notifications, and source of commands.
        telemetry_queue: while more bundles than this wait, the newest telemetry is held back.
        health_interval_s: period of this end's health messages.
    """

    asset: str
    orbiter: Peer
    lifetime_s: float = 7 * DAY_S
    telemetry_lifetime_s: float = 30.0
    telemetry_queue: int = 4
    health_interval_s: float = 5.0

    def __post_init__(self) -> None:
        """Raise ValueError if the EID, the name or a value is invalid."""
        AgentSettings.__post_init__(self)
        require_asset(self.asset)
        require_above_zero(self, "lifetime_s", "telemetry_lifetime_s", "health_interval_s")
        if self.telemetry_queue < 0:
            raise ValueError(f"telemetry_queue is {self.telemetry_queue}, must be 0 or more")

    @property
    def ground(self) -> Eid:
        """Destination EID of notifications."""
        return self.orbiter.endpoint

    def node(self) -> NodeSettings:
        """Return the settings of the bundle agent.

        Raises:
            ValueError: the link is invalid.
        """
        link = self.link_to(self.orbiter, "orbiter")
        orbiter = Neighbour(node_of(self.ground), link, default=True)
        return self.node_settings((orbiter,), self.lifetime_s)


def load_relay(asset: str, path: Path | None = None) -> tuple[RelaySettings, Path]:
    """Return the settings of an asset, and the path of their file.

    Raises:
        SettingsError: the file is missing, invalid, or belongs to another asset.
    """
    path = path or config_folder() / f"{asset}{_SUFFIX}"
    if not path.is_file():
        known = sorted(
            each.name.removesuffix(_SUFFIX) for each in config_folder().glob(f"*{_SUFFIX}")
        )
        raise SettingsError(
            f"{path}: file not found, so {asset} has no relay; files exist for"
            f" {', '.join(known) or 'no asset'}, and --config names another file"
        )
    settings = read_yaml(path, RelaySettings)
    if settings.asset != asset.upper():
        raise SettingsError(
            f"{path}: asset is {settings.asset}, but {asset} is named"
            f" {asset.upper()} in messages: correct the file, or select its asset with --asset"
        )
    try:
        if node_of(settings.endpoint) == node_of(settings.ground):
            raise ValueError(
                f"eid {settings.eid} and orbiter.eid {settings.orbiter.eid} are on one node: each"
                " needs a node of its own"
            )
        settings.node()
    except ValueError as error:
        raise SettingsError(f"{path}: {error}") from error
    return settings, path
