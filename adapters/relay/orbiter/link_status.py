"""How the way to a rover is: what the agent measures, what the operator ordered, what changed."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final, assert_never

from adapters.bundle import (
    BundleAgent,
    BundleError,
    ContactOverride,
    ContactPlan,
    Eid,
    IonSettings,
    NeighbourHealth,
)
from adapters.mal import AttributeType, Typed
from adapters.mops import LinkHealth
from adapters.mrs.ground import LAST_HEARD, NEXT_CONTACT, OVERRIDE, describe_next_contact
from adapters.mrs.spec import ParameterDefinition, ParameterValue, Validity, to_ns
from adapters.relay.orbiter.console import CONTACT
from executive.reasons import Figure
from executive.reports import Severity

BY_PLAN: Final = f"{CONTACT} PLAN"
"""What gives the way back to the plan, as it is typed."""


class ContactOverrides:
    """Opens and closes the ways to the rovers. What is ordered holds until the process ends.

    Args:
        agent: sends the bundles.
        daemon: the node of ION that carries them, if one does.
        read_plan: reads the contact plan again; raises BundleError.
    """

    def __init__(
        self,
        agent: BundleAgent,
        daemon: IonSettings | None,
        read_plan: Callable[[], ContactPlan | None],
    ) -> None:
        self._agent, self._daemon, self._read_plan = agent, daemon, read_plan

    def order(self, node: Eid, override: ContactOverride) -> str:
        """Do as the operator says; return what holds from now on.

        The plan is read again when the way is given back to it.

        Args:
            node: of the rover.
            override: what the operator says.

        Raises:
            BundleError: contacts are set elsewhere, or the plan cannot be read; all stays as it is.
        """
        if self._daemon is not None:
            raise BundleError("ION carries the bundles: its contacts are set there, with ionadmin")
        if override is ContactOverride.BY_PLAN:
            plan = self._read_plan()
            self._agent.set_plan(plan)
        self._agent.override(node, override)
        match override:
            case ContactOverride.UP:
                return f"the way is held open by the operator until {BY_PLAN}"
            case ContactOverride.DOWN:
                return f"the way is held closed by the operator until {BY_PLAN}"
            case ContactOverride.BY_PLAN if plan is None:
                return "the way is open, for there is no plan"
            case ContactOverride.BY_PLAN:
                return "the way is as the plan says, which was read again"
            case _:
                assert_never(override)


DTN_QUEUED: Final = "DTN_QUEUED"
DTN_OLDEST: Final = "DTN_OLDEST"
ROOM: Final = "DTN_ROOM"
ABOARD_QUEUED: Final = "DTN_ABOARD_QUEUED"
ABOARD_UNREAD: Final = "DTN_ABOARD_UNREAD"
ABOARD_REFUSED: Final = "DTN_ABOARD_REFUSED"
ABOARD_NEXT_CONTACT: Final = "DTN_ABOARD_NEXT_CONTACT"
ABOARD_LAST_HEARD: Final = "DTN_ABOARD_LAST_HEARD"
ABOARD_OLDEST: Final = "DTN_ABOARD_OLDEST"

_OVERRIDES: Final = {
    ContactOverride.UP: 1.0,
    ContactOverride.DOWN: -1.0,
    ContactOverride.BY_PLAN: 0.0,
}

LINK_PARAMETERS: Final = tuple(
    ParameterDefinition(
        name=name,
        description=description,
        type=AttributeType.DOUBLE,
        unit=unit,
        writable=False,
    )
    for name, description, unit in (
        (DTN_QUEUED, "Bundles that wait at the orbiter", None),
        (DTN_OLDEST, "How long the oldest command has waited there", "s"),
        (NEXT_CONTACT, "Time until the next contact, 0 during one", "s"),
        (LAST_HEARD, "Time since something was heard of the rover", "s"),
        (OVERRIDE, "What the operator says of contact: 1 up, -1 down, 0 as planned", None),
        (ROOM, "Octets that the orbiter's store still takes", "B"),
        (ABOARD_QUEUED, "Bundles that wait at the rover, as it said last", None),
        (ABOARD_UNREAD, "Commands there that nobody has taken yet, as it said last", None),
        (ABOARD_REFUSED, "Messages that its end of the link refused until then", None),
        (ABOARD_NEXT_CONTACT, "Time from then until a contact begins by its plan", "s"),
        (ABOARD_LAST_HEARD, "Time until then since it heard of the orbiter", "s"),
        (ABOARD_OLDEST, "How long the oldest bundle had waited then", "s"),
    )
)
_ABOARD: Final = (
    *(ABOARD_QUEUED, ABOARD_UNREAD, ABOARD_REFUSED),
    *(ABOARD_NEXT_CONTACT, ABOARD_LAST_HEARD, ABOARD_OLDEST),
)


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """The way to a rover at a moment; infinity for what is not known or not planned.

    Attributes:
        queued: how many bundles wait for it.
        oldest_s: how long the oldest command has waited.
        contact: whether something can be sent now.
        override: what the operator says of that.
        next_contact_s: until a contact begins, 0 during one.
        last_heard_s: since something was heard of the rover.
        room_octets: how much the store here still takes.
    """

    queued: int
    oldest_s: float
    contact: bool
    override: ContactOverride
    next_contact_s: float
    last_heard_s: float
    room_octets: int

    def values(self, utc_s: float) -> tuple[ParameterValue, ...]:
        """Return it as parameters for the wire."""
        figures = (
            (DTN_QUEUED, float(self.queued)),
            (DTN_OLDEST, self.oldest_s),
            (NEXT_CONTACT, self.next_contact_s),
            (LAST_HEARD, self.last_heard_s),
            (OVERRIDE, _OVERRIDES[self.override]),
            (ROOM, float(self.room_octets)),
        )
        return tuple(_value(name, figure, utc_s) for name, figure in figures)


def aboard_values(health: LinkHealth | None) -> tuple[ParameterValue, ...]:
    """Return what the rover's end of the link said of itself, as parameters for the wire."""
    if health is None:
        return tuple(_value(name, inf, 0.0) for name in _ABOARD)
    next_utc_s, heard_s = health.next_contact_utc_s, health.last_heard_s
    figures = (
        float(health.queued),
        float(health.unread),
        float(health.refused),
        inf if next_utc_s is None else next_utc_s - health.utc_s,
        inf if heard_s is None else heard_s,
        health.oldest_s,
    )
    return tuple(_value(*each, health.utc_s) for each in zip(_ABOARD, figures, strict=True))


