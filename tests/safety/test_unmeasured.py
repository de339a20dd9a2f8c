"""What sensors do not measure, or cannot, is invalid, or listed as not monitored."""

from dataclasses import replace
from math import inf, nan
from pathlib import Path

import pytest

from executive.commands import MoveForward
from executive.safety import unmonitored
from executive.settings import BatterySettings, LaserSettings, Settings, load_settings
from executive.values.facts import Battery, Imu, Joints
from executive.values.geometry import Pose
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import ReportKind
from tests.support.kinematic import Bench, with_figures
from trees import snapshot_of

SENSED = load_settings("jackal")


def warnings(bench: Bench) -> list[Reason | UnknownReason | None]:
    return [each.reason for each in bench.received.reports if each.kind is ReportKind.EVENT]


def gaps(bench: Bench) -> dict[str, tuple[str, ...]]:
    found = unmonitored(bench.executive.settings, bench.executive.safety.history)
    return {str(each): each.faults for each in found}


def test_what_is_configured_and_not_measured_is_listed_as_not_monitored(tmp_path: Path) -> None:
    powered = replace(SENSED, battery=BatterySettings(1e6))
    with Bench(tmp_path, powered, all_sensors=True) as bench:
        assert "not monitored: charge for the return: the battery reports no charge" in gaps(bench)
        bench.charge_ratio = 0.8
        bench.rover.facts = [
            Joints(1.0, (0.0, 0.0), (0.0, 0.0)),
            Imu(1.0, nan, nan, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81),
        ]
        bench.step()
        found = gaps(bench)
        assert not any("charge" in each or "battery" in each for each in found)
        assert found["not monitored: the motors: joint states have no efforts"]
        assert (
            "tilt_limit_imu"
            in found["not monitored: wheel spin and tilt by the IMU: it measures no orientation"]
        )
        assert (
            "the motors (joint states have no efforts)"
            in snapshot_of(bench.executive, 0.0).unmonitored
        )
        bench.rover.facts = [
            Joints(2.0, (0.0, 0.0), (0.0, 0.0), (1.0, 1.0), (1.0, 1.0)),
            Imu(2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81),
        ]
        bench.step()
        assert not any("motors" in each or "IMU" in each for each in gaps(bench))


def test_a_battery_that_reports_no_voltage_is_listed_as_not_monitored(bench: Bench) -> None:
    quiet = unmonitored(SENSED, type(bench.executive.safety)(bench.clock, SENSED).history)
    (gap,) = (each for each in quiet if each.cause == "no voltage received")
    assert gap.faults == ("battery_low", "battery_silent")
    assert not any("no voltage" in each for each in gaps(bench))


def test_a_laser_without_a_footprint_is_listed_as_not_monitored() -> None:
    bare: Settings = replace(
        SENSED,
        footprint=None,
        sensors=replace(SENSED.sensors, laser=LaserSettings(10)),
    )
    (gap,) = (each for each in unmonitored(bare) if each.cause == "footprint is not given")
    assert "laser_blind" in gap.faults


def test_a_charge_of_zero_is_empty(bench: Bench) -> None:
    bench.charge_ratio = 0.0
    bench.step()
    assert bench.refusal(MoveForward(1.0), 1).reason is Reason.BATTERY_INSUFFICIENT


@pytest.mark.parametrize("voltage_v", [65.535, 26_000.0, 3e38, inf, nan])
def test_a_voltage_that_no_battery_has_is_invalid(bench: Bench, voltage_v: float) -> None:
    bench.charge_ratio = 0.5
    bench.voltage_v = voltage_v
    bench.run(1.0)
    values = {each.parameter.name: each.value for each in bench.executive.parameters()}
    assert values["BATERY_VOLTAGE"] is None
    assert warnings(bench) == [Reason.BATTERY_NOT_FINITE]
    battery = bench.executive.status.battery
    assert battery is not None
    assert battery.charge_ratio == 0.5, "the charge is used all the same"


def test_the_highest_voltage_is_that_of_the_asset(tmp_path: Path) -> None:
    row = with_figures(SENSED.faults.battery_not_finite, above=500.0)
    tall = replace(SENSED, faults=replace(SENSED.faults, battery_not_finite=row))
    with Bench(tmp_path, tall) as bench:
        bench.voltage_v = 400.0
        bench.run(1.0)
        assert bench.executive.status.battery == Battery(400.0)
        assert not warnings(bench)


def test_a_jump_of_the_odometry_is_no_length_of_the_way(bench: Bench) -> None:
    bench.drive_on(1.0)
    before_m = bench.executive.status.travelled_m
    bench.rover.pose = replace(bench.rover.pose, y_m=5.0)
    bench.run(0.2)
    last = bench.last(1)
    assert last.reason is Reason.ODOMETRY_JUMPED
    (length,) = (each.value for each in last.figures if each.name == "length")
    assert length == pytest.approx(before_m, abs=0.2)
    assert bench.executive.status.travelled_m < before_m + 0.2


def test_odometry_that_begins_anew_at_its_origin_adds_no_way(bench: Bench) -> None:
    bench.execute(MoveForward(2.0), 1)
    travelled_m = bench.executive.status.travelled_m
    bench.odometry = False
    bench.run(3.0)
    bench.odometry = True
    bench.rover.pose = Pose()
    bench.run(1.0)
    assert bench.executive.status.travelled_m == pytest.approx(travelled_m, abs=0.01)


def test_of_an_imu_without_accelerations_the_gyro_is_used(tmp_path: Path) -> None:
    with Bench(tmp_path, SENSED, all_sensors=True) as bench:
        bench.rover.facts = [
            Imu(0.02 * at, 0.0, 0.0, 0.0, 0.0, 0.1, nan, nan, nan) for at in range(1, 20)
        ]
        bench.step()
        (faults,) = (each for name, each in gaps(bench).items() if "no acceleration" in name)
        assert faults == ("wheel_slip", "motion_blocked")
        inertia = bench.executive.safety.history.inertia
        assert inertia is not None
        assert inertia.sums.sums[0] > 0.0
        assert list(inertia.sums.sums[1:]) == pytest.approx([0.0, 0.0], abs=0.01)
