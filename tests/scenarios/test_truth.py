"""What ended EXECUTED is held to the true poses, unasked; what is known to be untrue must be."""

from dataclasses import replace
from math import cos, degrees, pi, radians, sin
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import (
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    Request,
    RotateBy,
    RotateTo,
    SetTravelSpeed,
    Stop,
    Waypoint,
)
from executive.settings import SettingsError
from executive.values.geometry import Pose
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from sim.scenario.model import RunMode
from sim.scenario.outcome import run_once
from sim.scenario.reading import load_scenario
from sim.scenario.record import AdmittedRequest, Answer, Record, SentCommand, TruePose
from sim.scenario.truth import check_executed_truth, true_ends, undelayed_s

IDENTITY = Identity("MOE", 1)
BEGUN_S, ENDED_S = 1.0, 5.0
START = Pose(1.0, 2.0, heading_rad=radians(90))


def ran(
    request: Request, end: Pose, start: Pose = START, ended_s: float = ENDED_S, label: str = "go"
) -> Record:
    """Return a run in which a command was EXECUTED while the rover went evenly to a pose."""
    record = Record(0.0, Path())
    record.sendings = [SentCommand(label, IDENTITY, 0.9, Answer.ACCEPTED)]
    record.requested = [AdmittedRequest(IDENTITY, request)]
    times = ((Stage.RECEIVED, 0.9), (Stage.STARTED, BEGUN_S), (Stage.EXECUTED, ended_s))
    record.reports = [
        Report(number, time_s, ReportKind.COMMAND, Severity.INFORMATIONAL, "", IDENTITY, stage)
        for number, (stage, time_s) in enumerate(times, 1)
    ]
    for step in range(121):
        time_s = step / 20
        part = min(1.0, max(0.0, (time_s - BEGUN_S) / (ended_s - BEGUN_S)))
        record.poses.append(TruePose(time_s, between(start, end, part)))
    return record


def between(start: Pose, end: Pose, part: float) -> Pose:
    return Pose(
        start.x_m + part * (end.x_m - start.x_m),
        start.y_m + part * (end.y_m - start.y_m),
        heading_rad=start.heading_rad + part * (end.heading_rad - start.heading_rad),
    )


def wrong(record: Record, *false_executed: str) -> str:
    finding = check_executed_truth(record, false_executed)
    return "" if finding.passed else finding.observed


def at(x_m: float, y_m: float, heading_deg: float = 90.0) -> Pose:
    return Pose(x_m, y_m, heading_rad=radians(heading_deg))


@pytest.mark.parametrize(
    ("request_", "true", "off"),
    [
        (MoveTo(Waypoint(1, 5, radians(90))), at(1, 5), ""),
        (MoveTo(Waypoint(1, 5)), at(1.29, 5, 45), ""),
        (MoveTo(Waypoint(1, 5)), at(1.32, 5), "0.320 m off, of 0.300 m allowed"),
        (MoveTo(Waypoint(1, 5, tolerance_m=0.5)), at(1.49, 5), ""),
        (MoveTo(Waypoint(1, 5, radians(90))), at(1, 5, 96), "6.0° off, of 5.7° allowed"),
        (FollowPath((Waypoint(9, 9), Waypoint(1, 5))), at(1, 5), ""),
        (FollowPath((Waypoint(1, 5), Waypoint(9, 9))), at(1, 5), "m off"),
        (MoveForward(3), at(1, 5), ""),
        (MoveForward(-3), at(1, -1), ""),
        (MoveForward(3), at(1, 4.69), "0.310 m off, of 0.300 m allowed"),
        (MoveForward(3), at(1, 5.31), "0.310 m off, of 0.300 m allowed"),
        (MoveForward(3), at(1, 5, 84), "6.0° off"),
        (RotateTo(radians(180)), at(1.1, 2.1, 175), ""),
        (RotateTo(radians(180)), at(1, 2, 90), "90.0° off"),
        (RotateBy(radians(-90)), at(1, 2, 0), ""),
        (RotateBy(radians(-90)), at(1.16, 2, 0), "0.160 m off, of 0.150 m allowed"),
        (DriveFor(0.5, 0, 4), at(1, 4), ""),
        (DriveFor(0.5, 0, 4), at(1, 2), "2.000 m off, of 0.250 m allowed"),
        (DriveFor(0, 0.5, 2), Pose(1, 2, heading_rad=pi / 2 + 1), ""),
        (DriveFor(0, 0.5, 2), Pose(1, 2, heading_rad=pi / 2), "57.3° off"),
        (
            DriveFor(1, 0.5, 2),
            Pose(1 - 2 * (1 - cos(1)), 2 + 2 * sin(1), heading_rad=pi / 2 + 1),
            "",
        ),
        (DriveFor(1, 0.5, 2), Pose(1, 4, heading_rad=pi / 2 + 1), "m off"),
        (SetTravelSpeed(1), at(9, 9), ""),
    ],
)
def test_the_true_pose_is_the_commanded_one(request_: Request, true: Pose, off: str) -> None:
    seen = wrong(ran(request_, true))
    assert off in seen if off else not seen


