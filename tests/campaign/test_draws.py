"""What a run is given depends on the campaign's seed and the run's number, and nothing else."""

import shlex
from collections import Counter
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from executive.settings import parse_yaml
from sim.campaign.draws import ValueKind, as_yaml, draw, number, quantities
from sim.campaign.model import (
    Campaign,
    Choice,
    Distribution,
    FaultDraw,
    Grid,
    Integers,
    Interval,
    LogUniform,
    Named,
    Normal,
    Success,
    Uniform,
    Variation,
)
from sim.scenario.changes import Override

SEED = Variation(key="seed", distribution=Integers((0, 10**6)))
FRICTION = Variation(key="world.friction", distribution=Uniform(Interval(0.45, 0.75)))
SLOPE = Variation(key="world.slope", distribution=Grid((0, 0.1, 0.2)))
FAULTS = Variation(
    key="inject",
    distribution=Choice(
        (
            "none",
            FaultDraw("left_wheels_stuck"),
            FaultDraw("tip", (("by", Uniform(Interval(1, 2))),)),
        )
    ),
    at=Uniform(Interval(1, 8)),
)
HOLD = (Success(success=0.9),)


def campaign(*vary: Variation, seed: int = 0, scenarios: tuple[str, ...] = ("a", "b")) -> Campaign:
    return Campaign(
        title="", scenarios=scenarios, runs=10, seed=seed, vary=tuple(vary), criteria=HOLD
    )


@given(st.integers(0, 2**40), st.integers(0, 10**7))
def test_a_quantity_is_drawn_alike_independently_of_others(seed: int, run: int) -> None:
    alone = draw(campaign(FRICTION, seed=seed), run)
    beside = draw(campaign(FAULTS, SEED, FRICTION, SLOPE, seed=seed), run)
    assert alone == draw(campaign(FRICTION, seed=seed), run)
    assert alone.changes[0] in beside.changes
    assert alone.scenario == beside.scenario


def test_seeds_and_runs_give_other_numbers() -> None:
    seen = {
        draw(campaign(FRICTION, seed=seed), run).values for seed in range(9) for run in range(9)
    }
    assert len(seen) == 81


@given(st.sampled_from([Uniform, LogUniform]), st.floats(1e-6, 1e3), st.floats(1e-6, 1e3))
def test_numbers_are_within_their_interval(
    kind: type[Uniform] | type[LogUniform], low: float, width: float
) -> None:
    distribution = kind(Interval(low, low + width))
    random = np.random.default_rng(0)
    assert all(low <= number(distribution, random) <= low + width for _ in range(20))


@given(st.integers(-(2**62), 2**62), st.integers(1, 2**61))
def test_whole_numbers_are_from_first_to_last(first: int, more: int) -> None:
    random = np.random.default_rng(0)
    drawn = [number(Integers((first, first + more)), random) for _ in range(20)]
    assert all(isinstance(value, int) and first <= value <= first + more for value in drawn)
    assert {number(Integers((1, 3)), random) for _ in range(60)} == {1, 2, 3}


def test_a_normal_distribution_is_cut_by_drawing_again() -> None:
    random = np.random.default_rng(0)
    drawn = [number(Normal((1.0, 0.5), Interval(0.5, 2.0)), random) for _ in range(500)]
    assert 0.5 < min(drawn) < 0.55
    assert 1.9 < max(drawn) < 2.0


def test_each_combination_of_a_grid_occurs_equally_often() -> None:
    faults = Grid(("none", FaultDraw("left_wheels_stuck"), FaultDraw("right_wheels_stuck")))
    whole = campaign(Variation(key="inject", distribution=faults, at=Grid((1.0, 2.0))), SLOPE)
    assert whole.combinations == 36
    seen = Counter(
        (each.scenario, *each.values) for each in (draw(whole, run) for run in range(72))
    )
    assert {count for (_, fault, *_), count in seen.items() if fault != "none"} == {2}
    assert {count for (_, fault, *_), count in seen.items() if fault == "none"} == {4}
    assert len(seen) == 2 * 3 * (2 + 2 + 1)


