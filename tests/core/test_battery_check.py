"""What the battery cannot bring back is refused: when it is asked for, and again when it begins."""

from dataclasses import replace
from math import pi
from pathlib import Path

import pytest

from executive.checks import SpeedLimits, estimate_energy_j
from executive.commands import (
    ActivatePlan,
    DriveFor,
    FollowPath,
    Motion,
    MoveForward,
    MoveTo,
    PreemptionPolicy,
    RotateBy,
    RotateTo,
    SubmitPlan,
    Waypoint,
)
from executive.preview import Preview
from executive.settings import BatterySettings, SettingsError, load_settings, structure
from executive.values.geometry import Pose
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Stage
from tests.support.kinematic import Bench
from tests.support.plans import plan

JACKAL = load_settings("jackal")
THERE = MoveTo(Waypoint(30.0, 0.0))
RESERVE = 0.1


def charged(bench: Bench, left_j: float) -> None:
    """Have the battery tell so much above its reserve."""
    assert JACKAL.battery is not None
    bench.charge_ratio = RESERVE + left_j / JACKAL.battery.capacity_j
    bench.step()


def figures(refusal: Refusal) -> dict[str, float]:
    return {each.name: each.value for each in refusal.figures}


@pytest.mark.at_length
@pytest.mark.parametrize(
    "motion",
    [
        MoveTo(Waypoint(3.0, 2.0, pi / 2)),
        MoveForward(-1.5),
        RotateTo(2.0),
        RotateBy(-3.0),
        DriveFor(0.5, 0.3, 4.0),
        FollowPath((Waypoint(1.0, 0.0), Waypoint(1.0, 1.0, pi / 2), Waypoint(-1.0, 0.0))),
        MoveTo(Waypoint(-40.0, 7.0)),
    ],
)
def test_the_estimated_charge_equals_that_of_a_preview(bench: Bench, motion: Motion) -> None:
    run = bench.executive.preview(motion)
    assert not isinstance(run, Refusal)
    run.set_up()
    while not run.advance(100):
        pass
    assert isinstance(run.result, Preview)
    speeds = SpeedLimits(JACKAL.drive.travel_speed_mps, JACKAL.drive.rotate_speed_radps)
    estimated = estimate_energy_j(motion, Pose(), speeds, JACKAL, (JACKAL.zones, None))
    assert estimated == pytest.approx(run.result.energy_j, rel=0.1, abs=20.0)


def test_what_cannot_be_brought_back_is_refused_with_its_figures(bench: Bench) -> None:
    charged(bench, 3000.0)
    refusal = bench.refusal(THERE, 1)
    assert refusal.reason is Reason.BATTERY_INSUFFICIENT
    reported = figures(refusal)
    assert reported["needed"] > reported["left"] == pytest.approx(3000.0)
    assert 0.4 * reported["needed"] < reported["way back"] < 0.6 * reported["needed"]
    assert reported["reserve"] == pytest.approx(97_200.0)
    assert bench.stages(1) == [Stage.RECEIVED, Stage.REJECTED]
    previewed = bench.executive.preview(THERE)
    assert isinstance(previewed, Refusal)
    assert previewed.reason is Reason.BATTERY_INSUFFICIENT


def test_what_can_be_brought_back_is_carried_out(bench: Bench) -> None:
    charged(bench, 3000.0)
    bench.execute(MoveTo(Waypoint(3.0, 0.0)), 1)
    charged(bench, 5000.0)
    bench.submit(THERE, 2)
    bench.run(0.2)
    assert bench.stages(2)[-1] is Stage.STARTED


@pytest.mark.at_length
def test_the_return_home_is_allowed_at_any_charge(bench: Bench) -> None:
    bench.execute(MoveTo(Waypoint(4.0, 3.0)), 1)
    charged(bench, -5000.0)
    assert bench.refusal(MoveTo(Waypoint(5.0, 3.0)), 2).reason is Reason.BATTERY_INSUFFICIENT
    assert bench.refusal(MoveForward(0.5), 3).reason is Reason.BATTERY_INSUFFICIENT
    far = FollowPath((Waypoint(-4.0, 3.0), Waypoint(0.0, 0.0)))
    assert bench.refusal(far, 4).reason is Reason.BATTERY_INSUFFICIENT
    bench.execute(RotateBy(0.2), 5)
    bench.execute(MoveForward(-2.0), 6)
    bench.execute(MoveTo(Waypoint(0.0, 0.0)), 7)
    assert bench.refusal(RotateBy(pi), 8).reason is Reason.BATTERY_INSUFFICIENT


