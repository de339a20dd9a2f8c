"""Time stands still within each entry of the core, so that all it decides there sees one time."""

from collections.abc import Callable
from pathlib import Path

from executive.commands import Command, MoveForward, Stop
from executive.values.clock import LatchedClock, ManualClock, SystemClock
from executive.values.facts import Odometry
from executive.values.geometry import Pose, Velocity
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Severity
from tests.support.kinematic import Bench


class RestlessClock(ManualClock):
    """Goes on with each reading, as that of a machine does."""

    def __init__(self) -> None:
        super().__init__()
        self.readings = 0

    def now_s(self) -> float:
        self.readings += 1
        self.advance(0.001)
        return super().now_s()


def test_each_entry_reads_the_clock_once(tmp_path: Path) -> None:
    clock = RestlessClock()
    with Bench(tmp_path, clock=clock) as bench:
        executive = bench.executive

        fact = Odometry(1.0, Pose(), Velocity(0.0, 0.0))
        entries: dict[str, Callable[[], None]] = {
            "observe": lambda: executive.observe(fact),
            "event": lambda: executive.report_event(Severity.WARNING, "a link is slow"),
            "turn": executive.serve_inbox,
            "tick": executive.tick,
            "make_safe": lambda: executive.enter_safe_mode(Refusal(Reason.CORE_HUNG, "it hung")),
        }
        executive.submit(Command(Identity("MOE", 1), MoveForward(1.0), "direct"), lambda _: None)
        readings = {}
        for name, enter in entries.items():
            before = clock.readings
            enter()
            readings[name] = clock.readings - before
        assert readings == dict.fromkeys(entries, 1)


def test_reports_of_one_turn_bear_one_time(tmp_path: Path) -> None:
    clock = RestlessClock()
    with Bench(tmp_path, clock=clock) as bench:
        executive = bench.executive
        first = executive.last_sequence + 1
        executive.query(lambda: executive.report_event(Severity.WARNING, "a link is slow"))
        for number, request in ((1, MoveForward(1.0)), (2, Stop())):
            executive.submit(Command(Identity("MOE", number), request, "direct"), lambda _: None)
        executive.serve_inbox()
        reports = executive.reports(first)
        assert len(reports) > 4
        assert len({each.utc_s for each in reports}) == 1


def test_a_restart_is_one_entry(tmp_path: Path) -> None:
    clock = RestlessClock()
    with Bench(tmp_path, clock=clock) as bench:
        bench.submit(MoveForward(1.0), 1)
        bench.executive.simulate_crash()
        before = clock.readings
        bench.restart()
        assert clock.readings - before == 1


def test_between_entries_time_continues() -> None:
    clock = ManualClock()
    latched = LatchedClock(clock)
    clock.advance(1.0)
    assert (latched.now_s(), latched.utc_s() - clock.utc_s()) == (0.0, -1.0)
    with latched:
        assert latched.now_s() == 0.0
    latched.end()
    assert (latched.now_s(), latched.utc_s()) == (1.0, clock.utc_s())
    with latched, latched:
        clock.advance(1.0)
        assert latched.now_s() == 1.0
    assert latched.now_s() == 2.0


def test_a_machine_clock_resolves_tenths_of_a_millisecond_and_never_steps_back() -> None:
    clock = SystemClock()
    readings_s = [clock.now_s() for _ in range(10_000)]
    assert readings_s == sorted(readings_s)
    assert readings_s == [round(each, 4) for each in readings_s]
    utc_s = clock.utc_s()
    assert utc_s == round(utc_s, 4)
