"""`RelayLinkStatus` of the link to a rover: its parameters, and notifications of its changes."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final

from adapters.bundle import Contact, ContactOverride, ContactPlan, NeighbourHealth, Traffic
from adapters.mal import AttributeType, TypedAttribute
from adapters.mops import LinkHealth
from adapters.mrs.ground import (
    DTN_OLDEST_AGE,
    DTN_QUEUED,
    LAST_RECEIVED,
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
"""First word of the actions that the orbiter executes itself."""
BY_PLAN: Final = f"{CONTACT} PLAN"
"""Action that ends an override."""


_OVERRIDES: Final = {
    ContactOverride.UP: 1.0,
    ContactOverride.DOWN: -1.0,
    ContactOverride.BY_PLAN: 0.0,
}
_HERE: Final = (
    (DTN_QUEUED, "Bundles queued at the orbiter", None),
    (DTN_OLDEST_AGE, "Maximum waiting time of the commands there", "s"),
    (NEXT_CONTACT, "Time until the next contact, 0 during one", "s"),
    (LAST_RECEIVED, "Time since the last reception from the rover", "s"),
    (OVERRIDE, "Contact override of the operator: 1 up, -1 down, 0 as planned", None),
    ("DTN_FREE_OCTETS", "Free space of the orbiter's store in octets", "B"),
    ("DTN_QUEUED_OCTETS", "Octets of the bundles queued at the orbiter", "B"),
    ("DTN_SENT", "Transmissions of bundles to the rover since the orbiter's start", None),
    ("DTN_ACKNOWLEDGED", "Bundles acknowledged by the rover's end since then", None),
    ("DTN_RETRANSMITTED", "Segments and bundles retransmitted since then", None),
    ("DTN_EXPIRED", "Bundles for the rover that expired at the orbiter since then", None),
    ("DTN_RECEIVED", "Bundles received from the rover since then", None),
    ("DTN_ROUND_TRIP", "Latest round-trip time to the rover's end", "s"),
)
_PLANNED: Final = (
    ("DTN_CONTACTS_UP", "Planned contacts from the orbiter to the rover, BEGIN/END in UTC", None),
    ("DTN_CONTACTS_DOWN", "Planned contacts from the rover to the orbiter, BEGIN/END in UTC", None),
)
_ABOARD: Final = (
    ("DTN_ABOARD_QUEUED", "Bundles queued at the rover, by its last report", None),
    ("DTN_ABOARD_UNDELIVERED", "Commands not yet delivered there, by its last report", None),
    ("DTN_ABOARD_REFUSED", "Messages that its end of the link refused until then", None),
    ("DTN_ABOARD_NEXT_CONTACT", "Time from then until the next contact of its plan", "s"),
    ("DTN_ABOARD_LAST_RECEIVED", "Time until then since its last reception from the orbiter", "s"),
    ("DTN_ABOARD_OLDEST_AGE", "Maximum waiting time of the bundles there then", "s"),
    ("DTN_ABOARD_CONTACT", "Whether it could send to the orbiter then: 1 or 0", None),
    ("DTN_ABOARD_QUEUED_OCTETS", "Octets of the bundles queued there then", "B"),
    ("DTN_ABOARD_SENT", "Transmissions of bundles until then since its start", None),
    ("DTN_ABOARD_ACKNOWLEDGED", "Bundles acknowledged by the orbiter until then", None),
    ("DTN_ABOARD_RETRANSMITTED", "Segments and bundles that it retransmitted until then", None),
    ("DTN_ABOARD_EXPIRED", "Bundles that expired there until then", None),
    ("DTN_ABOARD_RECEIVED", "Bundles received from the orbiter until then", None),
    ("DTN_ABOARD_ROUND_TRIP", "Latest round-trip time to the orbiter then", "s"),
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
"""Parameters of the link to a rover, the orbiter, and the onboard processes, in this order."""
_CONTACT_HISTORY_S: Final = 3600.0
"""Time during which an ended contact stays listed."""
_MAX_CONTACTS: Final = 50
_MAX_UTC_S: Final = datetime(9999, 12, 31, 23, 59, 59, tzinfo=UTC).timestamp()
"""Last second that ISO 8601 years can express; a plan may end later."""


@dataclass(frozen=True, slots=True)
class PlannedContacts:
    """Planned contacts with a rover, including those of the last hour.

    Attributes:
        up, down: contacts from the orbiter and from the rover; None without a plan.
        utc_s: time since when the list has been unchanged.
    """

    up: tuple[Contact, ...] | None
    down: tuple[Contact, ...] | None
    utc_s: float

    def values(self) -> Iterator[ParameterValue]:
        """Yield the contacts as MRS parameters: ISO 8601 intervals."""
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
    """Return the contacts to list now; `before` itself if the list is unchanged.

    Args:
        plan: the plan; None for permanent contact.
        orbiter: node number of the orbiter.
        rover: node number of the rover.
        before: the previous list.
        utc_s: present time in seconds since 1970.
    """

    def listed(sender: int, receiver: int) -> tuple[Contact, ...] | None:
        if plan is None:
            return None
        recent = (
            contact
            for contact in plan.contacts_between(sender, receiver)
            if contact.end_utc_s > utc_s - _CONTACT_HISTORY_S
        )
        return tuple(sorted(recent, key=lambda each: each.begin_utc_s)[:_MAX_CONTACTS])

    now = PlannedContacts(listed(orbiter, rover), listed(rover, orbiter), utc_s)
    if before is not None and (before.up, before.down) == (now.up, now.down):
        return before
    return now


def _interval(contact: Contact) -> str:
    begin, end = (
        f"{datetime.fromtimestamp(min(utc_s, _MAX_UTC_S), UTC):%Y-%m-%dT%H:%M:%SZ}"
        for utc_s in (contact.begin_utc_s, contact.end_utc_s)
    )
    return f"{begin}/{end}"


@dataclass(frozen=True, slots=True)
class RelayLinkStatus:
    """State of the link to a rover; infinity for values that are unknown or not planned.

    Attributes:
        queued: bundles queued for it.
        max_age_s: maximum waiting time of its commands.
        contact: whether sending is possible now.
        override: the operator's override of the contact plan.
        next_contact_s: time until the next contact, 0 during one.
        last_received_s: time since the last reception from the rover.
        store_free_octets: free space of the orbiter's store.
        queued_octets: octets of the bundles queued for it.
        traffic: traffic counters of the link.
        planned: the planned contacts.
    """

    queued: int
    max_age_s: float
    contact: bool
    override: ContactOverride
    next_contact_s: float
    last_received_s: float
    store_free_octets: int
    queued_octets: int
    traffic: Traffic
    planned: PlannedContacts

    def values(self, utc_s: float) -> tuple[ParameterValue, ...]:
        """Return the state as MRS parameters."""
        figures = (
            float(self.queued),
            self.max_age_s,
            self.next_contact_s,
            self.last_received_s,
            _OVERRIDES[self.override],
            float(self.store_free_octets),
            float(self.queued_octets),
            *_figures(self.traffic),
        )
        return _values(_HERE, figures, utc_s)


def aboard_values(health: LinkHealth | None) -> tuple[ParameterValue, ...]:
    """Return the last health report of the rover's end of the link, as MRS parameters."""
    if health is None:
        return _values(_ABOARD, (inf,) * len(_ABOARD), 0.0)
    next_utc_s, received_s = health.next_contact_utc_s, health.last_received_s
    figures = (
        float(health.queued),
        float(health.undelivered),
        float(health.refused),
        inf if next_utc_s is None else next_utc_s - health.utc_s,
        inf if received_s is None else received_s,
        health.oldest_age_s,
        inf if health.contact is None else float(health.contact),
        inf if health.queued_octets is None else float(health.queued_octets),
        *_figures(health),
    )
    return _values(_ABOARD, figures, health.utc_s)


