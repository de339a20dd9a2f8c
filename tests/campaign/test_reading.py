"""What a campaign file may say, and the one error for what it may not."""

import re
from math import radians

import pytest

from executive.settings import SettingsError
from sim.campaign.model import Choice, FaultDraw, Grid, Interval, LogUniform, Named, Until
from sim.campaign.reading import campaign_folder, load_campaign
from tests.campaign.conftest import Write
from tests.support.patience import shipped_names

INJECT = "{choice: [none, left_wheels_stuck], weights: [3, 1], at: {uniform: [0.5, 1]}}"
UNTIL = "{until: 0.1, min: 1, max: 2}"
FRICTION = "{uniform: [0.45, 0.75]}"


@pytest.mark.parametrize("name", shipped_names(campaign_folder()))
def test_shipped_campaigns_can_be_read(name: str) -> None:
    campaign = load_campaign(name)
    assert isinstance(campaign.runs, int)
    assert campaign.runs % campaign.combinations == 0


def test_every_distribution_can_be_described(write: Write) -> None:
    lines = (
        "settings.drive.travel_speed: {log_uniform: [0.1, 1]}",
        "odometry.encoder_noise: {normal: [0.005, 0.001], within: [0, 0.01]}",
        "world.slope: {grid: [0, 5deg, -0.05]}",
        "world.start.heading: {uniform: [-90deg, 90deg]}",
        "settings.turn_drive.reverse: {choice: [true, false]}",
        "settings.sensors.second_odometry: {grid: [null, {rate_hz: 2}]}",
        "settings.sensors.laser: {grid: {without: null, with: {rate_hz: 10}}}",
        "world.rocks: {choice: [[], [{x: 9, y: 0, radius: 0.3, height: 0.2}]]}",
    )
    campaign = load_campaign(write(("vary:\n", "vary:\n  " + "\n  ".join(lines) + "\n")))
    found = {each.key: each.distribution for each in campaign.vary}
    assert len(found) == len(lines) + 4
    assert found["world.slope"] == Grid((0, radians(5), -0.05))
    assert found["settings.sensors.second_odometry"] == Grid(("null", "{rate_hz: 2}"))
    laser = Grid((Named("without", "null"), Named("with", "{rate_hz: 10}")))
    assert found["settings.sensors.laser"] == laser
    assert list(found) == sorted(found)


def test_runs_can_be_as_many_as_it_takes(write: Write) -> None:
    message = "{until: 0.1, confidence: 0.9, min: 20, max: 900}"
    campaign = load_campaign(write(("runs: 12", f"runs: {message}")))
    assert campaign.runs == Until(until=0.1, confidence=0.9, min=20, max=900)
    assert load_campaign("mine.yaml", runs=7).runs == 7


def test_a_grid_without_a_number_of_runs_is_played_once(write: Write) -> None:
    grid = "{grid: [none, left_wheels_stuck, right_wheels_stuck], at: {grid: [0.5, 1]}}"
    assert load_campaign(write(("runs: 12\n", ""), (INJECT, grid))).runs == 6


def test_a_condition_may_be_of_an_angle_in_degrees(write: Write) -> None:
    varied = (FRICTION, "{uniform: [0.45, 0.75]}\n  world.slope: {grid: [0, 5deg]}")
    hold = ("success: 0.2", "success: 0.2, where: world.slope == 5deg")
    campaign = load_campaign(write(varied, hold))
    (term,) = campaign.criteria[0].where.terms
    assert term.value == radians(5)
    assert str(campaign.criteria[0]).endswith("where world.slope == 5deg")


def test_a_fault_can_have_a_very_small_parameter(write: Write) -> None:
    """Python writes it as 1e-05."""
    fault = "{choice: [{gyro_bias: {rate: {log_uniform: [1e-5, 1e-2]}}}], at: 1}"
    vary = {each.key: each.distribution for each in load_campaign(write((INJECT, fault))).vary}
    rate = LogUniform(Interval(1e-5, 1e-2))
    assert vary["inject"] == Choice((FaultDraw("gyro_bias", (("rate", rate),)),))


