"""What a check says of figures: problems, and the YAML lines of the asset to change."""

from dataclasses import replace
from math import atan2, nan
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.ros.check.advice import Change, TopicResult, advise, edits
from adapters.ros.check.figures import Figures, Mounting, Timing, Twist
from adapters.ros.check.listening import ReceivedTopic
from executive.settings import (
    ImuSettings,
    JointsSettings,
    OdometrySettings,
    Sensors,
    Settings,
    load_settings,
    settings_reader,
)
from executive.values.geometry import Rotation, inclination
from tests.suite import CHECKOUT

GOOD = Timing(rate_hz=50.0, gap_s=0.03, age_s=0.01, jitter_s=0.01)
MOMENTARY = Twist(0.0, False, 0.001, 0.001)
NONE = Figures()


def asset(odometry: OdometrySettings, **sensors: object) -> Settings:
    settings = replace(load_settings("jackal"), odometry=odometry)
    return replace(settings, sensors=Sensors(**sensors))  # type: ignore[arg-type]


DECLARED = asset(
    OdometrySettings(50.0, 0.0), imu=ImuSettings(50.0), joints=JointsSettings(50.0, 0.1, 0.5)
)
LEARNT = asset(OdometrySettings())


def said(
    settings: Settings, figures: Figures = NONE, **times: Timing
) -> tuple[list[str], dict[str, object]]:
    """Return the problems, and the lines to change as data."""
    topics = [TopicResult(key, f"/{key}", "", (), (), (), each) for key, each in times.items()]
    found = advise(settings, topics, figures)
    lines: dict[str, object] = {}
    for change in (change for each in found for change in each.changes):
        *sections, last = change.key.split(".")
        inner: Any = lines
        for section in sections:
            inner = inner.setdefault(section, {})
        inner[last] = change.value
    return [each.text for each in found if each.is_problem], lines


def test_a_robot_as_declared_has_no_problem_and_no_line() -> None:
    level = Mounting((0.0, 0.0, 1.0), True, 0.0)
    figures = Figures(MOMENTARY, 0.0, 0.0, level, 1.0, 1.02, 0.99)
    assert said(DECLARED, figures, odometry=GOOD, imu=GOOD, joints=GOOD) == ([], {})


def test_what_is_not_declared_is_proposed_in_one_section() -> None:
    mean = Figures(Twist(0.2004, False, 0.001, 0.1))
    assert said(LEARNT, mean, odometry=replace(GOOD, rate_hz=10.09)) == (
        [],
        {"odometry": {"rate_hz": 10.0, "twist_mean_s": 0.2}},
    )


@pytest.mark.parametrize(
    ("timing", "text"),
    [
        (replace(GOOD, rate_hz=5.0), "odometry of 5.0 Hz is too rare: 8 at least"),
        (replace(GOOD, gap_s=0.5), "odometry had a gap of 0.50 s: above 0.30 s it is stale"),
        (replace(GOOD, age_s=0.2), "odometry arrives 0.20 s after its stamp"),
        (replace(GOOD, jitter_s=0.3), "odometry arrives after its stamps by times that vary"),
    ],
)
def test_times_that_stop_the_rover_are_problems(timing: Timing, text: str) -> None:
    problems, _ = said(LEARNT, odometry=timing)
    assert any(each.startswith(text) for each in problems), problems


@pytest.mark.parametrize("age_s", [-3600.0, 1.7e9, -0.5])
def test_an_offset_of_the_clocks_is_no_problem(age_s: float) -> None:
    assert said(LEARNT, odometry=replace(GOOD, age_s=age_s))[0] == []


def test_a_declared_figure_that_differs_is_a_problem_with_its_line() -> None:
    late = Figures(Twist(0.1, True, 0.001, 0.1))
    problems, lines = said(DECLARED, late, odometry=GOOD, imu=replace(GOOD, rate_hz=100.0))
    assert problems == [
        "imu arrives at 100.0 Hz; the settings give 50 Hz",
        "the twist of the odometry is 0.1 s late (0.001 m/s are left)",
    ]
    assert lines == {"sensors": {"imu": {"rate_hz": 100.0}}, "odometry": {"twist_mean_s": 0.1}}


def mounting(roll: str, pitch: str, yaw: str) -> dict[str, object]:
    lines = {"roll": roll, "pitch": pitch, "yaw": yaw}
    return {"sensors": {"imu": {"mounting": lines}}}


