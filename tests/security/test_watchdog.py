"""A core whose thread hangs: the rover stands, and everybody is told."""

import time

import pytest

from adapters.onboard.watchdog import LOOKS, Watchdog
from executive.commands import Mode
from executive.geometry import STANDING
from executive.reasons import Reason
from executive.reports import Stage
from tests.support.kinematic import Bench

BOUND_S = 0.05


def until(told: list[str]) -> None:
    deadline_s = time.monotonic() + 30.0
    while not told:
        assert time.monotonic() < deadline_s
        time.sleep(BOUND_S / LOOKS)


def test_a_core_that_hangs_while_it_drives_is_made_to_stand_and_safe(bench: Bench) -> None:
    bench.drive_on()
    told: list[str] = []
    with Watchdog(bench.executive, BOUND_S, told.append) as watchdog:
        watchdog.beat()
        until(told)
        assert bench.rover.velocity == STANDING
    assert "has not ticked for" in told[0]
    bench.step()
    assert bench.executive.mode is Mode.SAFE
    assert "the watchdog made the rover stand" in bench.executive.why
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.CORE_HUNG
    assert bench.rover.velocity == STANDING


def test_a_core_that_hangs_while_the_rover_stands_is_only_told(bench: Bench) -> None:
    told: list[str] = []
    with Watchdog(bench.executive, BOUND_S, told.append) as watchdog:
        watchdog.beat()
        until(told)
    sent = len(bench.rover.sent)
    bench.step()
    assert bench.executive.mode is Mode.IDLE
    assert "the core did not tick for" in bench.heard.reports[-1].text
    assert len(bench.rover.sent) == sent


@pytest.mark.parametrize("beats", [0, 50])
def test_before_the_first_beat_and_while_it_beats_there_is_no_alarm(
    bench: Bench, beats: int
) -> None:
    bench.drive_on()
    told: list[str] = []
    with Watchdog(bench.executive, 1.0, told.append) as watchdog:
        for _ in range(beats):
            watchdog.beat()
            time.sleep(0.005)
    assert told == []
    assert bench.rover.velocity != STANDING
