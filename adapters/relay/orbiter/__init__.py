"""`rover-mops`, the process at the orbiter: the MRS to the ground, MOPS over bundles to rovers."""

from adapters.relay.orbiter.settings import OrbiterSettings, RelayedRoverSettings, load_orbiter

__all__ = ["OrbiterSettings", "RelayedRoverSettings", "load_orbiter"]
