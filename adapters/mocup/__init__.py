"""MOCUP: whole motions of the executive as MOPS commands, replies as facts (thesis 6.1)."""

from adapters.mocup.plugin import ClaimAnnouncer as ClaimAnnouncer
from adapters.mocup.plugin import MocupFact as MocupFact
from adapters.mocup.plugin import MocupRover as MocupRover
from adapters.mocup.plugin import relay_authority as relay_authority
