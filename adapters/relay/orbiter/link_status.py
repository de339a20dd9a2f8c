"""The link to a rover: its parameters, and notifications of its changes."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final

from adapters.bundle import Contact, ContactOverride, ContactPlan, NeighbourHealth, Traffic
from adapters.mal import AttributeType, TypedAttribute
from adapters.mops import LinkHealth
from adapters.mrs.ground import (
    DTN_OLDEST,
    DTN_QUEUED,
    LAST_HEARD,
    NEXT_CONTACT,
    OVERRIDE,
    describe_next_contact,
)
from adapters.mrs.spec import (
    ABOARD_HOUSEKEEPING,
    ORBITER_HOUSEKEEPING,
    ParameterDefinition,
    ParameterValue,
    Validity,
    figure_value,
    to_ns,
)
from executive.values.reasons import Figure
from executive.values.reports import Severity

CONTACT: Final = "CONTACT"
"""First word of the actions that the orbiter carries out itself."""
BY_PLAN: Final = f"{CONTACT} PLAN"
"""The action that ends an override."""


_OVERRIDES: Final = {
    ContactOverride.UP: 1.0,
    ContactOverride.DOWN: -1.0,
    ContactOverride.BY_PLAN: 0.0,
}
_HERE: Final = (
    (DTN_QUEUED, "Bundles that wait at the orbiter", None),
    (DTN_OLDEST, "How long the oldest command has waited there", "s"),
    (NEXT_CONTACT, "Time until the next contact, 0 during one", "s"),
    (LAST_HEARD, "Time since something was heard of the rover", "s"),
    (OVERRIDE, "What the operator says of contact: 1 up, -1 down, 0 as planned", None),
    ("DTN_ROOM", "Octets that the orbiter's store still takes", "B"),
    ("DTN_QUEUED_OCTETS", "Octets of the bundles that wait at the orbiter", "B"),
    ("DTN_SENT", "Bundles sent to the rover since the orbiter's start, each time they were", None),
    ("DTN_ACKNOWLEDGED", "Bundles that the rover's end has said to have since then", None),
    ("DTN_RETRANSMITTED", "Segments and bundles that were sent once more since then", None),
    ("DTN_EXPIRED", "Bundles for the rover that ended there with their lifetime since then", None),
    ("DTN_RECEIVED", "Bundles that came from the rover since then", None),
    ("DTN_ROUND_TRIP", "How long the rover's end took to answer last", "s"),
)
_PLANNED: Final = (
    ("DTN_CONTACTS_UP", "Planned contacts from the orbiter to the rover, BEGIN/END in UTC", None),
    ("DTN_CONTACTS_DOWN", "Planned contacts from the rover to the orbiter, BEGIN/END in UTC", None),
)
_ABOARD: Final = (
    ("DTN_ABOARD_QUEUED", "Bundles that wait at the rover, as it said last", None),
    ("DTN_ABOARD_UNREAD", "Commands there that nobody has taken yet, as it said last", None),
    ("DTN_ABOARD_REFUSED", "Messages that its end of the link refused until then", None),
    ("DTN_ABOARD_NEXT_CONTACT", "Time from then until a contact begins by its plan", "s"),
    ("DTN_ABOARD_LAST_HEARD", "Time until then since it heard of the orbiter", "s"),
    ("DTN_ABOARD_OLDEST", "How long the oldest bundle had waited then", "s"),
    ("DTN_ABOARD_CONTACT", "Whether it could send to the orbiter then: 1 or 0", None),
    ("DTN_ABOARD_QUEUED_OCTETS", "Octets of the bundles that waited there then", "B"),
    ("DTN_ABOARD_SENT", "Bundles that it had sent since its start, each time they were", None),
    ("DTN_ABOARD_ACKNOWLEDGED", "Bundles that the orbiter had said to have until then", None),
    ("DTN_ABOARD_RETRANSMITTED", "Segments and bundles it had sent once more until then", None),
    ("DTN_ABOARD_EXPIRED", "Bundles that had ended there with their lifetime until then", None),
    ("DTN_ABOARD_RECEIVED", "Bundles that had come from the orbiter until then", None),
    ("DTN_ABOARD_ROUND_TRIP", "How long the orbiter had taken to answer last", "s"),
)


def _define(
    kind: AttributeType, rows: Sequence[tuple[str, str, str | None]]
) -> Iterator[ParameterDefinition]:
    for name, description, unit in rows:
        yield ParameterDefinition(
            name=name, description=description, type=kind, unit=unit, writable=False
        )


LINK_PARAMETERS: Final = (
    *_define(AttributeType.DOUBLE, (*_HERE, *_ABOARD)),
    *_define(AttributeType.STRING, _PLANNED),
)
ORBITER_PARAMETERS: Final = (
    *LINK_PARAMETERS,
    *(each.definition for each in (*ORBITER_HOUSEKEEPING, *ABOARD_HOUSEKEEPING)),
)
"""What is told of the link to a rover, of the orbiter and of what is aboard, in this order."""
_LISTED_S: Final = 3600.0
"""For so long a contact is listed after its end."""
_MOST_LISTED: Final = 50
_LATEST_UTC_S: Final = datetime(9999, 12, 31, 23, 59, 59, tzinfo=UTC).timestamp()
"""The end of ISO 8601's years; a plan may go beyond."""