def test_a_fault_may_be_of_a_sensor_that_the_campaign_adds(write: Write) -> None:
    added = (FRICTION, f"{FRICTION}\n  settings.sensors.laser: {{grid: [{{rate_hz: 10}}]}}")
    load_campaign(write(added, (INJECT, "{choice: [laser_dead], at: 1}")))
    with pytest.raises(SettingsError, match=r"settings\.sensors\.laser"):
        load_campaign(write((INJECT, "{choice: [laser_dead], at: 1}")))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("scenario: short.yaml", "scenario: long.yaml", "long.yaml: cannot be read"),
        ("scenario: short.yaml", "scenario: locomotino", "there is no scenario 'locomotino'"),
        ("scenario: short.yaml", "scenarios: []", "scenarios: expected a list of names"),
        ("scenario: short.yaml", "", "one of scenario, scenarios is needed"),
        ("runs: 12", "runs: 0", "runs: expected 1 .. 10000000"),
        ("runs: 12", "", "key 'runs' is missing"),
        ("runs: 12", "runs: {until: 2}", "runs.until: 2 is not in 1e-06 .. 1"),
        ("runs: 12", "run: 12", "unknown key 'run'"),
        ("seed: 3", "seed: -1", "seed: -1 is below 0"),
        (FRICTION, "{uniform: [0.75, 0.45]}", "vary.world.friction.uniform: [0.75, 0.45]"),
        (FRICTION, "{uniform: [0.45, nan]}", "expected a number"),
        (FRICTION, "{uniform: [0.45, .nan]}", "expected a finite number"),
        (FRICTION, "{uniform: [0.01, 0.5]}", "vary.world.friction: short.yaml: changed by"),
        (FRICTION, "{unifrom: [0.4, 0.5]}", "vary.world.friction: one of uniform, log_uniform"),
        (FRICTION, "{log_uniform: [0, 1]}", "log_uniform: 0 is not above 0"),
        (FRICTION, "{normal: [0.5]}", "normal: expected [MEAN, STANDARD DEVIATION]"),
        (FRICTION, "{normal: [0.5, 0.1], within: [3, 4]}", "within: is further than"),
        (FRICTION, "{normal: [0.5, 0.1]}", "tried 6 standard deviations from its mean: add within"),
        (
            INJECT,
            "{choice: [left_wheels_stuck], at: {normal: [2, 0.4]}}",
            "from its mean: add within",
        ),
        (INJECT, "{choice: [{tip: {by: {normal: [1, 1]}}}], at: 1}", "from its mean: add within"),
        (FRICTION, "{choice: []}", "choice: it is empty"),
        (FRICTION, "{grid: {}}", "grid: it is empty"),
        (FRICTION, "{grid: {1: 0.5}}", "vary.world.friction.grid: 1 is no name"),
        (FRICTION, "{grid: {low: 0.01}}", "vary.world.friction: short.yaml: changed by"),
        (FRICTION, "{choice: [0.5], weights: [1, 2]}", "weights: expected 1 numbers"),
        (FRICTION, "0.5", "vary.world.friction: expected keys and values, got 0.5"),
        ("world.friction", "world.frictoin", "vary.world.frictoin: short.yaml: "),
        ("world.friction", "wordl.friction", "did you mean world?"),
        ("command.go.distance", "command.come.distance", "LABEL of: go"),
        (
            INJECT,
            "{choice: [left_wheels_stuk], at: 1}",
            "'left_wheels_stuk' is no fault (did you mean left_wheels_s",
        ),
        (
            INJECT,
            "{choice: [left_wheels_stuck]}",
            "vary.inject: expected choice or grid of faults, and",
        ),
        (INJECT, "{choice: [left_wheels_stuck], at: 9}", "is later than the end, 4 s"),
        (
            INJECT,
            "{choice: [left_wheels_stuck], at: {uniform: [1, 9]}}",
            "is later than the end, 4 s",
        ),
        (INJECT, "{choice: [left_wheels_stuck], at: soon}", "vary.inject.at: expected seconds"),
        (
            INJECT,
            "{choice: [left_wheels_stuck], at: 1, for: soon}",
            "vary.inject.for: expected seconds",
        ),
        (INJECT, "{choice: [left_wheels_stuck], at: 1, for: 9}", "is later than the end, 4 s"),
        (INJECT, "{choice: [left_wheels_stuck], at: {choice: [1, x]}}", "vary.inject.at: expected"),
        (INJECT, "{choice: [laser_dead], at: 1}", "laser_dead needs a Jackal with"),
        (INJECT, "{choice: [{tip: {by: {grid: [1]}}}], at: 1}", "vary.inject.choice[0].tip.by"),
        (INJECT, "{choice: [{tip: 1}], at: 1}", "vary.inject.choice[0].tip: expected parameters"),
        (INJECT, "{choice: [{tip: {by: {uniform: [1, 9]}}}], at: 1}", "tip.by: 9 is not in"),
        ("success: 0.2", "success: 1.2", "criteria[0].success: 1.2 is not in 0 .. 1"),
        ("success: 0.2", "success: 0", "criteria[0]: success: 0 is met by any runs"),
        (
            "success: 0.2",
            "quantile: 0, of: failed, below: 1",
            "criteria[0]: quantile: 0 is met by any",
        ),
        ("success: 0.2", "quantile: 1, of: failed, above: 1", "give one below 1"),
        ("success: 0.2", "success: 0.2, confidence: 1", "criteria[0].confidence: 1 is not in"),
        ("success: 0.2", "sucess: 0.2", "criteria[0]: one of success, quantile is needed"),
        (
            "success: 0.2",
            "success: 0.2, where: inject",
            "criteria[0].where: 'inject' is no comparison",
        ),
        (
            "success: 0.2",
            "success: 0.2, where: frist > 1",
            "criteria[0].where: a run has no 'frist'",
        ),
        ("success: 0.2", "success: 0.2, where: inject > 1", "inject is a text, and only == or !="),
        ("success: 0.2", "success: 0.2, where: executed > x", "executed is a number"),
        ("success: 0.2", "quantile: 0.5, of: duration, below: 1", "did you mean duration_s?"),
        ("success: 0.2", "quantile: 0.5, of: inject, below: 1", "a run has no 'inject'"),
        ("success: 0.2", "quantile: 0.5, of: duration_s", "one of below, above is needed"),
        ("  - {success: 0.2}", "  []", "criteria: no criterion is given"),
    ],
)
def test_what_cannot_be_gets_one_error(write: Write, old: str, new: str, message: str) -> None:
    name = write((old, new))
    with pytest.raises(SettingsError, match=re.escape(message)) as caught:
        load_campaign(name)
    assert str(caught.value).startswith("mine.yaml:")


def test_the_maximum_of_runs_allows_all_combinations(write: Write) -> None:
    name = write(("choice: [0.2, 0.4]", "grid: [0.2, 0.3, 0.4]"), ("runs: 12", f"runs: {UNTIL}"))
    with pytest.raises(SettingsError, match=r"runs\.max: 2 is below 3, the combinations of"):
        load_campaign(name)


def test_an_unknown_name_is_reported_with_the_known_ones() -> None:
    with pytest.raises(
        SettingsError, match="there are: after_faults, after_sensor_faults, faults, mocup"
    ):
        load_campaign("norma")
