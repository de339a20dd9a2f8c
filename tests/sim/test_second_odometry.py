"""A simulated Jackal on a slope: visual odometry verifies its motions, or corrects its pose."""

from dataclasses import replace
from math import radians
from pathlib import Path

import pytest

from executive.commands import Command, MoveTo, Waypoint
from executive.settings import SecondOdometrySettings, load_settings
from executive.values.geometry import Point
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, Stage
from sim.rover.lockstep import LockStep
from sim.rover.world import World

GOALS = (Point(2.0, 1.5), Point(0.5, -1.0), Point(-1.0, 1.0))


def ends(folder: Path, fused: bool, slope_rad: float) -> list[tuple[Report, float]]:
    """Drive to places one after the other; return how each ended, and how far off truly."""
    jackal = load_settings("jackal")
    second = SecondOdometrySettings(2, fused)
    settings = replace(jackal, sensors=replace(jackal.sensors, second_odometry=second))
    run = LockStep(settings, World(slope_rad=slope_rad), folder, seed=5)
    run.run(1.0)
    found = []
    for number, goal in enumerate(GOALS, start=1):
        heading_rad = 1.5 * number - 3.0
        request = MoveTo(Waypoint(goal.x_m, goal.y_m, heading_rad))
        identity = Identity("MOE", number)
        run.submit(Command(identity, request, "direct"))

        def ended(identity: Identity = identity) -> bool:
            last = [r for r in run.downlink_record.reports if r.identity == identity][-1]
            return last.stage is not None and last.stage.terminal

        assert run.run_until(ended, 60.0)
        last = [report for report in run.downlink_record.reports if report.identity == identity][-1]
        found.append((last, run.rover.true_pose.point.distance_m(goal)))
    run.executive.simulate_crash()
    return found


@pytest.mark.parametrize("slope_deg", [0, 10])
def test_with_a_fused_second_odometry_targets_are_reached(tmp_path: Path, slope_deg: float) -> None:
    for last, off_m in ends(tmp_path, fused=True, slope_rad=radians(slope_deg)):
        assert last.stage is Stage.EXECUTED, last.text
        assert "by odometry and second odometry" in last.text
        assert off_m < (0.14 if slope_deg else 0.06)


def test_without_fusion_what_slid_away_is_not_confirmed(tmp_path: Path) -> None:
    found = ends(tmp_path, fused=False, slope_rad=radians(10))
    reasons = [last.reason for last, _ in found if last.stage is not Stage.EXECUTED]
    assert Reason.NOT_CONFIRMED in reasons
    # A monitor may see it first; what it leaves of the pose refuses those that follow.
    assert set(reasons) <= {Reason.NOT_CONFIRMED, Reason.TRAVEL_SLIP, Reason.POSE_UNCERTAIN}
