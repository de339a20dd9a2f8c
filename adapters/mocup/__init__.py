"""`MocupRover` behind the port `DelegatedMotionRover`: motions as MOPS messages (thesis 6.1)."""

from adapters.mocup.plugin import ClaimAnnouncer as ClaimAnnouncer
from adapters.mocup.plugin import MocupFact as MocupFact
from adapters.mocup.plugin import MocupRover as MocupRover
from adapters.mocup.plugin import relay_authority as relay_authority
