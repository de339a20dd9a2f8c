"""The slip that odometry does not know of is added to its pose."""

from collections.abc import Iterable
from dataclasses import replace
from math import pi

import pytest

from executive.settings import Controller, SettingsError, SlipSettings, load_settings, structure
from executive.state import Status
from executive.state.slip import MAX_GAP_S, SlipCorrection
from executive.values.clock import ManualClock
from executive.values.facts import Odometry
from executive.values.geometry import Pose, Velocity
from sim.rover.jackal import SimulatedJackal
from sim.rover.world import World
from tests.sim.driving import COMMAND_PERIOD_S

PERIOD_S = 0.02
NONE = SlipSettings()
JACKAL = load_settings("jackal").mpc


def moved(correction: SlipCorrection, velocities: Iterable[Velocity]) -> Pose:
    """Return the corrected pose of odometry that stays at the origin, after these velocities."""
    pose = Pose()
    for number, velocity in enumerate(velocities):
        pose = correction.corrected(Odometry(number * PERIOD_S, Pose(), velocity)).pose
    return pose


def test_a_spin_moves_aside_by_the_offset() -> None:
    correction = SlipCorrection(SlipSettings(offset_m=0.04), SlipSettings(offset_m=0.01))
    pose = moved(correction, [Velocity(0.0, 1.0)] * 51)
    assert (pose.x_m, pose.y_m) == pytest.approx((0.0, -0.03))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_curve_moves_aside_outward_by_its_speed(sign: float) -> None:
    correction = SlipCorrection(SlipSettings(gain_m=0.06), NONE)
    pose = moved(correction, [Velocity(1.0, sign)] * 51)
    assert pose.y_m == pytest.approx(-0.06 * sign)
    back = moved(SlipCorrection(SlipSettings(gain_m=0.06), NONE), [Velocity(-1.0, sign)] * 51)
    assert back.y_m == pytest.approx(0.06 * sign)


def test_braking_in_a_curve_moves_further_outward() -> None:
    braking = [Velocity(1.0 - PERIOD_S * number, 1.0) for number in range(51)]
    pose = moved(SlipCorrection(SlipSettings(acceleration_s2=0.05), NONE), braking)
    assert pose.y_m == pytest.approx(-0.05)


def test_braking_in_a_turn_covers_more_than_the_wheels_measure() -> None:
    braking = [Velocity(1.0 - PERIOD_S * number, -1.0) for number in range(51)]
    pose = moved(SlipCorrection(SlipSettings(creep_s2=0.03), NONE), braking)
    assert (pose.x_m, pose.y_m) == pytest.approx((0.03, 0.0))


def test_slip_settles_with_its_time_constant() -> None:
    law = SlipSettings(gain_m=0.1, lag_s=0.1)
    pose = moved(SlipCorrection(law, NONE), [Velocity(1.0, 1.0)] * 101)
    assert pose.y_m == pytest.approx(-0.1 * (2.0 - 0.1), abs=0.002)


def test_it_is_added_across_the_heading() -> None:
    correction = SlipCorrection(SlipSettings(offset_m=0.1), NONE)
    for number in range(51):
        fact = Odometry(number * PERIOD_S, Pose(heading_rad=pi / 2), Velocity(0.0, 1.0))
        pose = correction.corrected(fact).pose
    assert (pose.x_m, pose.y_m) == pytest.approx((0.1, 0.0))
    assert pose.heading_rad == pi / 2


def test_repeated_odometry_and_odometry_after_a_gap_add_nothing() -> None:
    correction = SlipCorrection(SlipSettings(offset_m=0.1), NONE)
    for stamp_s in (0.0, 0.0, 2 * MAX_GAP_S, MAX_GAP_S):
        fact = Odometry(stamp_s, Pose(), Velocity(0.0, 1.0))
        assert correction.corrected(fact) == fact


def test_only_mpc_with_a_slip_of_its_odometry_corrects_the_pose() -> None:
    settings = load_settings("jackal")
    facts = [Odometry(number * PERIOD_S, Pose(), Velocity(1.0, 1.0)) for number in range(51)]
    plain = replace(settings.mpc, odometry_slip=None)
    mpc = replace(settings, controller=Controller.MPC)
    for chosen, corrects in ((settings, False), (mpc, True), (replace(mpc, mpc=plain), False)):
        status = Status(ManualClock(), chosen)
        for fact in facts:
            status.observe(fact)
        assert (status.pose != Pose()) is corrects


def test_braking_in_curves_is_known_far_better_than_to_the_odometry_alone() -> None:
    """The laws of the asset, over curves that brake and turn, as plans of least time do."""
    assert JACKAL.odometry_slip is not None
    apart_m, raw_m = [], []
    for sign in (1.0, -1.0):
        rover = SimulatedJackal(World())
        correction = SlipCorrection(JACKAL.slip, JACKAL.odometry_slip)
        seen = rover.true_pose
        velocity = Velocity(0.0, 0.0)
        for towards in (Velocity(1.0, 0.3 * sign), Velocity(0.0, 1.5 * sign), Velocity(0.0, 0.0)):
            for _ in range(30):
                travel, rotate = velocity.travel_mps, velocity.rotate_radps
                velocity = Velocity(
                    travel + max(-0.05, min(0.05, towards.travel_mps - travel)),
                    rotate + max(-0.15, min(0.15, towards.rotate_radps - rotate)),
                )
                rover.drive(velocity)
                rover.advance(COMMAND_PERIOD_S)
                for fact in rover.facts():
                    if isinstance(fact, Odometry):
                        seen = correction.corrected(fact).pose
        true, raw = rover.true_pose, rover.odometry.pose
        apart_m.append(true.point.distance_m(seen.point))
        raw_m.append(true.point.distance_m(raw.point))
    assert max(apart_m) < 0.025
    assert min(raw_m) > 2 * max(apart_m)


def test_a_lag_that_cannot_be_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"lag_s is -1\.0: 0 to 1"):
        structure({"lag_s": -1.0}, SlipSettings, "slip")
