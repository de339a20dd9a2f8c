"""The promises of the core, searched for a way to break them by hypothesis."""

import tempfile
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    rule,
    run_state_machine_as_test,
)

from executive.settings import load_settings
from sim.bench.storm import Broken, Storm, measure


class Weather(RuleBasedStateMachine):
    """Hypothesis chooses what happens when; a seed chooses the commands."""

    commands = 0

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()

    @initialize(seed=st.integers(0, 2**32))
    def begin(self, seed: int) -> None:
        self.storm = Storm(load_settings("jackal"), Path(self._folder.name), Random(seed))

    @rule(count=st.integers(1, 50))
    def commands_come(self, count: int) -> None:
        self.storm.commands_come(count)

    @rule(ticks=st.integers(1, 40))
    def let_time_pass(self, ticks: int) -> None:
        self.storm.let_time_pass(ticks)

    @rule()
    def crash(self) -> None:
        self.storm.crash()

    @rule(works=st.booleans())
    def set_odometry(self, works: bool) -> None:
        self.storm.set_odometry(works)

    def teardown(self) -> None:
        type(self).commands += len(self.storm.sent)
        assert self.storm.end() == Broken(repeated=0, unended=0, moved=0, gaps=0)
        self._folder.cleanup()


def test_promises_hold_whatever_happens_when() -> None:
    run_state_machine_as_test(
        Weather,
        settings=settings(
            max_examples=15,
            stateful_step_count=30,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
    assert Weather.commands > 300


@pytest.mark.slow
@given(seed=st.integers(0, 2**32))
@settings(max_examples=10, deadline=None, derandomize=True, database=None)
def test_promises_hold_in_ten_storms_of_ten_thousand_commands(seed: int) -> None:
    assert [figure.value for figure in measure(load_settings("jackal"), 10_000, seed)] == [0] * 4
