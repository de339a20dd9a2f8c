"""Odometry as drivers of real robots publish it stops nothing, and hides no fault."""

from collections.abc import Callable, Sequence
from csv import DictReader
from dataclasses import replace
from math import cos, sin
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from executive.faults import Reaction
from executive.safety.twist_delay import TwistDelay
from executive.settings import OdometrySettings, Settings, load_settings
from executive.values.facts import Odometry
from executive.values.geometry import Pose, Velocity
from tests.support.odometry_drive import TICK_S, Change, Driver, asset, begun, motion, watched

AHEAD = ((4.0, 0.0, 0.0), (6.0, 0.8, 0.0))
FROM_S = 7.0


def lost(_: Odometry) -> None:
    return None


@pytest.mark.at_length
@pytest.mark.parametrize("declared", [False, True])
@pytest.mark.parametrize("rate_hz", [8.0, 10.0, 20.0, 50.0])
def test_a_robot_from_8_hz_drives(rate_hz: float, declared: bool) -> None:
    settings = asset(OdometrySettings(rate_hz) if declared else None)
    assert not begun(settings, Driver(rate_hz))


def test_odometry_at_10_hz_may_vary_and_lose_messages() -> None:
    assert not begun(asset(), Driver(10.0, jitter_ratio=0.1, lost_ratio=0.03))


@pytest.mark.at_length
@pytest.mark.parametrize("rate_hz", [4.0, 5.0])
def test_odometry_that_is_slower_than_that_is_a_fault(rate_hz: float) -> None:
    assert "odometry_rate_low" in {name for _, name in begun(asset(), Driver(rate_hz))}


@pytest.mark.parametrize(("rate_hz", "within_s"), [(50.0, 0.36), (10.0, 0.46), (8.0, 0.56)])
def test_lost_odometry_is_stale_after_three_periods_at_least(
    rate_hz: float, within_s: float
) -> None:
    at_s, name = begun(asset(), Driver(rate_hz), AHEAD, from_s=FROM_S, wrong=lost)[0]
    assert name == "odometry_stale"
    assert 0.2 < at_s - FROM_S <= within_s


def test_odometry_that_slows_down_in_motion_is_not_learnt() -> None:
    number = iter(range(10_000))
    seldom = begun(
        asset(),
        Driver(50.0),
        AHEAD,
        from_s=5.0,
        wrong=lambda fact: fact if next(number) % 6 == 0 else None,
    )
    assert seldom[0][1] == "odometry_rate_low"
    assert seldom[0][0] <= 6.5


@pytest.mark.at_length
@pytest.mark.parametrize(
    "driver",
    [
        Driver(50.0, unwrapped=True),
        Driver(50.0, unwrapped=True, mean_of=4),
        Driver(10.0, unwrapped=True),
    ],
)
def test_a_rate_that_its_driver_does_not_wrap_is_that_of_the_pose(driver: Driver) -> None:
    spin = ((4.0, 0.0, 0.0), (8.0, 0.3, 1.2), (8.0, 0.0, -1.2))
    assert not begun(asset(), driver, spin)


def test_a_wrong_rate_elsewhere_is_seen() -> None:
    def wrong(fact: Odometry) -> Odometry:
        return replace(fact, velocity=Velocity(0.8, 2.0))

    spin = ((4.0, 0.0, 0.0), (8.0, 0.8, 1.2))
    at_s, name = begun(asset(), Driver(50.0), spin, from_s=FROM_S, wrong=wrong)[0]
    assert name == "odometry_heading_off_twist"
    assert at_s - FROM_S <= 0.3


@pytest.mark.at_length
@pytest.mark.parametrize(
    "driver",
    [
        Driver(50.0, stall_s=0.16, stamped_on_arrival=True),
        Driver(62.0, stall_s=0.16, stamped_on_arrival=True, jitter_ratio=0.3),
        Driver(50.0, stall_s=0.12),
        Driver(10.0, stall_s=0.2),
    ],
)
def test_gaps_and_bursts_are_no_motion(driver: Driver) -> None:
    assert not begun(asset(), driver)


def test_a_step_aside_is_seen_soon_after_a_gap() -> None:
    def aside(fact: Odometry) -> Odometry:
        return replace(fact, pose=replace(fact.pose, y_m=fact.pose.y_m + 0.3))

    driver = Driver(50.0, stall_s=0.12)
    at_s, name = begun(asset(), driver, AHEAD, from_s=5.6, wrong=aside)[0]
    assert name in {"odometry_jumped", "odometry_off_twist"}
    assert at_s - 5.6 <= 0.15


