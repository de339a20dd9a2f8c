"""A core whose thread hangs, or that is suspended: the rover stands, and everybody is told."""

import time

import pytest

from adapters.onboard.watchdog import MISSED_POLLS, Watchdog
from executive.commands import Mode, MoveForward, MoveTo, Resume, Waypoint
from executive.values.clock import SystemClock
from executive.values.geometry import STANDING
from executive.values.reasons import Reason
from executive.values.reports import Report, ReportKind, Severity, Stage
from tests.support.kinematic import Bench

BOUND_S = 0.05


def until(reported: list[str]) -> None:
    deadline_s = time.monotonic() + 30.0
    while not reported:
        assert time.monotonic() < deadline_s
        time.sleep(BOUND_S / MISSED_POLLS)


def test_a_core_that_hangs_while_it_drives_is_halted_and_safe(bench: Bench) -> None:
    bench.drive_on()
    reported: list[str] = []
    with Watchdog(bench.executive, BOUND_S, reported.append) as watchdog:
        watchdog.beat()
        until(reported)
        assert bench.rover.velocity == STANDING
    assert "has not ticked for" in reported[0]
    bench.step()
    assert bench.executive.mode is Mode.SAFE
    assert "the watchdog stopped the rover" in bench.executive.why
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.CORE_HUNG
    assert bench.rover.velocity == STANDING


def test_a_core_that_hangs_at_standstill_is_only_reported(bench: Bench) -> None:
    reported: list[str] = []
    with Watchdog(bench.executive, BOUND_S, reported.append) as watchdog:
        watchdog.beat()
        until(reported)
    sent = len(bench.rover.sent)
    bench.step()
    assert bench.executive.mode is Mode.IDLE
    assert "the core did not tick for" in bench.received.reports[-1].text
    assert len(bench.rover.sent) == sent


@pytest.mark.parametrize("beats", [0, 50])
def test_before_the_first_beat_and_while_it_beats_there_is_no_alarm(
    bench: Bench, beats: int
) -> None:
    bench.drive_on()
    reported: list[str] = []
    with Watchdog(bench.executive, 1.0, reported.append) as watchdog:
        for _ in range(beats):
            watchdog.beat()
            time.sleep(0.005)
    assert reported == []
    assert bench.rover.velocity != STANDING


SUSPENDED_S = 12.0


def suspended(bench: Bench) -> None:
    """Stop the process, as SIGSTOP or a suspended computer does; the base stops by itself."""
    bench.rover.velocity = STANDING
    bench.clock.advance(SUSPENDED_S)
    bench.step()


def late(bench: Bench) -> list[Report]:
    return [each for each in bench.received.reports if each.reason is Reason.TICK_LATE]


def test_after_a_suspend_motion_waits_for_a_resume_over_a_restart_too(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(5.0, 0.0)), 1)
    bench.run(2.0)
    sent = len(bench.rover.sent)
    suspended(bench)
    assert bench.executive.mode is Mode.PAUSED
    assert all(each == STANDING for each in bench.rover.sent[sent:])
    (event,) = late(bench)
    assert (event.severity, event.kind) == (Severity.WARNING, ReportKind.EVENT)
    assert event.figures[0].value == pytest.approx(SUSPENDED_S, abs=0.01)
    bench.run(5.0)
    assert bench.rover.velocity == STANDING
    assert "PAUSED: the tick was 12.0 s late" in bench.executive.why
    bench.submit(Resume(), 2)
    assert bench.finish(1) is Stage.EXECUTED
    bench.submit(MoveTo(Waypoint(0.0, 0.0)), 3)
    bench.run(2.0)
    suspended(bench)
    bench.crash()
    assert bench.executive.mode is Mode.PAUSED


def test_relative_motion_fails_by_a_suspend(bench: Bench) -> None:
    bench.drive_on()
    suspended(bench)
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.TICK_LATE


def test_a_suspend_at_standstill_is_only_reported_and_reported_once(bench: Bench) -> None:
    bench.run(1.0)
    for _ in range(5):
        suspended(bench)
    assert len(late(bench)) == 1
    assert bench.executive.mode is Mode.IDLE
    bench.run(1.0)
    suspended(bench)
    assert len(late(bench)) == 2
    bench.execute(MoveForward(0.5), 1)


def test_a_tick_within_the_bound_is_not_late(bench: Bench) -> None:
    bench.drive_on()
    bench.clock.advance(bench.settings.safety.watchdog_s - 0.01)
    bench.step()
    assert late(bench) == []


def test_the_clock_of_the_core_counts_a_suspend_of_the_computer() -> None:
    now_s = time.clock_gettime(time.CLOCK_BOOTTIME)
    assert 0.0 <= SystemClock().now_s() - round(now_s, 4) < 60.0
