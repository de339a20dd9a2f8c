"""A command is executed once, what holds outlives the process, and what is told of both."""

from dataclasses import replace
from math import pi

import pytest

from executive.commands import (
    FollowPath,
    MoveForward,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Waypoint,
)
from executive.commands.lifecycle import Duplicate
from executive.values.facts import ForeignPublishers
from executive.values.geometry import STANDING, Pose
from executive.values.reasons import Reason
from executive.values.reports import ReportKind, Severity, Stage
from tests.support.kinematic import ALL_STAGES, Bench


def test_a_repeat_is_answered_with_the_last_report_and_not_executed(bench: Bench) -> None:
    bench.execute(MoveForward(1.0), 1)
    position = bench.rover.pose
    last = bench.last(1)
    answer = bench.submit(MoveForward(1.0), 1)
    assert answer == Duplicate(last)
    assert bench.received.reports[-1] == last
    bench.run(3.0)
    assert bench.rover.pose == position


def test_a_number_used_for_another_command_is_refused(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1)
    assert bench.refusal(MoveForward(2.0), 1).reason is Reason.DUPLICATE
    assert bench.finish(1) is Stage.EXECUTED


def test_a_flood_does_not_delay_the_ticks(bench: Bench) -> None:
    requested: list[int] = []

    def retransmit() -> None:
        requested.append(len(requested))
        if len(requested) < 1000:
            bench.executive.query(retransmit)

    bench.executive.query(retransmit)
    bench.step()
    bench.step()
    assert len(requested) == 2


def test_a_command_expires_in_the_queue(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2, lifetime_s=2.0)
    bench.finish(1)
    assert bench.finish(2) is Stage.EXPIRED
    assert bench.stages(2) == [Stage.RECEIVED, Stage.ACCEPTED, Stage.EXPIRED]
    assert bench.last(2).reason is Reason.EXPIRED


def test_kill_9_ends_active_commands_and_never_reruns_them(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2)
    bench.run(2.0)
    bench.crash()
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.INTERRUPTED
    assert bench.stages(2)[-1] is Stage.CANCELLED
    position = bench.rover.pose
    assert isinstance(bench.submit(MoveForward(5.0), 1), Duplicate)
    bench.run(3.0)
    assert bench.rover.pose == position
    sequences = [report.sequence for report in bench.received.reports[:-1]]
    assert sequences == list(range(1, len(sequences) + 1))


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
    bench.execute(MoveForward(1.0), 8)
    assert max(velocity.travel_mps for velocity in bench.rover.sent) <= 0.2
    bench.execute(SetCameraAngles(0.5, 0.0), 9)
    assert bench.rover.camera_speed_radps == 0.4


def test_a_setting_that_no_longer_fits_is_forgotten_and_reported(bench: Bench) -> None:
    bench.submit(SetTravelSpeed(0.9), 1)
    bench.submit(SetRotateSpeed(0.5), 2)
    slower = replace(bench.settings.drive, travel_speed_mps=0.3)
    bench.settings = replace(bench.settings, drive=slower)
    bench.crash()
    assert bench.executive.status.travel_speed_mps == 0.3
    assert bench.executive.status.rotate_speed_radps == 0.5
    (event,) = [report for report in bench.received.reports if report.kind is ReportKind.EVENT]
    assert "speed 0.9 m/s is above its bound of 0.3 m/s" in event.text


def test_settings_are_commands_with_a_complete_life_cycle(bench: Bench) -> None:
    bench.submit(SetCameraRotateSpeed(0.3), 1)
    bench.submit(SetPositionCompensation(1.0, 0.0, 0.0, pi / 2), 2)
    assert bench.stages(1) == bench.stages(2) == ALL_STAGES
    assert bench.executive.status.camera_speed_radps == 0.3
    pose = bench.executive.status.pose
    assert (pose.x_m, pose.heading_rad) == pytest.approx((1.0, pi / 2))


def test_telemetry_is_sent_at_its_interval_or_on_change(bench: Bench) -> None:
    bench.received.values.clear()
    bench.run(5.0)
    assert len(bench.received.values) == 5
    assert {len(values) for values in bench.received.values} == {12}
    bench.submit(SetStatusInterval(0.0), 1)
    bench.run(0.5)
    bench.received.values.clear()
    bench.run(5.0)
    assert bench.received.values == []
    bench.submit(SetTravelSpeed(0.5), 2)
    bench.run(0.1)
    ((changed,),) = bench.received.values
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
    events = [report.text for report in bench.received.reports if report.kind is ReportKind.EVENT]
    assert events == ["other velocity publishers: /joystick"]
    assert "/joystick" in bench.executive.why


def test_an_event_of_a_link_is_reported_and_recorded_as_that_of_a_link(bench: Bench) -> None:
    bench.executive.report_event(
        Severity.WARNING, "the service layer is away", kind=ReportKind.LINK
    )
    bench.step()
    reported = bench.received.reports[-1]
    assert (reported.kind, reported.severity) == (ReportKind.LINK, Severity.WARNING)
    assert bench.executive.reports(reported.sequence) == [reported]
