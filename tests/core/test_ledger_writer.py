"""Reports, answers and new motions wait for the disk; a tick, a running motion, a stop do not."""

import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, ClassVar

import pytest

from adapters.recording.replay import replay
from adapters.recording.run_file import RunFile
from executive.commands import (
    ActivatePlan,
    Command,
    MoveForward,
    Resume,
    ResumePlan,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    SuspendPlan,
)
from executive.commands.lifecycle import Accepted, Duplicate, Rejected, SubmitResult
from executive.core.authority import AuthorityAction, AuthorityRequest, AuthorityState
from executive.core.dispatcher import MAX_UNWRITTEN_BATCHES
from executive.record import Ledger, LedgerError, StopLatch, Synchronous
from executive.values.geometry import STANDING
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Stage
from tests.core.test_ledger import command, report
from tests.support.kinematic import Bench
from tests.support.plans import plan
from tests.support.slow_disk import SlowWriter

HANG_S = 1e9


class SlowDisk:
    """Sets how long the commits of a bench take, from now on."""

    def __init__(self, bench: Bench) -> None:
        self.commit_s = 0.0
        ledger, clock = bench.ledger, bench.clock
        ledger.writer = SlowWriter(ledger, ledger.sealed, clock.now_s, lambda: self.commit_s)


@pytest.fixture
def disk(bench: Bench) -> SlowDisk:
    return SlowDisk(bench)


def submitted(bench: Bench, request: Any, number: int) -> list[SubmitResult]:
    """Send a command, and return the list that receives its answer."""
    answers: list[SubmitResult] = []
    bench.executive.submit(Command(Identity("MOE", number), request, "direct"), answers.append)
    bench.executive.serve_inbox()
    return answers


def test_answer_reports_and_motion_wait_for_the_commit(bench: Bench, disk: SlowDisk) -> None:
    disk.commit_s = 0.5
    answers = submitted(bench, MoveForward(1.0), 1)
    bench.run(0.4)
    assert (answers, bench.stages(1), bench.rover.velocity) == ([], [], STANDING)
    bench.run(0.2)
    assert isinstance(answers[0], Accepted)
    assert bench.rover.velocity != STANDING
    assert bench.finish(1) is Stage.EXECUTED


def test_a_released_motion_begins_without_a_tick(bench: Bench, disk: SlowDisk) -> None:
    disk.commit_s = 0.04
    submitted(bench, MoveForward(1.0), 1)
    assert bench.rover.velocity == STANDING
    bench.clock.advance(0.04)
    bench.executive.serve_inbox()
    assert bench.rover.velocity != STANDING


def test_a_running_motion_ends_though_the_disk_hangs(bench: Bench, disk: SlowDisk) -> None:
    bench.submit(MoveForward(1.0), 1)
    bench.run(0.5)
    before = bench.rover.pose.x_m
    disk.commit_s = HANG_S
    bench.run(20.0)
    assert bench.rover.pose.x_m - before > 0.5
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is not Stage.EXECUTED


def test_a_repeat_is_known_before_it_is_committed(bench: Bench, disk: SlowDisk) -> None:
    disk.commit_s = 0.5
    first = submitted(bench, MoveForward(0.2), 1)
    again = submitted(bench, MoveForward(0.2), 1)
    other = submitted(bench, MoveForward(0.3), 1)
    bench.run(2.0)
    assert [type(each[0]) for each in (first, again, other)] == [Accepted, Duplicate, Rejected]
    bench.finish(1)
    assert bench.rover.pose.x_m == pytest.approx(0.2, abs=0.03)


def test_a_stop_acts_at_once_and_is_answered_later(bench: Bench, disk: SlowDisk) -> None:
    bench.drive_on()
    disk.commit_s = 3.0
    answers = submitted(bench, Stop(), 2)
    assert bench.rover.velocity == STANDING
    assert answers == []
    bench.run(7.0)
    assert isinstance(answers[0], Accepted)


