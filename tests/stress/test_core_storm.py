"""A storm over the core keeps its promises, and says where one is broken."""

import pytest

from executive.core.runner import Executive
from executive.settings import load_settings
from executive.values.geometry import Velocity
from tests.stress import core_storm

MOTION = "storm: motion while stopped or safe"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_promises_hold_in_any_order_of_events(seed: int) -> None:
    figures = core_storm.measure(load_settings("jackal"), 500, seed, print)
    assert [figure.name for figure in figures if not figure.met] == []


def test_a_rover_that_moves_by_itself_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Executive, "velocity", property(lambda _: Velocity(0.1, 0.0)))
    figures = core_storm.measure(load_settings("jackal"), 200, 1, lambda _: None)
    assert [figure.name for figure in figures if not figure.met] == [MOTION]
