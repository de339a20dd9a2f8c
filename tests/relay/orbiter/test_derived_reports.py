from dataclasses import replace
from itertools import pairwise

import pytest

from adapters.relay.orbiter.report_ledger import with_implied_stages
from executive.commands.lifecycle import EDGES
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

REPORT = Report(
    0, 5.0, ReportKind.COMMAND, Severity.WARNING, "why", Identity("MOE", 1), Stage.STARTED
)
LEGAL = {(edge.source, edge.target) for edge in EDGES}


def at(stage: Stage) -> Report:
    return replace(REPORT, stage=stage)


def stages(report: Report, last: Report | None) -> list[str]:
    return [each.stage.name for each in with_implied_stages(report, last) if each.stage is not None]


@pytest.mark.parametrize("stage", Stage)
def test_a_life_cycle_begins_with_received_and_follows_its_edges(stage: Stage) -> None:
    lifecycle = [each.stage for each in with_implied_stages(at(stage), None)]
    assert lifecycle[0] is Stage.RECEIVED
    assert lifecycle[-1] is stage
    assert set(pairwise(lifecycle)) <= LEGAL


def test_a_published_report_is_not_published_again() -> None:
    assert stages(at(Stage.EXECUTED), at(Stage.STARTED)) == ["EXECUTED"]
    assert stages(at(Stage.CANCELLED), at(Stage.STARTED)) == ["CANCELLED"]
    assert stages(at(Stage.FAILED), at(Stage.RECEIVED)) == ["ACCEPTED", "STARTED", "FAILED"]


def test_after_the_end_nothing_is_implied() -> None:
    assert stages(at(Stage.STARTED), at(Stage.EXECUTED)) == ["STARTED"]
    assert stages(at(Stage.EXECUTED), at(Stage.EXECUTED)) == ["EXECUTED"]


def test_only_the_end_has_the_reason() -> None:
    message = replace(REPORT, stage=Stage.REJECTED, reason=Reason.OUT_OF_RANGE)
    received, rejected = with_implied_stages(message, None)
    assert (received.text, received.reason, received.severity) == ("", None, Severity.INFORMATIONAL)
    assert rejected == message


def test_an_event_implies_nothing() -> None:
    event = replace(REPORT, kind=ReportKind.EVENT, identity=None, stage=None)
    assert list(with_implied_stages(event, None)) == [event]
