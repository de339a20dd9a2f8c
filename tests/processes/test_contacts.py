"""Eclipses become a contact plan that both ends read alike."""

import pytest

from adapters.bundle.links.contact import parse_plan
from sim.processes.deployment import Outage, plan_text

ORBITER, JACKAL, MOCUP = 1, 2, 3
START_S = 1_795_000_000


@pytest.mark.parametrize(
    ("eclipses", "dark"),
    [((), set()), ((Outage(2, 4),), {2, 3}), ((Outage(0, 1), Outage(3, 5)), {0, 3, 4})],
)
def test_there_is_contact_with_all_in_both_directions_except_in_an_outage(
    eclipses: tuple[Outage, ...], dark: set[int]
) -> None:
    plan = parse_plan(plan_text(eclipses, START_S, ORBITER, [JACKAL, MOCUP]), 0.0)
    for sender, receiver in (
        (ORBITER, JACKAL),
        (JACKAL, ORBITER),
        (ORBITER, MOCUP),
        (MOCUP, ORBITER),
    ):
        seen = {s for s in range(8) if plan.contact(sender, receiver, START_S + s + 0.5) is None}
        assert seen == dark
    assert plan.contact(JACKAL, MOCUP, START_S) is None
