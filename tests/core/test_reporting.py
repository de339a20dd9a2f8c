from math import pi

import pytest

from executive.commands import (
    FollowPath,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetStatusInterval,
    SetTravelSpeed,
    Waypoint,
)
from executive.reports import Kind, Severity, Stage
from executive.state import ForeignPublishers
from tests.support.kinematic import WHOLE_LIFE, Bench


def test_settings_are_commands_with_a_whole_life(bench: Bench) -> None:
    bench.submit(SetCameraRotateSpeed(0.3), 1)
    bench.submit(SetPositionCompensation(1.0, 0.0, 0.0, pi / 2), 2)
    assert bench.stages(1) == bench.stages(2) == WHOLE_LIFE
    assert bench.executive.status.camera_speed_radps == 0.3
    pose = bench.executive.status.pose
    assert (pose.x_m, pose.heading_rad) == pytest.approx((1.0, pi / 2))


def test_telemetry_comes_at_its_interval_or_on_change(bench: Bench) -> None:
    bench.heard.values.clear()
    bench.run(5.0)
    assert len(bench.heard.values) == 5
    assert {len(values) for values in bench.heard.values} == {12}
    bench.submit(SetStatusInterval(0.0), 1)
    bench.run(0.5)
    bench.heard.values.clear()
    bench.run(5.0)
    assert bench.heard.values == []
    bench.submit(SetTravelSpeed(0.5), 2)
    bench.run(0.1)
    ((changed,),) = bench.heard.values
    assert (changed.parameter.value, changed.value) == ("TRAVEL_SPEED", 0.5)


def test_started_and_progress_are_reported_only_on_request(bench: Bench) -> None:
    bench.submit(
        FollowPath((Waypoint(0.5, 0.0), Waypoint(1.0, 0.0))),
        1,
        report_started=False,
        report_progress=False,
    )
    bench.finish(1)
    assert bench.stages(1) == [Stage.RECEIVED, Stage.ACCEPTED, Stage.EXECUTED]


def test_other_publishers_are_noticed_once(bench: Bench) -> None:
    for _ in range(3):
        bench.executive.observe(ForeignPublishers(("/joystick",)))
        bench.step()
    events = [report.text for report in bench.heard.reports if report.kind is Kind.EVENT]
    assert events == ["others may move the rover: /joystick"]
    assert "/joystick" in bench.executive.why


def test_what_a_link_notices_is_told_and_written_down_as_of_a_link(bench: Bench) -> None:
    bench.executive.event(Severity.WARNING, "the service layer is away", kind=Kind.LINK)
    bench.step()
    told = bench.heard.reports[-1]
    assert (told.kind, told.severity) == (Kind.LINK, Severity.WARNING)
    assert bench.executive.reports(told.sequence) == [told]
