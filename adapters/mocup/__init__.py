"""MOCUP: whole motions of the executive as MOPS commands, replies as facts (thesis 6.1)."""

from adapters.mocup.plugin import ClaimAnnouncer, MocupFact, MocupRover, relay_authority

__all__ = ["ClaimAnnouncer", "MocupFact", "MocupRover", "relay_authority"]
