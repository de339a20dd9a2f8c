"""What was reported of the commands of a scenario, to compare links and runs."""

from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import Stage
from sim.scenario.record import Record

Lifecycles = dict[str, list[tuple[Stage | None, Reason | UnknownReason | None]]]


def lifecycles(record: Record) -> Lifecycles:
    """Return what was reported of each command."""
    labels = dict.fromkeys(sent.label for sent in record.sendings)
    return {
        label: [(report.stage, report.reason) for report in record.reports_of(label)]
        for label in labels
    }