def _figures(traffic: Traffic | LinkHealth) -> tuple[float, ...]:
    """Return the traffic counters of a link, in the order of its parameters."""
    counted = traffic.sent, traffic.acknowledged, traffic.retransmitted, traffic.expired
    figures = (*counted, traffic.received, traffic.round_trip_s)
    return tuple(inf if figure is None else float(figure) for figure in figures)


def measure_link(
    health: NeighbourHealth,
    free_octets: int,
    queued_octets: int,
    earliest_utc_s: float | None,
    planned: PlannedContacts,
    utc_s: float,
) -> RelayLinkStatus:
    """Return the link state computed from an agent's health."""
    return RelayLinkStatus(
        queued=health.queued,
        max_age_s=0.0 if earliest_utc_s is None else max(0.0, utc_s - earliest_utc_s),
        contact=health.contact,
        override=health.override,
        next_contact_s=0.0 if health.contact else health.next_contact_utc_s - utc_s,
        last_received_s=inf if health.last_received_s is None else health.last_received_s,
        store_free_octets=free_octets,
        queued_octets=queued_octets,
        traffic=health.traffic,
        planned=planned,
    )


class LinkMonitor:
    """Notifies when a contact begins or ends, and when a command has waited too long.

    Args:
        queue_warning_s: a command that waits for longer counts as old.
        notify: called with each change.
    """

    def __init__(
        self, queue_warning_s: float, notify: Callable[[Severity, str, tuple[Figure, ...]], None]
    ) -> None:
        self._queue_warning_s = queue_warning_s
        self._notify = notify
        self._last: tuple[bool, ContactOverride] | None = None
        self._old = False

    def update(self, status: RelayLinkStatus, utc_s: float) -> None:
        """Compare with the previous state, and notify of changes."""
        if (seen := (status.contact, status.override)) != self._last:
            self._last = seen
            self._notify_with_figures(Severity.INFORMATIONAL, _contact(status, utc_s), status)
        old = status.max_age_s > self._queue_warning_s
        if old and not self._old:
            until = describe_next_contact(status.next_contact_s, utc_s)
            text = f"a command has waited for {status.max_age_s:.0f} s; {until}"
            self._notify_with_figures(Severity.WARNING, text, status)
        self._old = old

    def _notify_with_figures(self, severity: Severity, text: str, status: RelayLinkStatus) -> None:
        figures = (Figure("queued", float(status.queued)), Figure("oldest", status.max_age_s, "s"))
        self._notify(severity, text, figures)


def _contact(status: RelayLinkStatus, utc_s: float) -> str:
    match status.override:
        case ContactOverride.DOWN:
            return f"no contact: held closed by the operator until {BY_PLAN}"
        case ContactOverride.UP if status.contact:
            return f"contact: held open by the operator until {BY_PLAN}"
        case _:
            return "contact" if status.contact else _no_contact_text(status.next_contact_s, utc_s)


def _no_contact_text(left_s: float, utc_s: float) -> str:
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
