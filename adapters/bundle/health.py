"""How the relay is doing, as an agent sees it."""

from dataclasses import dataclass

from adapters.bundle.eid import Eid
from adapters.bundle.gate import Override


@dataclass(frozen=True, slots=True)
class NeighbourHealth:
    """One neighbour.

    Attributes:
        queued: how many bundles wait for it or for a confirmation.
        contact: whether something may be sent to it now.
        override: what the operator says of contact.
        next_contact_utc_s: when the next contact is planned to begin; infinity if none is, or if
            the operator keeps it closed.
        last_heard_s: how long ago something came from it; None for never.
    """

    node: Eid
    queued: int
    contact: bool
    override: Override
    next_contact_utc_s: float
    last_heard_s: float | None


@dataclass(frozen=True, slots=True)
class Health:
    """An agent.

    Attributes:
        queued: how many bundles are in the outbox.
        oldest_s: how long the oldest of them has been there.
        unread: how many units wait for the application.
        expired: how many bundles ended here with their lifetime, ever.
        malformed: how many could not be read since the start.
        room_octets: how much the store still takes.
        full: whether it refuses more.
        no_room: why it does; empty where it does not.
    """

    queued: int
    oldest_s: float
    unread: int
    expired: int
    malformed: int
    room_octets: int
    full: bool
    no_room: str
    neighbours: tuple[NeighbourHealth, ...]
