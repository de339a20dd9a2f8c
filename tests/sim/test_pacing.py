"""Simulated time waits for late ticks of the executive, which publishes the lock of the mux."""

import logging

import pytest

from sim.demo.session import SPEED
from sim.ros.service import EXECUTIVE_TIMEOUT_S, MAX_LEAD_S, Pacer

PERIOD_S = 0.02


def test_time_waits_for_a_late_tick_but_not_for_an_executive_that_has_ended() -> None:
    pacer = Pacer()
    assert not pacer.waits(5.0, 100.0), "before the first tick"
    pacer.on_tick(5.0, 100.0)
    assert not pacer.waits(5.0 + MAX_LEAD_S, 100.1)
    late_s = 5.0 + MAX_LEAD_S + PERIOD_S
    assert pacer.waits(late_s, 100.2)
    assert not pacer.waits(late_s, 100.0 + EXECUTIVE_TIMEOUT_S)
    pacer.on_tick(late_s, 106.0)
    assert not pacer.waits(late_s + PERIOD_S, 106.0)


def test_slow_time_is_reported_once_and_so_is_its_end(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    pacer = Pacer()
    simulated_s = real_s = 0.0
    for rate, duration_s in ((1.0, 20.0), (0.6, 20.0), (1.0, 20.0)):
        for _ in range(round(duration_s / PERIOD_S)):
            pacer.on_tick(simulated_s, real_s)
            pacer.waits(simulated_s, real_s)
            simulated_s += rate * PERIOD_S
            real_s += PERIOD_S
    slow, again = caplog.messages
    assert slow.endswith("simulated time runs at 60 % of real time")
    assert again == "simulated time runs at real time again"
    log = f"10:00Z WARNING {slow}\n10:01Z INFO    the brick is plugged in\n10:02Z INFO    {again}\n"
    assert SPEED.findall(log) == [slow, again], "lines of the demonstration"