def test_an_imu_on_its_side_has_the_line_of_its_mounting() -> None:
    on_its_side = Mounting((0.02, 1.0, 0.0), True, 0.0, -1.5, 0.01)
    problems, lines = said(DECLARED, Figures(mounting=on_its_side))
    assert problems == ["the axes of the IMU are not those of base_link: its +y axis points up"]
    assert lines == mounting("90deg", "0deg", "-90deg")
    problems, lines = said(DECLARED, Figures(mounting=replace(on_its_side, yaw_rad=None)))
    assert problems[0].endswith("; yaw needs a drive (--drive)")
    assert lines == mounting("90deg", "0deg", "0deg")


@given(roll=st.floats(-3.1, 3.1), pitch=st.floats(-1.4, 1.4), yaw=st.floats(-3.1, 3.1))
def test_any_mounting_is_found_from_the_directions_up_and_ahead(
    roll: float, pitch: float, yaw: float
) -> None:
    """Also by an asset with another one: the readings are in axes of neither."""
    true, wrong = Rotation(roll, pitch, yaw), Rotation(0.3, -0.4, 2.0)
    up, ahead = (wrong.apply(true.reverse(each)) for each in ((0, 0, 1), (1, 0, 0)))
    x, y, _ = Rotation(*inclination(up)).apply(ahead)
    imu = ImuSettings(50.0, wrong)
    found = Mounting(up, True, 0.0, -atan2(y, x))
    _, lines = said(asset(OdometrySettings(), imu=imu), Figures(mounting=found))
    if not lines:  # near enough
        assert up == pytest.approx((0, 0, 1), abs=0.2)
        return
    sensors = settings_reader({}).overlay(Sensors(imu=imu), lines["sensors"], "sensors")
    written = sensors.imu.mounting if sensors.imu else None
    assert written is not None
    for axis in ((0, 0, 1), (1, 0, 0)):
        assert written.apply(true.reverse(axis)) == pytest.approx(axis, abs=0.35)


def test_an_orientation_of_other_axes_is_a_problem() -> None:
    contrary = Mounting((0.0, 0.0, 1.0), True, 0.0, off_rad=1.57)
    assert said(DECLARED, Figures(mounting=contrary))[0] == [
        "the orientation of the IMU contradicts gravity by 90 deg: let its driver omit it"
        " (covariance -1)"
    ]


def test_radius_and_track_fit_together() -> None:
    """Wheels of half the radius: they report twice the travel and twice the turn."""
    _, lines = said(DECLARED, Figures(wheels_turn=2.0, wheels_travel=2.0))
    assert lines == {"sensors": {"joints": {"wheel_radius_m": 0.05}}}
    _, lines = said(DECLARED, Figures(wheels_turn=1.2, wheels_travel=1.0))
    assert lines == {"sensors": {"joints": {"track_m": 0.6}}}


def test_changes_name_the_keys_that_exist_already() -> None:
    folder = CHECKOUT / "config" / "robots"
    files = folder / "turtlebot4.yaml", folder / "turtlebot4.ros.yaml"
    changes = [
        Change("cmd_vel.type", "a/msg/B"),
        Change("imu.topic", ""),
        Change("sensors.imu.rate_hz", 50.0, in_settings=True),
        Change("odometry.rate_hz", 20.0, in_settings=True),
    ]
    settings, topics = edits(*files, changes)
    assert settings.sections == "sensors:\n  imu: {rate_hz: 50.0}\nodometry: {rate_hz: 20.0}\n"
    assert settings.summary == "sensors.imu.rate_hz 100 → 50, odometry.rate_hz 20"
    assert topics.sections == (
        "cmd_vel: {topic: /cmd_vel, reliability: reliable, depth: 1, type: a/msg/B}\n"
        "imu: {topic: '', reliability: best_effort, depth: 100}\n"
    )
    assert edits(*files, [Change("imu.topic", "/imu")]) == (), "it has that value"


def test_stamps_that_are_zero_are_a_problem() -> None:
    stamp = SimpleNamespace(sec=0, nanosec=0)
    received = ReceivedTopic(lambda _: None)
    for index in range(10):
        received.fact(SimpleNamespace(header=SimpleNamespace(stamp=stamp)), float(index))
    assert received.problems == ["its stamps do not advance: all are 0 s"]
    unstamped = ReceivedTopic(lambda _: None, [(float(index), nan) for index in range(10)])
    assert unstamped.problems == []