def test_it_is_checked_again_when_a_queued_motion_begins(bench: Bench) -> None:
    charged(bench, 5000.0)
    bench.submit(MoveTo(Waypoint(1.0, 0.0)), 1)
    bench.submit(THERE, 2)
    bench.submit(DriveFor(-0.5, 0.0, 60.0), 3)
    charged(bench, 1500.0)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.finish(2) is Stage.FAILED
    assert bench.last(2).reason is Reason.BATTERY_INSUFFICIENT
    assert bench.finish(3) is Stage.FAILED
    assert bench.last(3).reason is Reason.BATTERY_INSUFFICIENT
    assert bench.rover.pose.x_m == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("times", "taken"), [(1, True), (8, False)])
def test_a_plan_is_checked_as_a_whole(bench: Bench, times: int, taken: bool) -> None:
    leaf = '<moveForward distance="8" deadline_s="60"/>'
    back = '<moveForward distance="-8" deadline_s="60"/>'
    other = f"<Fallback>{leaf}{leaf * 5}</Fallback>"
    body = f'<Repeat num_cycles="{times}"><Sequence>{other}{back}</Sequence></Repeat>'
    charged(bench, 3000.0)
    bench.submit(SubmitPlan(plan(body)), 1)
    if taken:
        bench.execute(ActivatePlan("survey"), 2)
    else:
        assert bench.refusal(ActivatePlan("survey"), 2).reason is Reason.BATTERY_INSUFFICIENT


def test_without_battery_settings_no_motion_is_refused(tmp_path: Path) -> None:
    for folder, settings, ratio in (("a", JACKAL, None), ("b", replace(JACKAL, battery=None), 0.0)):
        (tmp_path / folder).mkdir()
        with Bench(tmp_path / folder, settings) as bench:
            bench.charge_ratio = ratio
            bench.step()
            bench.submit(THERE, 1)
            bench.run(0.2)
            assert bench.stages(1)[-1] is Stage.STARTED


def test_home_is_that_of_the_settings(tmp_path: Path) -> None:
    assert JACKAL.battery is not None
    battery = structure(
        {"capacity_j": 972_000, "reserve_ratio": RESERVE, "home": {"x_m": 30, "y_m": 0}},
        BatterySettings,
        "battery",
    )
    with Bench(tmp_path, replace(JACKAL, battery=battery)) as bench:
        charged(bench, 2000.0)
        bench.submit(THERE, 1)
        assert bench.refusal(
            MoveTo(Waypoint(-10.0, 0.0)), 2, preemption=PreemptionPolicy.REPLACE
        ).figures
        bench.run(0.2)
        assert bench.stages(1)[-1] is Stage.STARTED


def test_the_used_energy_is_reported_beside_its_prediction(bench: Bench) -> None:
    charged(bench, 500_000.0)
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 1)
    bench.run(0.2)
    charged(bench, 499_800.0)
    bench.finish(1)
    reported = {each.name: each.value for each in bench.last(1).figures}
    assert reported["energy"] == pytest.approx(200.0, abs=1.0)
    assert reported["predicted energy"] > 100.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"capacity_j": 0}, "capacity_j must be above 0"),
        ({"capacity_j": 1, "reserve_ratio": 20}, "reserve_ratio is 20.0: 0 to 0.9"),
        ({"capacity_j": 1, "home": {"x_m": 1e9, "y_m": 0}}, "home is farther than 10000 m"),
        ({"capacity": 1}, "capacity"),
    ],
)
def test_figures_that_cannot_be_are_named(given: dict[str, object], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        structure(given, BatterySettings, "battery")


def test_a_battery_needs_what_motion_takes_of_it() -> None:
    mocup = load_settings("mocup")
    with pytest.raises(ValueError, match=r"battery needs prediction\.standing_w"):
        replace(mocup, battery=BatterySettings(1000.0))
