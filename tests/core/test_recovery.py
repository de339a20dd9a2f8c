from dataclasses import replace

from executive.commands.catalogue import (
    MoveForward,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
)
from executive.geometry import Pose
from executive.reports import Kind, Stage
from tests.support.kinematic import Bench


def test_settings_hold_over_a_crash(bench: Bench) -> None:
    bench.submit(SetTravelSpeed(0.7), 1)
    bench.submit(SetTravelSpeed(0.2), 2)
    bench.submit(SetRotateSpeed(0.5), 3)
    bench.submit(SetCameraRotateSpeed(0.4), 4)
    bench.submit(SetStatusInterval(7.0), 5)
    bench.submit(SetPositionCompensation(1.0, 2.0, 0.0, 0.5), 6)
    bench.submit(SetTravelSpeed(500.0), 7)
    bench.crash()
    status = bench.executive.status
    assert (status.travel_speed_mps, status.rotate_speed_radps) == (0.2, 0.5)
    assert status.camera_speed_radps == 0.4
    assert bench.executive.status_interval_s == 7.0
    assert status.compensation == Pose(1.0, 2.0, 0.0, 0.5)
    bench.run(0.2)
    bench.submit(MoveForward(1.0), 8)
    assert bench.finish(8) is Stage.EXECUTED
    assert max(velocity.travel_mps for velocity in bench.rover.sent) <= 0.2
    bench.submit(SetCameraAngles(0.5, 0.0), 9)
    assert bench.finish(9) is Stage.EXECUTED
    assert bench.rover.camera_speed_radps == 0.4


def test_a_setting_that_no_longer_fits_is_forgotten_and_told(bench: Bench) -> None:
    bench.submit(SetTravelSpeed(0.9), 1)
    bench.submit(SetRotateSpeed(0.5), 2)
    slower = replace(bench.settings.drive, travel_speed_mps=0.3)
    bench.settings = replace(bench.settings, drive=slower)
    bench.crash()
    assert bench.executive.status.travel_speed_mps == 0.3
    assert bench.executive.status.rotate_speed_radps == 0.5
    (event,) = [report for report in bench.heard.reports if report.kind is Kind.EVENT]
    assert "speed 0.9 m/s is above its bound of 0.3 m/s" in event.text
