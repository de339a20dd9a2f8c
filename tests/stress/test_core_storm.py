"""The promises of the core, searched for a way to break them by hypothesis.

`rover test --stress` has a hundred thousand commands more.
"""

import tempfile
from pathlib import Path
from random import Random

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule, run_state_machine_as_test

from executive.settings import load_settings
from tests.stress.core_storm import Storm

COUNTS = st.integers(1, 50)


class Weather(RuleBasedStateMachine):
    """Hypothesis chooses what happens when; a seed chooses the commands."""

    commands = 0

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()

    @initialize(seed=st.integers(0, 2**32))
    def begin(self, seed: int) -> None:
        self.storm = Storm(load_settings("jackal"), Path(self._folder.name), Random(seed), print)

    @rule(count=COUNTS, ticks=st.integers(0, 40))
    def commands_and_time(self, count: int, ticks: int) -> None:
        self.storm.commands_come(count)
        self.storm.let_time_pass(ticks)

    @rule(count=COUNTS)
    def commands_and_a_crash(self, count: int) -> None:
        self.storm.commands_come(count)
        self.storm.crash()

    @rule(count=COUNTS, works=st.booleans())
    def commands_and_odometry(self, count: int, works: bool) -> None:
        self.storm.commands_come(count)
        self.storm.set_odometry(works)

    def teardown(self) -> None:
        type(self).commands += len(self.storm.sent)
        assert not self.storm.end().counts
        self._folder.cleanup()


def test_promises_hold_whatever_happens_when() -> None:
    run_state_machine_as_test(
        Weather,
        settings=settings(
            max_examples=8,
            stateful_step_count=30,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
    assert Weather.commands > 800
