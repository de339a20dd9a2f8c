from dataclasses import replace
from math import radians
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from executive.faults import DECLARED, ClearPolicy, FaultTable, Reaction
from executive.safety import MONITORS
from executive.settings import (
    Settings,
    SettingsError,
    load_settings,
    structure,
    unstructure,
)
from executive.values.reasons import Reason
from sim.scenario.changes import Override
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from tests.support.patience import shipped_names

CONFIG = Path(__file__).parents[2] / "config"


def asset(**sections: object) -> Settings:
    """Return the settings of an asset with other sections."""
    raw = yaml.safe_load((CONFIG / "jackal.yaml").read_text())
    return structure({**raw, **sections}, Settings, "rover.yaml")


def refused(**sections: object) -> str:
    """Return why an asset with these sections is refused."""
    with pytest.raises(SettingsError) as caught:
        asset(**sections)
    return str(caught.value)


def test_a_row_says_only_what_differs() -> None:
    faults = asset(faults={"battery_low": {"below": 20, "for": 2, "reaction": "warn"}}).faults
    row, usual = faults.battery_low, FaultTable().battery_low
    assert (row.window.below, row.window.for_s, row.reaction) == (20.0, 2.0, Reaction.WARN)
    assert (row.when, row.clears) == (usual.when, ClearPolicy.ON_RESUME)
    assert faults.tilt_limit == FaultTable().tilt_limit


def test_a_window_of_several_says_only_what_differs() -> None:
    usual = FaultTable().odometry_off_gyro
    quick, slow, *others = usual.windows
    row = asset(faults={"odometry_off_gyro": {"slow": {"above": "3deg"}}}).faults.odometry_off_gyro
    assert row.windows == (quick, replace(slow, above=radians(3.0)), *others)
    row = asset(faults={"odometry_off_gyro": {"reaction": "warn"}}).faults.odometry_off_gyro
    assert row == replace(usual, reaction=Reaction.WARN)


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ({"tilt_limit": {"above": 28}}, "28 is not in 0.05 .. 1.5 rad: were degrees meant?"),
        ({"batery_low": {"below": 20}}, "did you mean battery_low?"),
        ({"battery_low": {"above": 20}}, "battery_low.above is not known; known are below"),
        ({"battery_low": {"bellow": 20}}, "did you mean below?"),
        ({"battery_low": {"below": "22V"}}, "expected a number"),
        (
            {"battery_low": {"reaction": "panic"}},
            "none of ignore, warn, slow_down, pause, stop, safe",
        ),
        ({"battery_low": {"for": -1}}, "-1 is not in 0 .. 60 s"),
        ({"battery_low": 22}, "expected keys and values"),
        ({"travel_slip": {"above": 1}}, "when, reaction, clears, quick, slow, quick_fused"),
        (
            {"travel_slip": {"slo": {"above": 1}}},
            "travel_slip: unknown key 'slo' (did you mean slow?)",
        ),
        (
            {"travel_slip": {"slow": {"below": 1}}},
            "travel_slip.slow.below is not known; known are above",
        ),
        (
            {"travel_slip": {"slow": {"above": 99}}},
            "travel_slip.slow.above: 99 is not in 0.01 .. 10 m",
        ),
        ({"travel_slip": {"slow": 1}}, "travel_slip.slow: expected keys and values"),
        ([], "faults: expected keys and values, got []"),
    ],
)
def test_what_no_row_can_say_is_refused(faults: object, said: str) -> None:
    assert said in refused(faults=faults)


def test_an_angle_may_be_written_in_degrees() -> None:
    assert asset(
        faults={"tilt_limit": {"above": "28deg"}}
    ).faults.tilt_limit.bound == pytest.approx(0.48869, abs=1e-5)


def test_scenarios_change_rows_as_strictly() -> None:
    def changed(key: str, value: str) -> FaultTable:
        change = Override(f"settings.faults.{key}", value)
        return load_scenario("motion_turn", RunMode.LOCK_STEP, [change]).settings.faults

    assert changed("tilt_limit.above", "20deg").tilt_limit.bound == pytest.approx(0.349, abs=1e-3)
    assert changed("travel_slip.slow.above", "0.2").travel_slip.windows[1].bound == 0.2
    with pytest.raises(SettingsError, match="were degrees meant"):
        changed("tilt_limit.above", "28")


@pytest.mark.parametrize("name", ["jackal", "mocup"])
def test_what_ships_is_read(name: str) -> None:
    assert load_settings(name).faults.battery_low.bound > 0


def test_each_fault_is_watched_for_and_has_a_reason_of_the_safety_block() -> None:
    assert set(MONITORS) == set(DECLARED)
    reasons = {declared.reason for declared in DECLARED.values()}
    assert all(900 < each.value < 1000 for each in reasons - {Reason.NAVIGATION_UNCOMMANDED_MOTION})
    assert Reason.TILT_LIMIT is DECLARED["tilt_limit"].reason


@given(st.sampled_from(sorted(DECLARED)), st.floats(allow_nan=False, width=32))
def test_every_figure_is_within_what_its_fault_allows_or_refused(name: str, value: float) -> None:
    declared = DECLARED[name]
    key = "below" if declared.below else "above"
    bound = declared.below or declared.above
    if bound is None:
        return
    for index, window in enumerate(declared.row.windows):
        said: object = {window.name: {key: value}} if window.name else {key: value}
        if bound.low <= value <= bound.high:
            table = structure({name: said}, FaultTable, "rover.yaml")
            assert getattr(table, name).windows[index].bound == value
        else:
            path = rf"{name}\.({window.name}\.)?{key}: "
            with pytest.raises(SettingsError, match=rf"^rover.yaml: .*{path}"):
                structure({name: said}, FaultTable, "rover.yaml")


@pytest.mark.parametrize("asset", shipped_names())
def test_settings_are_read_as_they_were_written(asset: str) -> None:
    settings = load_settings(asset)
    text = yaml.safe_dump(unstructure(settings))
    assert structure(yaml.safe_load(text), Settings, "again") == settings
