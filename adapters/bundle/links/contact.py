"""`ContactPlan` in NASA ION's ionadmin syntax: contact windows and ranges between nodes.

    a contact +0 +600 1 2 125000
    a range 2026/11/21-12:00:00 2026/11/22-12:00:00 1 2 3

Times are UTC or, with a plus sign, seconds after a reference that `@ 2026/11/21-12:00:00` sets.
"""

import logging
import re
from calendar import timegm
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from math import inf
from pathlib import Path
from time import strptime
from typing import Final

from adapters.bundle.codec.eid import Eid, Ipn
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.node.settings import NodeSettings
from adapters.system import OPERATING_SYSTEM, System

_TIME_FORMAT: Final = "%Y/%m/%d-%H:%M:%S"
_NUMBER: Final = re.compile(r"\d{1,18}", re.ASCII)
_TIME_SUCH_AS: Final = "time such as +60 or 2026/11/21-12:00:00"
_FIELDS: Final = {
    "contact": ("BEGIN", "END", "SENDER", "RECEIVER", "RATE"),
    "range": ("BEGIN", "END", "ONE", "OTHER", "LIGHT_TIME"),
}
_OTHER_COMMANDS: Final = frozenset("1ehimqrsvw")


_FIRST_START: Final = ".begun"
_LOG: Final = logging.getLogger(__name__)


class ContactPlanError(BundleError):
    """A text is not a contact plan; one line gives the position and the cause."""


@dataclass(frozen=True, slots=True)
class Contact:
    """An interval in which one node can send to another.

    Attributes:
        sender: number of the sending node.
        receiver: number of the receiving node.
        rate_octets_s: data rate, octets/s.
    """

    begin_utc_s: float
    end_utc_s: float
    sender: int
    receiver: int
    rate_octets_s: int


@dataclass(frozen=True, slots=True)
class LightTimeRange:
    """An interval with a constant one-way light time between two nodes."""

    begin_utc_s: float
    end_utc_s: float
    one: int
    other: int
    light_time_s: float


@dataclass(frozen=True, slots=True)
class ContactPlan:
    """All planned contacts and ranges."""

    contacts: tuple[Contact, ...] = ()
    ranges: tuple[LightTimeRange, ...] = ()

    def contact(self, sender: int, receiver: int, utc_s: float) -> Contact | None:
        """Return the contact at a time, or None; the one that ends last if several overlap."""
        there = [
            contact
            for contact in self.contacts_between(sender, receiver)
            if contact.begin_utc_s <= utc_s < contact.end_utc_s
        ]
        return max(there, key=lambda contact: contact.end_utc_s, default=None)

    def next_contact_utc_s(self, sender: int, receiver: int, utc_s: float) -> float:
        """Return the begin of the next contact after a time; infinity if none is planned."""
        begins = (contact.begin_utc_s for contact in self.contacts_between(sender, receiver))
        return min((begin for begin in begins if begin > utc_s), default=inf)

    def planned(self, sender: int, receiver: int, utc_s: float) -> bool:
        """Return whether a contact is planned at or after a time."""
        return any(utc_s < contact.end_utc_s for contact in self.contacts_between(sender, receiver))

    def light_time_s(self, sender: int, receiver: int, utc_s: float) -> float:
        """Return the one-way light time; a range applies both ways unless each way has one."""
        there = {
            (range_.one, range_.other): range_.light_time_s
            for range_ in self.ranges
            if range_.begin_utc_s <= utc_s < range_.end_utc_s
        }
        return there.get((sender, receiver), there.get((receiver, sender), 0.0))

    def contacts_between(self, sender: int, receiver: int) -> Iterator[Contact]:
        """Return the contacts from one node to another, in file order."""
        return (
            contact
            for contact in self.contacts
            if (contact.sender, contact.receiver) == (sender, receiver)
        )


def read_plan(path: Path, reference_utc_s: float) -> ContactPlan:
    """Read a contact plan from a file.

    Args:
        path: the file; other ionadmin commands in it are skipped.
        reference_utc_s: reference of relative times, until an `@` line.

    Raises:
        ContactPlanError: the file cannot be read, or a line is invalid.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ContactPlanError(f"contact plan {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ContactPlanError(f"contact plan {path}: not UTF-8") from error
    try:
        return parse_plan(text, reference_utc_s)
    except ContactPlanError as error:
        raise ContactPlanError(f"contact plan {path}: {error}") from error


def parse_plan(text: str, reference_utc_s: float) -> ContactPlan:
    """Parse a contact plan.

    Raises:
        ContactPlanError: a line is invalid.
    """
    contacts: list[Contact] = []
    ranges: list[LightTimeRange] = []
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.split("#")[0].split()
        try:
            match fields:
                case [] | [_]:
                    pass
                case ["@", *times]:
                    if len(times) > 1:
                        raise ContactPlanError(f"@ takes one {_TIME_SUCH_AS}: {' '.join(times)!r}")
                    reference_utc_s = _time_utc_s(times[0], reference_utc_s)
                case ["a", ("contact" | "range") as kind, *given]:
                    begin, end, one, other, figure = _fields(kind, given)
                    span = _span(begin, end, reference_utc_s)
                    numbers = _number(one), _number(other), _number(figure)
                    if kind == "contact":
                        contacts.append(Contact(*span, *numbers))
                    else:
                        ranges.append(LightTimeRange(*span, *numbers))
                case [command, *_] if command in _OTHER_COMMANDS:
                    pass
                case _:
                    raise ContactPlanError("neither `a contact ...` nor `a range ...`")
        except ContactPlanError as error:
            raise ContactPlanError(f"line {number}: {error}") from error
    return ContactPlan(tuple(contacts), tuple(ranges))


def _fields(kind: str, given: Sequence[str]) -> Sequence[str]:
    """Return the fields of a contact or range, without a contact's optional confidence."""
    wanted = _FIELDS[kind]
    form = f"`a {kind} {' '.join(wanted)}`"
    if missing := " ".join(wanted[len(given) :]):
        raise ContactPlanError(f"{missing} missing in {form}")
    if len(given) > len(wanted) + (kind == "contact"):
        raise ContactPlanError(f"too many fields for {form}")
    return given[: len(wanted)]