@settings(max_examples=25, deadline=None)
@given(travel_mps=st.floats(-2, 2), rotate_radps=st.floats(-2, 2), duration_s=st.floats(0.1, 10))
def test_a_held_velocity_ends_where_small_steps_of_it_lead(
    travel_mps: float, rotate_radps: float, duration_s: float
) -> None:
    pose, step_s = START, duration_s / 1000
    for _ in range(1000):
        midway = replace(pose, heading_rad=pose.heading_rad + rotate_radps * step_s / 2)
        ahead = midway.ahead(travel_mps * step_s)
        pose = at(ahead.x_m, ahead.y_m, degrees(pose.heading_rad + rotate_radps * step_s))
    (end,) = true_ends(ran(DriveFor(travel_mps, rotate_radps, duration_s), pose))
    assert end.off_m == pytest.approx(0.0, abs=1e-3)
    assert end.off_rad == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("speed_mps", "holds"), [(0.0, True), (0.04, True), (0.06, False)])
def test_a_stop_ends_at_the_true_standstill(speed_mps: float, holds: bool) -> None:
    stop = ran(Stop(), START)
    stop.poses = [replace(seen, pose=at(1, 2 + speed_mps * seen.time_s)) for seen in stop.poses]
    assert bool(wrong(stop)) is not holds


@pytest.mark.parametrize("brakes_mps2", [0.5, 1.0, 2.0, 7.0])
@pytest.mark.parametrize(("speed_mps", "holds"), [(0.0, True), (0.04, True), (0.07, False)])
@pytest.mark.parametrize("late_s", [0.0, 0.02])
def test_a_rover_that_still_brakes_is_not_stationary(
    brakes_mps2: float, speed_mps: float, holds: bool, late_s: float
) -> None:
    """It goes at a speed when the stop ends, comes to rest soon after, and went faster before."""
    stop = ran(Stop(), START)
    rest_s = ENDED_S + speed_mps / brakes_mps2
    stop.poses = [
        TruePose(time_s, at(1, 2 - brakes_mps2 * max(0.0, rest_s - time_s) ** 2 / 2))
        for time_s in (seen.time_s + late_s * (seen.time_s > ENDED_S) for seen in stop.poses)
    ]
    assert wrong(stop) == ("" if holds else "go ended at 0.07 m/s")


def test_a_relative_motion_begins_at_the_first_standstill_of_the_rover() -> None:
    """It was replaced at 1 m/s, and braked for half a metre before its leg was planned."""
    record = ran(MoveForward(1), START)
    for index, seen in enumerate(record.poses):
        braked_m = min(seen.time_s, 1.5) - BEGUN_S
        driven_m = min(1.0, max(0.0, (seen.time_s - 2.0) / 2))
        record.poses[index] = replace(seen, pose=at(1, 2 + braked_m + driven_m))
    assert not wrong(record)


@pytest.mark.parametrize("request_", [MoveForward(3), Stop()])
def test_without_true_poses_nothing_is_held_to_be_true(request_: Request) -> None:
    record = ran(request_, at(1, 5), ended_s=ENDED_S)
    record.poses = [seen for seen in record.poses if seen.time_s < ENDED_S - 1]
    assert "no true pose is known" in wrong(record)
    assert wrong(record, "go")


def test_a_condition_marked_untrue_must_be_untrue() -> None:
    untrue, true = ran(MoveForward(3), at(1, 4)), ran(MoveForward(3), at(1, 5))
    assert not wrong(untrue, "go")
    assert wrong(true, "go") == "go is true"
    assert wrong(untrue, "go", "other") == (
        "go 1.000 m off, of 0.300 m allowed; other did not end EXECUTED"
    )


def test_an_unknown_command_of_a_plan_is_not_required_to_be_true() -> None:
    record = ran(MoveForward(3), at(1, 5))
    step = Identity("plan:errand", 3)
    record.reports.append(replace(record.reports[-1], sequence=9, identity=step))
    assert wrong(record) == "plan:errand:3 has an unknown request"


def test_poses_received_late_are_those_of_their_stamp() -> None:
    """The simulation's clock stands at 7 s at our 100 s, and loses half a second at 7.1 s."""
    stamps_s = [7.0, 7.02, 7.04, 7.06, 7.08, 7.1, 7.12]
    received_s = [100.0, 100.3, 100.3, 100.3, 100.081, 100.6, 100.9]
    found = undelayed_s(received_s, stamps_s)
    assert found == pytest.approx([100.0, 100.021, 100.041, 100.061, 100.081, 100.6, 100.9])


PLAN = """<root BTCPP_format="4">
  <BehaviorTree ID="There">
    <Sequence>
      <moveForward distance="1" deadline_s="9"/>
      <rotateBy angle="0.5" deadline_s="9"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
PLANNED = """
title: A plan
duration: 6
settings: {sensors: {imu: null, joints: null}}
timeline:
  - {at: 0.1, command: {submitPlan: {plan: there.xml}}}
  - {at: 0.2, command: {activatePlan: {plan_id: there}}}
  - {at: 0.3, inject: {gyro_gain: {factor: 1.5}}}
expect:
  - {plan: there, status: COMPLETED}
false_executed: ["plan:there:2"]
"""


def test_a_plans_commands_are_held_to_it_too(tmp_path: Path) -> None:
    (tmp_path / "there.xml").write_text(PLAN)
    path = tmp_path / "planned.yaml"
    path.write_text(PLANNED)
    outcome = run_once("planned", load_scenario(str(path), RunMode.LOCK_STEP), tmp_path)
    assert outcome.passed, outcome.findings
    ends = true_ends(outcome.record)
    assert [end.label for end in ends] == ["plan:there:1", "plan:there:2"]
    assert not ends[0].wrong
    assert "° off" in ends[1].wrong


def test_an_unknown_label_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("title: T\nduration: 1\nfalse_executed: [go]\nexpect: [{mode: IDLE}]\n")
    with pytest.raises(SettingsError, match="false_executed: no 'go' in timeline"):
        load_scenario(str(path))