@dataclass(frozen=True, slots=True)
class PlannedContacts:
    """The contacts with a rover that are known beforehand, those of the last hour among them.

    Attributes:
        up, down: those in which the orbiter and the rover can send; None where there is no plan.
        utc_s: since when they have been listed so.
    """

    up: tuple[Contact, ...] | None
    down: tuple[Contact, ...] | None
    utc_s: float

    def values(self) -> Iterator[ParameterValue]:
        """Yield them as MRS parameters: ISO 8601 intervals."""
        for (name, *_), contacts in zip(_PLANNED, (self.up, self.down), strict=True):
            listed = None if contacts is None else " ".join(map(_interval, contacts))
            yield ParameterValue(
                name=name,
                timestamp=to_ns(self.utc_s),
                validity=Validity.INVALID if listed is None else Validity.VALID,
                value=None if listed is None else TypedAttribute(AttributeType.STRING, listed),
            )


def list_contacts(
    plan: ContactPlan | None, orbiter: int, rover: int, before: PlannedContacts | None, utc_s: float
) -> PlannedContacts:
    """Return the contacts of a plan that are listed now, or what was listed before, if it is that.

    Args:
        plan: the plan; None for contact always.
        orbiter: number of its node.
        rover: number of its node.
        before: what was listed last.
        utc_s: the time in seconds since 1970.
    """

    def listed(sender: int, receiver: int) -> tuple[Contact, ...] | None:
        if plan is None:
            return None
        recent = (
            contact
            for contact in plan.between(sender, receiver)
            if contact.end_utc_s > utc_s - _LISTED_S
        )
        return tuple(sorted(recent, key=lambda each: each.begin_utc_s)[:_MOST_LISTED])

    now = PlannedContacts(listed(orbiter, rover), listed(rover, orbiter), utc_s)
    if before is not None and (before.up, before.down) == (now.up, now.down):
        return before
    return now


def _interval(contact: Contact) -> str:
    begin, end = (
        f"{datetime.fromtimestamp(min(utc_s, _LATEST_UTC_S), UTC):%Y-%m-%dT%H:%M:%SZ}"
        for utc_s in (contact.begin_utc_s, contact.end_utc_s)
    )
    return f"{begin}/{end}"


@dataclass(frozen=True, slots=True)
class RelayLinkStatus:
    """The link to a rover at a moment; infinity for what is not known or not planned.

    Attributes:
        queued: how many bundles wait for it.
        oldest_s: how long the oldest command has waited.
        contact: whether something can be sent now.
        override: what the operator says of that.
        next_contact_s: until a contact begins, 0 during one.
        last_heard_s: since something was heard of the rover.
        room_octets: how much the store here still takes.
        queued_octets: of the bundles that wait for it.
        traffic: what went over the link to it.
        planned: the contacts that are known beforehand.
    """

    queued: int
    oldest_s: float
    contact: bool
    override: ContactOverride
    next_contact_s: float
    last_heard_s: float
    room_octets: int
    queued_octets: int
    traffic: Traffic
    planned: PlannedContacts

    def values(self, utc_s: float) -> tuple[ParameterValue, ...]:
        """Return it as MRS parameters."""
        figures = (
            float(self.queued),
            self.oldest_s,
            self.next_contact_s,
            self.last_heard_s,
            _OVERRIDES[self.override],
            float(self.room_octets),
            float(self.queued_octets),
            *_figures(self.traffic),
        )
        return _values(_HERE, figures, utc_s)


