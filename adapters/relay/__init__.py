"""The relay link: `rover-mops` at the orbiter, `rover-relay` and the executive's end aboard."""