MEAN_OF_1_S = OdometrySettings(10.0, 1.0)


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("declared", "driver"),
    [
        (None, Driver(50.0, mean_of=10)),
        (None, Driver(50.0, behind_s=0.1)),
        (None, Driver(62.0, mean_of=10, jitter_ratio=0.3)),
        (None, Driver(50.0, mean_of=10, unwrapped=True)),
        (MEAN_OF_1_S, Driver(10.0, mean_of=10)),
        (MEAN_OF_1_S, Driver(10.0, mean_of=10, jitter_ratio=0.1, lost_ratio=0.03)),
    ],
)
def test_a_twist_that_is_a_mean_or_late_is_that_of_earlier_motion(
    declared: OdometrySettings | None, driver: Driver
) -> None:
    assert not begun(asset(declared), driver)


@pytest.mark.at_length
def test_a_mean_twist_at_10_hz_is_learnt_within_a_second_of_motion() -> None:
    assert len(begun(asset(), Driver(10.0, mean_of=10))) <= 1


def holding() -> Change:
    held: list[Pose] = []

    def wrong(fact: Odometry) -> Odometry:
        held.append(fact.pose)
        return replace(fact, pose=held[0])

    return wrong


def drifting() -> Change:
    def wrong(fact: Odometry) -> Odometry:
        pose = replace(fact.pose, x_m=fact.pose.x_m + 0.5 * (fact.stamp_s - FROM_S))
        return replace(fact, pose=pose)

    return wrong


@pytest.mark.alike
@pytest.mark.parametrize(
    ("declared", "driver", "make", "within_s"),
    [
        (MEAN_OF_1_S, Driver(10.0, mean_of=10), holding, 1.3),
        (None, Driver(50.0), holding, 0.2),
        (None, Driver(50.0), drifting, 0.35),
        (None, Driver(50.0, mean_of=10), holding, 0.35),
        (None, Driver(50.0, mean_of=10), drifting, 0.6),
        (MEAN_OF_1_S, Driver(10.0, mean_of=10), drifting, 1.5),
    ],
)
def test_a_pose_that_leaves_its_twist_is_seen_after_the_mean_at_the_latest(
    declared: OdometrySettings | None, driver: Driver, make: Callable[[], Change], within_s: float
) -> None:
    at_s, name = begun(asset(declared), driver, AHEAD, from_s=FROM_S, wrong=make())[0]
    assert name in {"odometry_off_twist", "odometry_frozen"}
    assert at_s - FROM_S <= within_s


REST = ((8.0, 0.0, 0.0),)


@pytest.mark.at_length
@pytest.mark.parametrize(
    "driver",
    [
        Driver(50.0, noise_m=0.0005),
        Driver(50.0, noise_m=0.002),
        Driver(10.0, noise_m=0.01, noise_rad=0.005),
        Driver(62.0, jitter_ratio=0.3, noise_m=0.0001, noise_rad=0.0003),
    ],
)
def test_noise_at_rest_is_no_motion(driver: Driver) -> None:
    assert not begun(moving_asset(), driver, (*AHEAD, *REST))


@pytest.mark.at_length
@pytest.mark.parametrize("driver", [Driver(50.0), Driver(50.0, noise_m=0.0005), Driver(10.0)])
def test_a_creep_at_rest_is_seen_within_its_window(driver: Driver) -> None:
    at_s, name = begun(moving_asset(), driver, (*AHEAD, *REST), from_s=16.0, wrong=creeping)[0]
    assert name == "uncommanded_travel"
    assert at_s - 16.0 <= 1.1


def test_a_turn_at_rest_is_seen_within_its_window() -> None:
    at_s, name = begun(moving_asset(), Driver(50.0), REST, from_s=4.0, wrong=turning)[0]
    assert name == "uncommanded_turn"
    assert at_s - 4.0 <= 0.8


def test_no_circle_at_rest_is_missed_that_leads_away() -> None:
    def circling(fact: Odometry) -> Odometry:
        turned_rad = 0.5 * (fact.stamp_s - 4.0)
        return replace(fact, pose=Pose(0.3 * sin(turned_rad), 0.3 * (1.0 - cos(turned_rad))))

    at_s, name = begun(moving_asset(), Driver(50.0), REST, from_s=4.0, wrong=circling)[0]
    assert name == "uncommanded_travel"
    assert at_s - 4.0 <= 1.0


