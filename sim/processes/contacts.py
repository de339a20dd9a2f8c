"""Contacts with rovers, as a contact plan in ION's syntax (`adapters.bundle`)."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

LAST_S: Final = 86_400
"""End of the plan, longer than any run here."""
RATE_OCTETS_S: Final = 125_000


@dataclass(frozen=True, slots=True)
class Outage:
    """A time without contact, in whole seconds after a reference, as in contact plans."""

    begin_s: int
    end_s: int


def plan_text(
    eclipses: Sequence[Outage], start_utc_s: int, orbiter: int, rovers: Sequence[int]
) -> str:
    """Return a contact plan with contact in both directions outside of outages."""
    reference = time.strftime("@ %Y/%m/%d-%H:%M:%S", time.gmtime(start_utc_s))
    lines = [
        f"a contact +{begin_s} +{end_s} {sender} {receiver} {RATE_OCTETS_S}"
        for begin_s, end_s in _contacts(eclipses)
        for rover in rovers
        for sender, receiver in ((orbiter, rover), (rover, orbiter))
    ]
    return "\n".join([reference, *lines]) + "\n"


def _contacts(eclipses: Sequence[Outage]) -> Iterator[tuple[int, int]]:
    begin_s = 0
    for eclipse in (*eclipses, Outage(LAST_S, LAST_S)):
        if begin_s < eclipse.begin_s:
            yield begin_s, eclipse.begin_s
        begin_s = eclipse.end_s