def _span(begin: str, end: str, reference_utc_s: float) -> tuple[float, float]:
    span = _time_utc_s(begin, reference_utc_s), _time_utc_s(end, reference_utc_s)
    if span[0] >= span[1]:
        raise ContactPlanError(f"{end} is not after {begin}")
    return span


def _time_utc_s(text: str, reference_utc_s: float) -> float:
    if text.startswith("+"):
        return reference_utc_s + _number(text[1:])
    try:
        return float(timegm(strptime(text, _TIME_FORMAT)))
    except ValueError as error:
        raise ContactPlanError(f"not a {_TIME_SUCH_AS}: {text!r}") from error


def _number(text: str) -> int:
    if not _NUMBER.fullmatch(text):
        raise ContactPlanError(f"not a whole number: {text!r}")
    return int(text)


class ContactOverride(Enum):
    """Operator's override of the contact plan for a link."""

    BY_PLAN = "by plan"
    UP = "up"
    DOWN = "down"


@dataclass(frozen=True, slots=True)
class ContactState:
    """State of contact with a neighbour.

    Attributes:
        contact: whether sending is possible.
        light_time_s: one-way light time.
        rate_octets_s: data rate in octets/s, or infinity.
        next_contact_utc_s: begin of the next planned contact; infinity if none is planned, or if
            the operator has closed the link.
    """

    contact: bool
    light_time_s: float
    rate_octets_s: float
    next_contact_utc_s: float


class ContactGate:
    """Determines the state of contact with a neighbour; without a plan contact is permanent.

    Attributes:
        override: the operator's override.
    """

    def __init__(
        self, own: Eid, neighbour: Eid, plan: ContactPlan | None, utc_s: Callable[[], float]
    ) -> None:
        self.override = ContactOverride.BY_PLAN
        self.plan = plan
        self._nodes = (
            (own.node, neighbour.node)
            if isinstance(own, Ipn) and isinstance(neighbour, Ipn)
            else None
        )
        self._utc_s = utc_s

    def state(self) -> ContactState:
        """Return the present state of contact. Plans do not cover nodes without a number."""
        down, up = self.override is ContactOverride.DOWN, self.override is ContactOverride.UP
        if self.plan is None or self._nodes is None:
            return ContactState(not down, 0.0, inf, inf)
        utc_s = self._utc_s()
        contact = self.plan.contact(*self._nodes, utc_s)
        return ContactState(
            up or (contact is not None and not down),
            self.plan.light_time_s(*self._nodes, utc_s),
            contact.rate_octets_s or inf if contact else inf,
            inf if down else self.plan.next_contact_utc_s(*self._nodes, utc_s),
        )


def load_contact_plan(
    settings_file: Path,
    name: str | None,
    data: Path,
    node: NodeSettings,
    system: System = OPERATING_SYSTEM,
) -> ContactPlan | None:
    """Return the contact plan that a settings file names; warn of neighbours without contact.

    Relative times count from the first start with this plan, until the plan changes.

    Args:
        settings_file: the settings file; the plan's path is relative to it.
        name: file name of the plan; None for no plan.
        data: folder that stores the first start, under the name of the settings file.
        node: settings of the agent that follows the plan.
        system: the clock, and the disk.

    Raises:
        ContactPlanError: the plan cannot be read.
        BundleError: the first start cannot be stored.
    """
    if name is None:
        return None
    path, now_s = settings_file.parent / name, system.utc_s()
    read_plan(path, now_s)
    start_file = data / f"{settings_file.stem}{_FIRST_START}"
    plan = read_plan(path, _first_start_utc_s(path.read_bytes(), start_file, system))
    for sender, receiver in _never_open(plan, node, now_s):
        _LOG.warning(
            "contact plan %s: no further contact is planned from node %d to node %d;"
            " `a contact BEGIN END %d %d RATE` plans one",
            *(path, sender, receiver, sender, receiver),
        )
    return plan


def _never_open(plan: ContactPlan, node: NodeSettings, now_s: float) -> Iterator[tuple[int, int]]:
    """Yield (sender, receiver) of each direction without a contact from now on."""
    for neighbour in node.neighbours:
        hop = neighbour.next_hop
        if isinstance(node.node, Ipn) and isinstance(hop, Ipn):
            own, other = node.node.node, hop.node
            directions = ((own, other), (other, own))
            yield from (each for each in directions if not plan.planned(*each, now_s))


def _first_start_utc_s(plan: bytes, saved: Path, system: System) -> float:
    """Return the time of a plan's first use, stored in a file together with the plan."""
    if saved.is_file():
        first, _, known = saved.read_bytes().partition(b"\n")
        with suppress(ValueError):
            if known == plan:
                return datetime.fromisoformat(first.decode()).timestamp()
    now_s = system.utc_s()
    first = datetime.fromtimestamp(now_s, UTC).isoformat().encode()
    try:
        system.replace(saved, first + b"\n" + plan)
    except OSError as error:
        raise BundleError(
            f"{saved.parent} cannot be written: {error.strerror}; free disk space, or choose"
            " another"
            " folder with --data"
        ) from error
    return now_s