def test_a_release_never_undoes_a_later_stop(bench: Bench, disk: SlowDisk) -> None:
    bench.execute(Stop(), 1)
    disk.commit_s = 1.0
    submitted(bench, SetTravelSpeed(0.2), 2)
    submitted(bench, Resume(), 3)
    submitted(bench, Stop(), 4)
    bench.run(4.0)
    latch = StopLatch(bench.folder / "ledger.stop")
    latch.close()
    assert latch.stopped_by is not None
    bench.crash()
    assert bench.executive.mode.name == "STOPPED"


def test_a_plan_is_activated_before_it_is_committed(bench: Bench, disk: SlowDisk) -> None:
    disk.commit_s = 0.3
    submitted(bench, SubmitPlan(plan('<moveForward distance="0.2" deadline_s="60"/>')), 1)
    answers = submitted(bench, ActivatePlan("survey"), 2)
    bench.run(0.5)
    assert bench.rover.velocity == STANDING
    bench.run(10.0)
    assert isinstance(answers[0], Accepted)
    assert bench.rover.pose.x_m == pytest.approx(0.2, abs=0.03)


@pytest.mark.at_length
def test_a_plan_resumed_before_a_step_is_committed_does_not_repeat_it(
    bench: Bench, disk: SlowDisk
) -> None:
    step = '<moveForward distance="0.2" deadline_s="60"/>'
    bench.submit(SubmitPlan(plan(f"<Sequence>{3 * step}</Sequence>")), 1)
    bench.submit(ActivatePlan("survey"), 2)
    bench.run(0.2)
    disk.commit_s = 5.0
    while bench.rover.pose.x_m < 0.19 or bench.rover.velocity != STANDING:
        bench.step()
    submitted(bench, SuspendPlan("survey"), 3)
    submitted(bench, ResumePlan("survey"), 4)
    bench.run(60.0)
    assert bench.rover.pose.x_m == pytest.approx(0.6, abs=0.05)


def test_the_authority_is_given_after_the_commit(bench: Bench, disk: SlowDisk) -> None:
    disk.commit_s = 0.5
    answers: list[AuthorityState | Refusal] = []
    request = AuthorityRequest(AuthorityAction.REQUEST, "MOE")
    bench.executive.query(lambda: bench.executive.request_authority(request, answers.append))
    bench.executive.serve_inbox()
    assert answers == []
    bench.run(1.0)
    assert isinstance(answers[0], AuthorityState)


def test_far_behind_it_refuses_all_but_stops(bench: Bench, disk: SlowDisk) -> None:
    disk.commit_s = HANG_S
    for number in range(1, MAX_UNWRITTEN_BATCHES + 5):
        submitted(bench, SetTravelSpeed(0.2), number)
    disk.commit_s = 0.0
    refused = submitted(bench, SetTravelSpeed(0.2), 1000)
    stopped = submitted(bench, Stop(), 1001)
    assert bench.executive.mode.name == "STOPPED"
    bench.clock.advance(HANG_S)
    bench.executive.serve_inbox()
    assert isinstance(refused[0], Rejected)
    assert refused[0].refusal.reason is Reason.LEDGER_FAILED
    assert "wait for the disk" in refused[0].refusal.text
    assert isinstance(stopped[0], Accepted)


