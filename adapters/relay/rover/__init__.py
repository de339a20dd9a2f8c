"""The rover's end of the relay: `rover-relay`, and the executive's end of its topics."""
