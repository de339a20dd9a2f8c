"""The process `rover-mops`, at the orbiter: MRS to the ground, MOPS over bundles to the rovers."""

from adapters.relay.orbiter.settings import OrbiterSettings as OrbiterSettings
from adapters.relay.orbiter.settings import RelayedRoverSettings as RelayedRoverSettings
from adapters.relay.orbiter.settings import load_orbiter as load_orbiter
