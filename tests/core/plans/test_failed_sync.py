"""A commit whose sync fails is in the file, and the process that sees it next acts on it once."""

import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from executive.commands import Resume, ResumePlan
from executive.record import Ledger, LedgerError
from executive.record.writer import Batch, WriterState
from executive.values.reports import PlanStatus, Stage
from tests.support.examples import in_full
from tests.support.plans import PlanBench, plan, xml

STEPS = "".join(f'<moveForward distance="{0.1 * n:.1f}" deadline_s="60"/>' for n in (1, 2, 3))
FEW = (0, 3, 5, 6, 9, 10, 12, 15)
"""Half of the cases below, with each pair of a plan's kind, time of the failure and delay."""


class FailedSync:
    """A writer whose commits arrive in the file, though their syncs fail."""

    def __init__(self, bench: PlanBench) -> None:
        self._ledger = bench.ledger
        self._state = WriterState(bench.ledger.state.durable)

    def put(self, batch: Batch) -> None:
        if self._state.error is None:
            self._ledger.transact(batch.statements)
            self._state = WriterState(self._state.durable, LedgerError("disk I/O error"))
        if batch.latch is not None:
            batch.latch.store()

    def poll(self) -> WriterState:
        return self._state

    def close(self) -> None:
        pass

    def abandon(self) -> None:
        pass


def test_a_start_syncs_the_log_that_it_finds(tmp_path: Path) -> None:
    left, synced = tmp_path / "left", tmp_path / "synced"
    for folder in (left, synced):
        folder.mkdir()
    with PlanBench(tmp_path) as bench:
        bench.go(plan(f"<Sequence>{STEPS}</Sequence>"))
        reports = bench.ledger.reports()
        for path in tmp_path.glob("ledger.sqlite*"):
            shutil.copy(path, left / path.name)
    found = Ledger(left / "ledger.sqlite")
    shutil.copy(left / "ledger.sqlite", synced)
    found.abandon()
    file = Ledger(synced / "ledger.sqlite")
    assert file.reports() == reports != []
    file.abandon()


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("resumes", "ticks", "more"),
    [
        case if index in FEW else in_full(*case)
        for index, case in enumerate(product((False, True), (1, 3, 20, 40), (0, 3)))
    ],
)
def test_a_plan_continues_over_a_failed_sync(
    tmp_path: Path, resumes: bool, ticks: int, more: int
) -> None:
    content = xml(f"<Sequence>{STEPS}</Sequence>")
    if resumes:
        content = content.replace(b"<root ", b'<root after_restart="resume" ')
    with PlanBench(tmp_path) as bench:
        bench.go(replace(plan(""), content=content))
        for _ in range(ticks):
            bench.step()
        bench.ledger.writer = FailedSync(bench)
        while bench.ledger.state.error is None:
            bench.step()
        for _ in range(more):
            bench.step()
        bench.crash()
        bench.run(1.0)
        if bench.status().status is not PlanStatus.COMPLETED:
            bench.numbered(Resume())
            bench.step()
            if bench.status().status is PlanStatus.SUSPENDED:
                bench.request(ResumePlan("survey"))
        assert bench.until(PlanStatus.COMPLETED) is PlanStatus.COMPLETED
        reports = bench.ledger.reports(1, count=10_000)
        assert [each.sequence for each in reports] == list(range(1, len(reports) + 1))
        requests = bench.ledger.rows(
            "SELECT request, count(*) FROM commands JOIN stages USING (source, command_id)"
            " WHERE source = 'plan:survey' AND stage = ? GROUP BY request",
            (Stage.EXECUTED.value,),
        )
        assert [count for _, count in requests] == [1, 1, 1]
