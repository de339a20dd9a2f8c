"""Whether there is contact with a neighbour: by the plan, or by what the operator says."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import inf

from adapters.bundle.contact_plan import ContactPlan
from adapters.bundle.eid import Eid, Ipn


class Override(Enum):
    """What the operator says of a link."""

    BY_PLAN = "by plan"
    UP = "up"
    DOWN = "down"


@dataclass(frozen=True, slots=True)
class Outlook:
    """What may be expected of a link now.

    Attributes:
        contact: whether something can be sent.
        light_time_s: how long it takes one way.
        rate_octets_s: how much can be sent, or infinity.
        next_contact_utc_s: when the next contact is planned to begin; infinity if none is, or if
            the operator keeps it closed.
    """

    contact: bool
    light_time_s: float
    rate_octets_s: float
    next_contact_utc_s: float


class Gate:
    """Opens and closes the way to a neighbour. Without a plan it is always open.

    Args:
        own: our node.
        neighbour: the other node.
        plan: planned contacts; None for always.
        utc_s: the time in seconds since 1970.

    Attributes:
        override: what the operator says.
    """

    def __init__(
        self, own: Eid, neighbour: Eid, plan: ContactPlan | None, utc_s: Callable[[], float]
    ) -> None:
        """Begin by the plan."""
        self.override = Override.BY_PLAN
        self.plan = plan
        self._nodes = (
            (own.node, neighbour.node)
            if isinstance(own, Ipn) and isinstance(neighbour, Ipn)
            else None
        )
        self._utc_s = utc_s

    def outlook(self) -> Outlook:
        """Return what may be expected now. Nodes without a number are in no plan."""
        down, up = self.override is Override.DOWN, self.override is Override.UP
        if self.plan is None or self._nodes is None:
            return Outlook(not down, 0.0, inf, inf)
        utc_s = self._utc_s()
        contact = self.plan.contact(*self._nodes, utc_s)
        return Outlook(
            up or (contact is not None and not down),
            self.plan.light_time_s(*self._nodes, utc_s),
            contact.rate_octets_s or inf if contact else inf,
            inf if down else self.plan.next_contact_utc_s(*self._nodes, utc_s),
        )
