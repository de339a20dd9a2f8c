"""The rover's end of the relay: `rover-relay`, and the executive's end of its topics."""

from adapters.relay.rover.settings import RelaySettings, load_relay

__all__ = ["RelaySettings", "load_relay"]
