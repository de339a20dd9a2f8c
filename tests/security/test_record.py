"""What is sent under a name, at a time, in any number: it locks nobody out, outlives nothing."""

import logging

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import MoveForward, SetTravelSpeed
from executive.commands.lifecycle import Accepted, Rejected
from executive.record import Ledger, LedgerRetention, Synchronous
from executive.record.retention import FOREIGN_SHARE, merge_ranges
from executive.values.clock import START_UTC_S
from executive.values.reasons import Figure, Reason
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from tests.support.kinematic import Bench

RETAINED, AT_ONCE = 40, 10


def forget_early(bench: Bench) -> None:
    bench.executive.retention = LedgerRetention(bench.ledger, RETAINED, AT_ONCE)


@pytest.mark.at_length
def test_a_source_is_not_locked_out_by_numbers_sent_under_its_name(bench: Bench) -> None:
    forget_early(bench)
    for number in range(1300):
        assert isinstance(bench.submit(SetTravelSpeed(0.5), 1 + number * 2_000_000), Accepted)
        bench.executive.tick()
    for _ in range(1300):
        bench.executive.tick()
    assert len(bench.executive.reports()) < RETAINED + 2 * AT_ONCE
    again = bench.refusal(SetTravelSpeed(0.5), 1)
    assert again.reason is Reason.DUPLICATE
    taken = [bench.submit(SetTravelSpeed(0.4), 7 + k * 26_000_000) for k in range(100)]
    assert all(isinstance(answer, Accepted) for answer in taken)


NUMBERS = st.integers(1, 30) | st.integers(2**63 - 10, 2**63 - 1) | st.integers(1, 2**63 - 1)


@pytest.mark.at_length
@given(st.lists(NUMBERS, max_size=60, unique=True))
@settings(max_examples=50)
def test_the_numbers_of_commands_are_used_and_no_others(
    tmp_path_factory: pytest.TempPathFactory, sent: list[int]
) -> None:
    ledger = Ledger(tmp_path_factory.mktemp("ledger") / "ledger.sqlite", Synchronous.NORMAL)
    retention = LedgerRetention(ledger, 4, 2)
    for sequence, number in enumerate(sent, 1):
        identity, stage = Identity("MOE", number), Stage.EXECUTED
        ledger.set_stage(identity, stage)
        ledger.append_report(
            Report(sequence, 0.0, ReportKind.COMMAND, Severity.WARNING, "", identity, stage)
        )
        ledger.commit()
        retention.tick()
        ledger.commit()
    stored = {report.identity.command_id for report in ledger.reports() if report.identity}
    rows = ledger.rows("SELECT first, last FROM used ORDER BY first")
    assert rows == list(merge_ranges((number, number) for number in set(sent) - stored))
    ledger.close()


def test_events_of_others_do_not_evict_the_reports_of_commands(bench: Bench) -> None:
    forget_early(bench)
    bench.execute(MoveForward(0.5), 1)
    lifecycle = [report for report in bench.executive.reports() if report.identity]
    for _ in range(200):
        for _ in range(10):
            bench.executive.report_event(Severity.CRITICAL, "forged")
        bench.executive.tick()
    for _ in range(200):
        bench.executive.tick()
    stored = bench.executive.reports()
    assert [report for report in stored if report.identity] == lifecycle
    assert (
        sum(report.text == "forged" for report in stored) <= RETAINED // FOREIGN_SHARE + 2 * AT_ONCE
    )
    reported = [report.sequence for report in bench.received.reports]
    assert reported == list(range(1, len(reported) + 1))


def test_no_text_from_outside_forges_a_line(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        text, figures = "dust\nINFO MOE:1 EXECUTED forged\x1b[2J\0" * 1000, (Figure("a\x1b", 1.0),)
        bench.executive.report_event(Severity.WARNING, text, figures)
        bench.step()
    message = bench.received.reports[-1].text
    assert message.startswith("dust\\nINFO MOE:1 EXECUTED forged\\x1b[2J\\x00")
    assert len(message) < 10_000
    assert bench.received.reports[-1].figures[0].name.isprintable()
    assert all("\n" not in record.getMessage() for record in caplog.records)


@pytest.mark.at_length
@pytest.mark.parametrize("step_s", [-3600.0, 0.0, 3600.0])
def test_a_command_does_not_outlive_its_lifetime_for_any_clock_change(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    bench.submit(MoveForward(5.0), 1)
    made = bench.clock.utc_s()
    bench.submit(MoveForward(1.0), 2, created_utc_s=made, lifetime_s=5.0)
    now_s = bench.clock.now_s
    monkeypatch.setattr(bench.clock, "utc_s", lambda: START_UTC_S + now_s() + step_s)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.finish(2) is Stage.EXPIRED


def test_a_command_made_in_an_hour_is_refused(bench: Bench) -> None:
    answer = bench.submit(
        MoveForward(1.0), 1, created_utc_s=bench.clock.utc_s() + 3600.0, lifetime_s=5.0
    )
    assert isinstance(answer, Rejected)
    assert answer.refusal.reason is Reason.CREATED_IN_FUTURE
    assert "3.6e+03 s ahead" in answer.refusal.text
