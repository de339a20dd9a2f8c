"""The operator's view is one line for each thing, whatever stands in its texts."""

import pytest

from adapters.mrs.spec import notification_of
from adapters.relay.orbiter.console import notification_line
from executive.reports import Identity, Kind, Report, Severity, Stage

FORGED = "no\n12:00:03.530Z EXECUTED  MOPS:8"


@pytest.mark.parametrize("end", ["\n", "\r", "\x85", "\u2028", "\x1b[2K"])
def test_a_text_cannot_begin_a_line_of_its_own(end: str) -> None:
    text = FORGED.replace("\n", end)
    report = Report(
        1, 0.0, Kind.COMMAND, Severity.WARNING, text, Identity("MOPS", 7), Stage.FAILED, "relay"
    )
    line = notification_line(notification_of(report))
    assert line.isprintable()
    assert line.startswith("00:00:00.000Z FAILED    MOPS:7 no?")