def link_status(
    health: NeighbourHealth, room_octets: int, oldest_utc_s: float | None, utc_s: float
) -> LinkStatus:
    """Return the outlook that an agent's figures make."""
    return LinkStatus(
        queued=health.queued,
        oldest_s=0.0 if oldest_utc_s is None else max(0.0, utc_s - oldest_utc_s),
        contact=health.contact,
        override=health.override,
        next_contact_s=0.0 if health.contact else health.next_contact_utc_s - utc_s,
        last_heard_s=inf if health.last_heard_s is None else health.last_heard_s,
        room_octets=room_octets,
    )


class LinkMonitor:
    """Tells when a contact opens or closes, and when what waits grows old.

    Args:
        old_after_s: what waits for longer is old.
        tell: called with each change.
    """

    def __init__(
        self, old_after_s: float, tell: Callable[[Severity, str, tuple[Figure, ...]], None]
    ) -> None:
        self._old_after_s = old_after_s
        self._tell = tell
        self._seen: tuple[bool, ContactOverride] | None = None
        self._old = False

    def look(self, outlook: LinkStatus, utc_s: float) -> None:
        """Compare with what was seen last."""
        if (seen := (outlook.contact, outlook.override)) != self._seen:
            self._seen = seen
            self._say(Severity.INFORMATIONAL, _contact(outlook, utc_s), outlook)
        old = outlook.oldest_s > self._old_after_s
        if old and not self._old:
            until = describe_next_contact(outlook.next_contact_s, utc_s)
            text = f"a command has waited for {outlook.oldest_s:.0f} s; {until}"
            self._say(Severity.WARNING, text, outlook)
        self._old = old

    def _say(self, severity: Severity, text: str, outlook: LinkStatus) -> None:
        figures = (
            Figure("queued", float(outlook.queued)),
            Figure("oldest", outlook.oldest_s, "s"),
        )
        self._tell(severity, text, figures)


def _contact(outlook: LinkStatus, utc_s: float) -> str:
    match outlook.override:
        case ContactOverride.DOWN:
            return f"no contact: held closed by the operator until {BY_PLAN}"
        case ContactOverride.UP if outlook.contact:
            return f"contact: held open by the operator until {BY_PLAN}"
        case _:
            return "contact" if outlook.contact else _dark(outlook.next_contact_s, utc_s)


def _dark(left_s: float, utc_s: float) -> str:
    if isinf(left_s):
        return "no contact, and none is planned"
    return f"no contact until {datetime.fromtimestamp(utc_s + left_s, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _value(name: str, figure: float, utc_s: float) -> ParameterValue:
    known = not isinf(figure)
    return ParameterValue(
        name=name,
        timestamp=to_ns(utc_s),
        validity=Validity.VALID if known else Validity.INVALID,
        value=Typed(AttributeType.DOUBLE, figure) if known else None,
    )