@pytest.mark.parametrize("noise_m", [0.00005, 0.002])
def test_noise_at_rest_is_no_twist_delay(noise_m: float) -> None:
    twist = TwistDelay()
    for at_s, fact in Driver(50.0, noise_m=noise_m).publish(motion(REST)):
        twist.observe(at_s, fact.pose.x_m, fact.pose.heading_rad, fact.velocity, 0.02)
    assert twist.delay_s == 0.0


def moving_asset() -> Settings:
    """Return an asset that is watched for nothing but uncommanded motion."""
    settings = asset()
    rows = {
        name: replace(getattr(settings.faults, name), reaction=Reaction.IGNORE)
        for name in ("odometry_off_twist", "odometry_heading_off_twist", "odometry_jumped")
    }
    return replace(settings, faults=replace(settings.faults, **rows))


def creeping(fact: Odometry) -> Odometry:
    pose = replace(fact.pose, x_m=fact.pose.x_m + 0.07 * (fact.stamp_s - 16.0))
    return replace(fact, pose=pose)


def turning(fact: Odometry) -> Odometry:
    return replace(fact, pose=replace(fact.pose, heading_rad=0.03 * (fact.stamp_s - 4.0)))


def recorded() -> list[tuple[float, Odometry]]:
    """Return the odometry of a real rover outdoors, with its times of arrival."""
    with (Path(__file__).parent / "data" / "husky_odometry.csv").open() as file:
        rows = [{name: float(value) for name, value in row.items()} for row in DictReader(file)]
    return [
        (
            row["arrival_s"],
            Odometry(
                row["stamp_s"],
                Pose(row["x_m"], row["y_m"], heading_rad=row["heading_rad"]),
                Velocity(row["travel_mps"], row["rotate_radps"]),
            ),
        )
        for row in rows
    ]


def commanded(facts: Sequence[tuple[float, Odometry]]) -> list[Velocity]:
    """Return what may have been commanded: the mean velocity around a time 0.1 s later."""
    found = []
    for tick in range(int(facts[-1][0] / TICK_S)):
        now_s = tick * TICK_S + 0.1
        near = [each.velocity for at_s, each in facts if abs(at_s - now_s) <= 0.15]
        travel_mps = fmean(each.travel_mps for each in near) if near else 0.0
        rotate_radps = fmean(each.rotate_radps for each in near) if near else 0.0
        found.append(
            Velocity(
                travel_mps if abs(travel_mps) >= 0.01 else 0.0,
                rotate_radps if abs(rotate_radps) >= 0.01 else 0.0,
            )
        )
    return found


@pytest.mark.at_length
@pytest.mark.parametrize("declared", [None, MEAN_OF_1_S])
def test_a_real_rover_drives_for_a_minute(declared: OdometrySettings | None) -> None:
    facts = recorded()
    assert not watched(asset(declared), facts, commanded(facts))


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("make", "within_s"), [(holding, 1.3), (drifting, 1.5), (lambda: lost, 0.45)]
)
def test_what_goes_wrong_in_a_real_rover_is_seen(
    make: Callable[[], Change], within_s: float
) -> None:
    told, wrong = recorded(), make()
    facts = [
        (at_s, changed)
        for at_s, fact in told
        if (changed := fact if at_s < FROM_S else wrong(fact)) is not None
    ]
    found = watched(asset(MEAN_OF_1_S), facts, commanded(told))
    assert 0.0 < found[0][0] - FROM_S <= within_s


@pytest.mark.parametrize(
    ("figures", "says"),
    [
        ({"rate_hz": 0.0}, "rate_hz must be above 0"),
        ({"twist_mean_s": -0.1}, "twist_mean_s is -0.1: 0 to 2.5 s"),
        ({"twist_mean_s": 3.0}, "twist_mean_s is 3: 0 to 2.5 s"),
    ],
)
def test_figures_of_an_odometry_that_none_has_are_refused(
    figures: dict[str, Any], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        OdometrySettings(**figures)


@pytest.mark.at_length
def test_what_an_asset_declares_is_not_learnt() -> None:
    assert load_settings("jackal").odometry == OdometrySettings(50.0, 0.0)
    slow = {name for _, name in begun(asset(OdometrySettings(50.0)), Driver(8.0))}
    assert "odometry_rate_low" in slow