def test_weights_determine_the_frequency() -> None:
    choice = Variation(key="seed", distribution=Choice((1, 2), (1.0, 3.0)))
    drawn = Counter(draw(campaign(choice), run).values[0] for run in range(1000))
    assert 700 < drawn[2] < 800


def test_faults_have_columns_for_their_time_and_parameters() -> None:
    found = quantities(campaign(FAULTS, SEED))
    assert [(each.name, each.kind) for each in found] == [
        ("inject", ValueKind.TEXT),
        ("inject.onset", ValueKind.TEXT),
        ("inject.at", ValueKind.NUMBER),
        ("inject.by", ValueKind.NUMBER),
        ("seed", ValueKind.WHOLE),
    ]
    by_fault = {}
    for run in range(30):
        drawn = draw(campaign(FAULTS), run)
        by_fault[drawn.values[0]] = drawn
    assert by_fault["none"].values == ("none", "none", None, None)
    assert by_fault["none"].changes == (Override("inject", "none"),)
    _, onset, at_s, by = by_fault["tip"].values
    assert onset == "abrupt"
    assert by_fault["tip"].changes == (Override("inject", f"{{tip: {{by: {by}}}, at: {at_s}}}"),)
    assert by_fault["left_wheels_stuck"].values[3] is None


def test_a_fault_that_ends_has_the_duration_drawn() -> None:
    lasting = replace(FAULTS, duration=Uniform(Interval(1, 2)))
    assert [each.name for each in quantities(campaign(lasting))][:4] == [
        "inject",
        "inject.onset",
        "inject.at",
        "inject.for",
    ]
    drawn = next(
        each for each in (draw(campaign(lasting), run) for run in range(30)) if "tip" in each.values
    )
    _, _, at_s, for_s, by = drawn.values
    assert isinstance(for_s, float)
    assert 1 <= for_s <= 2
    message = f"{{tip: {{by: {by}}}, at: {at_s}, for: {for_s}}}"
    assert drawn.changes == (Override("inject", message),)


def test_the_command_lists_the_changes() -> None:
    drawn = draw(campaign(FAULTS, SEED, FRICTION), 5)
    text = shlex.split(drawn.command)
    assert text[:3] == ["rover", "scenario", drawn.scenario]
    message = dict(zip(text[3::2], text[4::2], strict=True))
    assert set(message) == {"--set", "--seed"}
    options = list(zip(text[3::2], text[4::2], strict=True))
    reported = [Override("seed", v) if k == "--seed" else Override.parse(v) for k, v in options]
    assert tuple(reported) == drawn.changes


@given(st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.integers(), st.booleans()))
def test_a_value_is_written_to_the_last_bit(value: float | bool) -> None:
    read = parse_yaml(as_yaml(value), "")
    assert (type(read), read) == (type(value), value)


def test_another_number_of_runs_changes_no_run() -> None:
    less = campaign(FAULTS, SLOPE)
    more = replace(less, runs=1000)
    assert [draw(less, run) for run in range(10)] == [draw(more, run) for run in range(10)]


def spread(distribution: Distribution) -> set[object]:
    varied = Variation(key="world.friction", distribution=distribution)
    return {draw(campaign(varied), run).values[0] for run in range(200)}


def test_a_choice_is_passed_unchanged() -> None:
    assert spread(Choice((0.5, 1))) == {0.5, 1.0}
    assert spread(Choice((True, "5", 2))) == {"true", "5", "2"}


def test_a_named_value_is_set_and_called_by_its_name() -> None:
    sensors = Grid((Named("none", "{imu: null}"), Named("asset", "{}")))
    drawn = draw(campaign(Variation(key="settings.sensors", distribution=sensors)), 0)
    assert drawn.values == ("none",)
    assert drawn.changes == (Override("settings.sensors", "{imu: null}"),)
