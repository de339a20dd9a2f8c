"""The record is bounded, and a command is executed at most once all the same."""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import (
    ExecuteAction,
    FollowPath,
    Mode,
    MoveForward,
    Request,
    Resume,
    ResumePlan,
    RotateBy,
    SetTravelSpeed,
    Stop,
    Waypoint,
)
from executive.commands.lifecycle import Duplicate, Rejected
from executive.core.runner import Executive
from executive.record import PRUNED, LedgerRetention
from executive.record.retention import FOREIGN_SHARE, Range, merge_ranges
from executive.settings import SettingsError, config_folder, load_settings
from executive.values.reasons import Reason
from executive.values.reports import TERMINAL, Identity, PlanStatus, ReportKind, Stage
from tests.support.plans import PlanBench, plan

RETAINED = 12
AT_ONCE = 4

RANGES = st.lists(
    st.tuples(st.integers(-50, 50), st.integers(0, 5)).map(lambda r: (r[0], r[0] + r[1]))
)


class Forgetful(PlanBench):
    """An executive that remembers the last few reports only."""

    def _start(self) -> Executive:
        executive = super()._start()
        executive.retention = LedgerRetention(self.ledger, RETAINED, AT_ONCE)
        return executive

    @property
    def stopped(self) -> bool:
        return self.executive.mode is Mode.STOPPED

    def stored(self) -> list[int]:
        return [report.sequence for report in self.ledger.reports()]

    def known(self, number: int) -> bytes | None:
        return self.ledger.digest_of(Identity("MOE", number))


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Forgetful]:
    with Forgetful(tmp_path) as bench:
        yield bench


def held(ranges: list[Range]) -> set[int]:
    return {number for first, last in ranges for number in range(first, last + 1)}


@pytest.mark.at_length
@given(RANGES)
def test_ranges_hold_exactly_their_added_numbers(ranges: list[Range]) -> None:
    found = list(merge_ranges(ranges))
    assert held(found) == held(ranges)
    assert all(first <= last for first, last in found)
    assert all(later[0] > earlier[1] + 1 for earlier, later in pairwise(found))


REQUESTS: list[Request] = [
    MoveForward(0.05),
    MoveForward(1000.0),
    RotateBy(0.1),
    SetTravelSpeed(0.4),
    SetTravelSpeed(0.6),
    Stop(),
    Resume(),
    ExecuteAction("NOTHING OF THE KIND"),
]
COMMANDS = st.tuples(st.integers(1, 40), st.sampled_from(REQUESTS), st.integers(0, 20))
CRASH = st.just(None)


@pytest.mark.at_length
@given(st.lists(st.one_of(COMMANDS, COMMANDS, COMMANDS, CRASH), min_size=10, max_size=50))
@settings(max_examples=12)
def test_nothing_is_accepted_twice_for_any_retention(
    acts: list[tuple[int, Request, int] | None],
) -> None:
    with TemporaryDirectory() as folder, Forgetful(Path(folder)) as bench:
        taken: set[int] = set()
        for act in acts:
            if act is None:
                speed_mps, stopped = bench.executive.status.travel_speed_mps, bench.stopped
                bench.crash()
                assert bench.executive.status.travel_speed_mps == speed_mps
                assert bench.stopped == stopped
                bench.step()
                continue
            number, request, steps = act
            answer = bench.submit(request, number)
            if isinstance(request, Stop):
                assert bench.stopped
            if number in taken:
                assert isinstance(answer, Duplicate) or (
                    isinstance(answer, Rejected) and answer.refusal.reason is Reason.DUPLICATE
                )
            else:
                assert not isinstance(answer, Duplicate)
                assert bench.known(number) not in (None, PRUNED)
            taken.add(number)
            for _ in range(steps):
                bench.step()
            poll(bench)
        bench.run(3.0)
        poll(bench)
        assert len(bench.stored()) <= RETAINED + AT_ONCE + RETAINED // FOREIGN_SHARE + AT_ONCE
        bench.crash()
        for number in range(1, 41):
            assert (bench.known(number) is not None) == (number in taken)


