"""Findings about plans."""

from sim.scenario.expectations import PlanIs
from sim.scenario.finding import NEVER, Finding
from sim.scenario.record import ALMOST_S, Record


def plan(expected: PlanIs, record: Record) -> Finding:
    """Compare where a plan was in its life at a time."""
    subject, wanted = f"plan {expected.plan}", f"{expected.status.name} {expected.when}"
    time_s = record.moment(expected)
    if time_s is None:
        return Finding(subject, wanted, NEVER, False)
    until_utc_s = record.start_utc_s + time_s + ALMOST_S
    told = [
        update
        for update in record.plans
        if update.plan_id == expected.plan and update.utc_s <= until_utc_s
    ]
    if not told:
        return Finding(subject, wanted, "nothing told", False)
    last = told[-1]
    seen = f"{last.status.name}, {last.done} of {last.total} leaves"
    return Finding(subject, wanted, seen, last.status is expected.status)
