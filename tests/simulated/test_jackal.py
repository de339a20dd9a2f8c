"""The scenario of the relay in simulated time, over the physics of the Jackal."""

from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import judge
from sim.scenario.reading import load_scenario
from tests.simulated.jackal import START_S, RelayScene, channel_of
from tests.support.lifecycles import Lifecycles, lifecycles

LATER_S = 20.0
"""For what is lost and sent again."""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("relay", RunMode.RELAY)


@pytest.fixture(scope="module")
def calm(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> tuple[Lifecycles, str]:
    """Play it where nothing is lost; return what was reported, and the digest of all events."""
    folder = tmp_path_factory.mktemp("calm")
    with RelayScene(scenario, folder, channel_of(scenario, 0.02), 1) as scene:
        record = scene.play()
        assert [str(found) for found in judge(scenario, record) if not found.passed] == []
        return lifecycles(record), scene.world.digest


def test_it_holds_and_repeats(
    scenario: Scenario, calm: tuple[Lifecycles, str], tmp_path: Path
) -> None:
    with RelayScene(scenario, tmp_path, channel_of(scenario, 0.02), 1) as scene:
        assert (lifecycles(scene.play()), scene.world.digest) == calm


@pytest.mark.parametrize("seed", [2, 3])
def test_the_same_is_reported_despite_losses_delays_and_kills(
    scenario: Scenario, calm: tuple[Lifecycles, str], seed: int, tmp_path: Path
) -> None:
    draw = Random(seed)
    channel = channel_of(scenario, draw.uniform(0.01, 0.4), loss=draw.uniform(0.0, 0.2))
    patient = replace(scenario, duration_s=scenario.duration_s + LATER_S)
    with RelayScene(patient, tmp_path, channel, seed) as scene:
        for name in ("relay", "orbiter"):
            scene.kill(name, START_S + draw.uniform(0.0, scenario.duration_s))
        assert lifecycles(scene.play()) == calm[0]
