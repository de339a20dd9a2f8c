"""Rover end of the relay: `rover-relay`, and the executive's end of its topics."""

from adapters.relay.rover.settings import RelaySettings as RelaySettings
from adapters.relay.rover.settings import load_relay as load_relay
