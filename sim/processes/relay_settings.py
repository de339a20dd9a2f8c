"""Settings of both ends of the relay for simulated rovers: those of `config/`, at free ports."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from adapters.bundle import Address, Listen, LtpLink
from adapters.relay.orbiter.settings import OrbiterSettings, RelayedRoverSettings, load_orbiter
from adapters.relay.rover.settings import RelaySettings, load_relay
from executive.settings import SettingsError, config_folder
from sim.processes.deployment import Deployment
from sim.processes.place import ANY_PORT, HOST, free_udp_ports

SILENT_AFTER_S: Final = 5.0
HEALTH_INTERVAL_S: Final = 1.0
"""Nobody watches simulated rovers for hours: both are shorter than in `config/`."""


def relay_settings(
    rovers: Sequence[Deployment], contact_plan: str | None
) -> tuple[OrbiterSettings, Sequence[RelaySettings]]:
    """Return the settings of the orbiter, and of each rover's end.

    Raises:
        SettingsError: an asset has no relay, or the orbiter does not know it.
    """
    path = config_folder() / "mops" / "orbiter.yaml"
    known = load_orbiter(path)
    behind = {rover.asset: rover for rover in known.rovers}
    orbiter_port, *ports = free_udp_ports(1 + len(rovers))
    served: list[RelayedRoverSettings] = []
    relays: list[RelaySettings] = []
    for rover, port in zip(rovers, ports, strict=True):
        asset = rover.settings.asset
        relay, _ = load_relay(asset)
        orbiter = replace(relay.orbiter, ltp=_at(orbiter_port), tcpcl=None, udp=None)
        relays.append(
            replace(
                relay,
                orbiter=orbiter,
                listen=_listen(port),
                contact_plan=contact_plan,
                health_interval_s=HEALTH_INTERVAL_S,
            )
        )
        if asset not in behind:
            raise SettingsError(f"{path}: {asset} is not among the rovers")
        mrs_port = ANY_PORT if rover.place.port == ANY_PORT else behind[asset].port
        served.append(replace(behind[asset], ltp=_at(port), tcpcl=None, udp=None, port=mrs_port))
    settings = replace(
        known,
        listen=_listen(orbiter_port),
        rovers=tuple(served),
        contact_plan=contact_plan,
        silent_after_s=SILENT_AFTER_S,
        health_interval_s=HEALTH_INTERVAL_S,
    )
    return settings, relays


def _at(port: int) -> LtpLink:
    return LtpLink(Address(HOST, port))


def _listen(port: int) -> Listen:
    return Listen(ltp=Address(HOST, port))