def poll(bench: Forgetful) -> None:
    """Check what holds at any time."""
    reported = {report.sequence: report for report in bench.received.reports}.values()
    ends = Counter(r.identity for r in reported if r.stage in TERMINAL)
    assert set(ends.values()) <= {1}
    stored, numbers = bench.stored(), [report.sequence for report in bench.received.reports]
    assert set(numbers) == set(range(1, bench.ledger.last_sequence + 1))
    foreign = [row[0] for row in bench.ledger.rows("SELECT sequence FROM foreign_reports")]
    own = len(stored) - len(foreign)
    assert own >= min(RETAINED, sum(report.kind is ReportKind.COMMAND for report in reported))
    assert len(foreign) <= RETAINED // FOREIGN_SHARE + AT_ONCE


def test_a_record_too_short_to_catch_up_from_is_refused(tmp_path: Path) -> None:
    jackal = (config_folder() / "jackal.yaml").read_text()
    short = tmp_path / "short.yaml"
    short.write_text(jackal.replace("retained_reports: 100000", "retained_reports: 999"))
    with pytest.raises(SettingsError, match="retained_reports is 999: at least 1000"):
        load_settings(str(short))


def test_a_repeat_is_answered_by_its_end_and_later_by_its_number_alone(bench: Forgetful) -> None:
    bench.submit(SetTravelSpeed(0.5), 1)
    assert isinstance(bench.submit(SetTravelSpeed(0.5), 1), Duplicate)
    for number in range(2, 20):
        bench.submit(SetTravelSpeed(0.4), number)
        bench.step()
    answer = bench.refusal(SetTravelSpeed(0.5), 1)
    assert answer.reason is Reason.DUPLICATE
    assert answer.text == "MOE:1 is used and its command is no longer stored: choose a new number"
    assert bench.executive.status.travel_speed_mps == 0.4


def test_an_active_command_is_retained_completely(bench: Forgetful) -> None:
    bench.submit(MoveForward(8.0), 1)
    for number in range(2, 60):
        bench.submit(SetTravelSpeed(0.4), number)
        bench.step()
    assert bench.stored()[0] == 1
    assert isinstance(bench.submit(MoveForward(8.0), 1), Duplicate)
    assert bench.finish(1) is Stage.EXECUTED
    bench.run(10.0)
    assert len(bench.stored()) < RETAINED + AT_ONCE


def test_a_plan_knows_its_steps_without_their_commands(bench: Forgetful) -> None:
    step = '<setTravelSpeed speed="0.5" deadline_s="5"/>'
    drive = '<moveForward distance="2" deadline_s="60"/>'
    bench.go(plan(f'<Sequence><Repeat num_cycles="30">{step}</Repeat>{drive}</Sequence>'))
    bench.run(3.0)
    assert bench.status().done == 1
    assert bench.ledger.digest_of(Identity("plan:survey", 1)) == PRUNED
    bench.crash()
    bench.step()
    bench.request(ResumePlan("survey"))
    assert bench.until(PlanStatus.COMPLETED, PlanStatus.FAILED) is PlanStatus.COMPLETED
    assert [number for number, _ in bench.commanded()] == list(range(1, 33))


@pytest.mark.at_length
def test_the_file_does_not_grow_with_forgotten_reports(bench: Forgetful) -> None:
    def pages(commands: range) -> int:
        for number in commands:
            bench.submit(SetTravelSpeed(0.4), number)
            bench.step()
        return int(bench.ledger.rows("PRAGMA page_count")[0][0])

    assert pages(range(100, 600)) <= pages(range(1, 100)) + 2


@pytest.mark.at_length
@pytest.mark.parametrize(
    "request_",
    [ExecuteAction("x" * 200_000), FollowPath(tuple(Waypoint(1.0, 2.0) for _ in range(5_000)))],
)
def test_a_refused_command_leaves_only_its_reason(request_: Request, bench: Forgetful) -> None:
    bench.refusal(request_, 7)
    assert bench.last(7).stage is Stage.REJECTED
    ((body,),) = bench.ledger.rows("SELECT request FROM commands WHERE command_id = 7")
    assert body == ""
    assert isinstance(bench.submit(request_, 7), Duplicate)
    ((before,),) = bench.ledger.rows("PRAGMA page_count")
    for number in range(8, 20):
        bench.submit(request_, number)
    ((after,),) = bench.ledger.rows("PRAGMA page_count")
    assert after - before <= 3
