"""The scenario of the relay in simulated time, over the physics of the Jackal."""

from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import judge
from sim.scenario.reading import load_scenario
from tests.simulated.jackal import START_S, RelayScene, way_of
from tests.support.lives import Lives, lives

LATER_S = 20.0
"""For what is lost and sent again."""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("relay", RunMode.RELAY)


@pytest.fixture(scope="module")
def calm(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> tuple[Lives, str]:
    """Play it where nothing is lost; return what was reported, and the digest of all events."""
    folder = tmp_path_factory.mktemp("calm")
    with RelayScene(scenario, folder, way_of(scenario, 0.02), 1) as scene:
        record = scene.play()
        assert [str(found) for found in judge(scenario, record) if not found.holds] == []
        return lives(record), scene.world.digest


def test_it_holds_and_repeats(scenario: Scenario, calm: tuple[Lives, str], tmp_path: Path) -> None:
    with RelayScene(scenario, tmp_path, way_of(scenario, 0.02), 1) as scene:
        assert (lives(scene.play()), scene.world.digest) == calm


@pytest.mark.parametrize("seed", [2, 3])
def test_the_same_is_reported_whatever_is_lost_late_or_killed(
    scenario: Scenario, calm: tuple[Lives, str], seed: int, tmp_path: Path
) -> None:
    draw = Random(seed)
    way = way_of(scenario, draw.uniform(0.01, 0.4), loss=draw.uniform(0.0, 0.2))
    patient = replace(scenario, lasts_s=scenario.lasts_s + LATER_S)
    with RelayScene(patient, tmp_path, way, seed) as scene:
        for name in ("relay", "orbiter"):
            scene.kill(name, START_S + draw.uniform(0.0, scenario.lasts_s))
        assert lives(scene.play()) == calm[0]