def test_a_run_on_a_slow_disk_replays(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, Bench(tmp_path, tape=tape) as bench:
        disk = SlowDisk(bench)
        for number, disk.commit_s in enumerate((0.3, 0.02, 1.0, 0.1), 1):
            submitted(bench, MoveForward(0.3), number)
            bench.run(1.0)
        submitted(bench, Stop(), 9)
        bench.run(3.0)
    assert replay(path).difference is None


@pytest.mark.parametrize("failing", [False, True], ids=["at the end", "before"])
def test_an_executive_on_a_full_disk_closes_and_stores_the_stop(
    failing: bool, bench: Bench, disk: SlowDisk
) -> None:
    bench.drive_on()
    disk.commit_s = 0.1
    bench.fill_disk()
    while failing and not bench.ledger.failing:
        bench.step()
    bench.executive.close()
    assert bench.rover.velocity == STANDING
    with closing(StopLatch(bench.folder / "ledger.stop")) as latch:
        assert latch.stopped_by is not None


class Gate(sqlite3.Connection):
    """A connection with commits that wait for the gate, or fail."""

    open_gate = threading.Event()
    reached = threading.Event()
    fails = False
    commits: ClassVar[list[int]] = []
    statements = 0

    def execute(self, sql: str, *values: Any) -> sqlite3.Cursor:
        if sql == "COMMIT":
            self.reached.set()
            assert self.open_gate.wait(60)
            self.commits.append(self.statements)
            self.statements = 0
            if Gate.fails:
                raise sqlite3.OperationalError("disk I/O error")
        elif sql.startswith("INSERT"):
            self.statements += 1
        return super().execute(sql, *values)


@pytest.fixture
def gated(tmp_path: Path) -> Ledger:
    Gate.open_gate, Gate.fails, Gate.commits = threading.Event(), False, []
    Gate.reached = threading.Event()
    Gate.open_gate.set()

    def connect(path: Path | str) -> sqlite3.Connection:
        return sqlite3.connect(path, isolation_level=None, factory=Gate)

    return Ledger(tmp_path / "ledger.sqlite", Synchronous.NORMAL, connect)


def write(ledger: Ledger, number: int) -> None:
    ledger.append_report(report(number, number))
    ledger.seal()


def settled(ledger: Ledger, woken: threading.Event, until: Callable[[], bool]) -> None:
    """Poll each time the thread wakes the core, until a condition holds."""
    while not until():
        assert woken.wait(60)
        woken.clear()
        ledger.poll()


def test_the_thread_commits_all_that_waits_in_one_transaction(gated: Ledger) -> None:
    woken = threading.Event()
    gated.write_on_thread(woken.set)
    Gate.open_gate.clear()
    for number in range(1, 6):
        write(gated, number)
    assert (gated.unwritten_batches, list(gated.reports())) == (5, [])
    Gate.open_gate.set()
    settled(gated, woken, lambda: gated.settled)
    assert sum(Gate.commits) == 5
    assert len(Gate.commits) <= 3
    assert [each.sequence for each in gated.reports()] == [1, 2, 3, 4, 5]
    gated.close()


def test_after_an_error_the_thread_writes_the_same_batches(gated: Ledger) -> None:
    woken = threading.Event()
    gated.write_on_thread(woken.set)
    Gate.fails = True
    write(gated, 1)
    settled(gated, woken, lambda: gated.failing)
    write(gated, 2)
    assert list(gated.reports()) == []
    Gate.fails = False
    settled(gated, woken, lambda: gated.settled)
    assert [each.sequence for each in gated.reports()] == [1, 2]
    gated.close()


def test_close_writes_what_waits_and_abandon_does_not(gated: Ledger, tmp_path: Path) -> None:
    gated.write_on_thread(lambda: None)
    write(gated, 1)
    gated.close()
    with closing(Ledger(tmp_path / "ledger.sqlite")) as again:
        assert [each.sequence for each in again.reports()] == [1]
        again.write_on_thread(lambda: None)
        again.record(command(7))
        again.abandon()
    with closing(Ledger(tmp_path / "ledger.sqlite")) as last:
        assert last.digest_of(command(7).identity) is None


def test_abandon_ends_the_thread_though_batches_wait(gated: Ledger) -> None:
    gated.write_on_thread(lambda: None)
    Gate.open_gate.clear()
    Gate.reached.clear()
    write(gated, 1)
    assert Gate.reached.wait(60)
    write(gated, 2)
    end = threading.Thread(target=gated.writer.abandon, daemon=True)
    end.start()
    Gate.open_gate.set()
    end.join(60)
    assert not end.is_alive()
    assert [each.sequence for each in gated.reports()] == [1]


def test_a_disk_that_fails_at_the_end_does_not_hold_up_the_process(gated: Ledger) -> None:
    gated.write_on_thread(lambda: None)
    Gate.fails = True
    write(gated, 1)
    with pytest.raises(LedgerError, match="disk I/O error"):
        gated.close()
