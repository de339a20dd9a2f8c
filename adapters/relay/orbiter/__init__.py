"""`rover-mops`, the process at the orbiter: the MRS to the ground, MOPS over bundles to rovers."""

from adapters.relay.orbiter.settings import OrbiterSettings as OrbiterSettings
from adapters.relay.orbiter.settings import RelayedRoverSettings as RelayedRoverSettings
from adapters.relay.orbiter.settings import load_orbiter as load_orbiter