def aboard_values(health: LinkHealth | None) -> tuple[ParameterValue, ...]:
    """Return what the rover's end of the link last said of itself, as MRS parameters."""
    if health is None:
        return _values(_ABOARD, (inf,) * len(_ABOARD), 0.0)
    next_utc_s, heard_s = health.next_contact_utc_s, health.last_heard_s
    figures = (
        float(health.queued),
        float(health.unread),
        float(health.refused),
        inf if next_utc_s is None else next_utc_s - health.utc_s,
        inf if heard_s is None else heard_s,
        health.oldest_s,
        inf if health.contact is None else float(health.contact),
        inf if health.queued_octets is None else float(health.queued_octets),
        *_figures(health),
    )
    return _values(_ABOARD, figures, health.utc_s)


def _figures(told: Traffic | LinkHealth) -> tuple[float, ...]:
    """Return what went over a link, in the order of its parameters."""
    figures = (
        *(told.sent, told.acknowledged, told.retransmitted, told.expired, told.received),
        told.round_trip_s,
    )
    return tuple(inf if figure is None else float(figure) for figure in figures)


def measure_link(
    health: NeighbourHealth,
    room_octets: int,
    queued_octets: int,
    oldest_utc_s: float | None,
    planned: PlannedContacts,
    utc_s: float,
) -> RelayLinkStatus:
    """Return the status that an agent's figures make."""
    return RelayLinkStatus(
        queued=health.queued,
        oldest_s=0.0 if oldest_utc_s is None else max(0.0, utc_s - oldest_utc_s),
        contact=health.contact,
        override=health.override,
        next_contact_s=0.0 if health.contact else health.next_contact_utc_s - utc_s,
        last_heard_s=inf if health.last_heard_s is None else health.last_heard_s,
        room_octets=room_octets,
        queued_octets=queued_octets,
        traffic=health.traffic,
        planned=planned,
    )


class LinkMonitor:
    """Notifies when a contact opens or closes, and when a command waits for too long.

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

    def look(self, status: RelayLinkStatus, utc_s: float) -> None:
        """Compare with the last look, and notify of changes."""
        if (seen := (status.contact, status.override)) != self._seen:
            self._seen = seen
            self._say(Severity.INFORMATIONAL, _contact(status, utc_s), status)
        old = status.oldest_s > self._old_after_s
        if old and not self._old:
            until = describe_next_contact(status.next_contact_s, utc_s)
            text = f"a command has waited for {status.oldest_s:.0f} s; {until}"
            self._say(Severity.WARNING, text, status)
        self._old = old

    def _say(self, severity: Severity, text: str, status: RelayLinkStatus) -> None:
        figures = (Figure("queued", float(status.queued)), Figure("oldest", status.oldest_s, "s"))
        self._tell(severity, text, figures)


def _contact(status: RelayLinkStatus, utc_s: float) -> str:
    match status.override:
        case ContactOverride.DOWN:
            return f"no contact: held closed by the operator until {BY_PLAN}"
        case ContactOverride.UP if status.contact:
            return f"contact: held open by the operator until {BY_PLAN}"
        case _:
            return "contact" if status.contact else _dark(status.next_contact_s, utc_s)


def _dark(left_s: float, utc_s: float) -> str:
    if isinf(left_s):
        return "no contact, and none is planned"
    return f"no contact until {datetime.fromtimestamp(utc_s + left_s, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _values(
    rows: Sequence[tuple[str, str, str | None]], figures: Sequence[float], utc_s: float
) -> tuple[ParameterValue, ...]:
    return tuple(
        figure_value(name, None if isinf(figure) else figure, utc_s)
        for (name, _, _), figure in zip(rows, figures, strict=True)
    )
