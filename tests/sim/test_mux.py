"""Who drives a simulated base: its mux decides as twist_mux does."""

from dataclasses import replace
from math import hypot
from pathlib import Path

import pytest

from executive.commands import Mode
from executive.commands.catalogue import (
    Command,
    DriveFor,
    MoveForward,
    MoveTo,
    Resume,
    Stop,
    Waypoint,
)
from executive.commands.lifecycle import Accepted, Rejected
from executive.settings import MuxEntry, MuxSettings, SettingsError, load_settings, structure
from executive.values.facts import VELOCITY_TOPIC
from executive.values.geometry import STANDING, Velocity
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from sim.rover import faults
from sim.rover.jackal import Mux, SimulatedJackal
from sim.rover.lockstep import LockStep
from sim.rover.world import World

JACKAL = load_settings("jackal")
assert JACKAL.mux is not None
MUX = JACKAL.mux
JOYSTICK, EXTERNAL = 10.0, 1.0


def test_the_received_input_with_maximum_priority_drives() -> None:
    mux = Mux(MUX)
    assert mux.passes("external", 0.0)
    assert mux.passes("executive", 0.1)
    assert not mux.passes("external", 0.2)
    assert mux.passes("joystick", 0.3)
    assert not mux.passes("executive", 0.8)
    assert mux.passes("executive", 0.81)
    assert not mux.passes("external", 1.3)
    assert mux.passes("external", 1.32)


def test_a_lock_masks_inputs_below_it_until_it_is_opened() -> None:
    mux = Mux(MUX)
    mux.lock("e_stop", True, 0.0)
    assert {name for name in MUX.topics if mux.passes(name, 100.0)} == {MUX.stop}
    mux = Mux(MUX)
    mux.lock("e_stop", True, 99.0)
    mux.lock("e_stop", False, 100.0)
    assert mux.passes("joystick", 100.0)
    mux.add("remote", MuxEntry("remote", 0.5, 255))
    mux.lock("e_stop", True, 101.0)
    assert mux.passes("remote", 101.0)


def test_a_lock_with_a_timeout_is_locked_by_silence() -> None:
    entry = MuxEntry("pause", 1.0, 100)
    mux = Mux(MuxSettings("executive", "pause", MUX.topics, {"pause": entry}))
    assert not mux.passes("executive", 0.0)
    mux.lock("pause", False, 0.0)
    assert mux.passes("executive", 1.0)
    assert not mux.passes("executive", 1.1)


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("input", "nobody", "input is 'nobody', which the mux does not have: joystick, executive"),
        ("lock", "pause", "lock is 'pause', which the mux does not have: e_stop"),
        ("locks", {"e_stop": {"topic": "s", "timeout": 0, "priority": 5}}, "must be above 5"),
        ("locks", {"e_stop": {"topic": "s", "timeout": 0, "priority": 256}}, "0 to 255"),
        ("locks", {"e_stop": {"topic": "s", "timeout": -1, "priority": 9}}, "0 for never"),
        ("stop", "joystick", "stop joystick has priority 10: it must be at least 255"),
        ("stop", "halt", "stop is 'halt', which the mux does not have"),
    ],
)
def test_a_mux_without_effective_lock_is_refused(key: str, value: object, text: str) -> None:
    entry = {"timeout": 0.5, "topic": "topic"}
    topics = {"joystick": {**entry, "priority": 10}, "executive": {**entry, "priority": 5}}
    locks = {"e_stop": {**entry, "priority": 255}}
    raw = {"input": "executive", "lock": "e_stop", "topics": topics, "locks": locks}
    with pytest.raises(SettingsError, match=text):
        structure({**raw, key: value}, MuxSettings, "jackal.yaml")


@pytest.fixture
def lock_step(tmp_path: Path) -> LockStep:
    lock_step = LockStep(JACKAL, World(), tmp_path)
    lock_step.run(0.2)
    return lock_step


def submit(lock_step: LockStep, number: int, request: object) -> None:
    command = Command(Identity("MOE", number), request, "direct")  # type: ignore[arg-type]
    assert isinstance(lock_step.submit(command), Accepted)


def speed_mps(lock_step: LockStep) -> float:
    return abs(lock_step.rover.true_velocity.travel_mps)


@pytest.mark.parametrize("priority", [EXTERNAL, 5.0, JOYSTICK])
def test_after_a_stop_the_rover_is_stationary_despite_other_publishers(
    lock_step: LockStep, priority: float
) -> None:
    lock_step.rover.inject(faults.CmdVelOverridden(priority=priority))
    submit(lock_step, 1, DriveFor(0.5, 0.0, 30.0))
    lock_step.run(2.0)
    assert speed_mps(lock_step) > 0.4
    submit(lock_step, 2, Stop())
    lock_step.run(0.5)
    assert speed_mps(lock_step) < 0.02
    x_m = lock_step.rover.true_pose.x_m
    lock_step.run(5.0)
    assert lock_step.rover.true_pose.x_m == pytest.approx(x_m, abs=0.002)


@pytest.mark.parametrize("priority", [EXTERNAL, 5.0, JOYSTICK])
def test_a_stop_does_not_wait_for_the_timeout_of_the_base(
    lock_step: LockStep, priority: float
) -> None:
    lock_step.rover.inject(faults.CmdVelOverridden(priority=priority, travel_mps=1.0))
    lock_step.run(2.0)
    submit(lock_step, 1, Stop())
    lock_step.run(0.3)
    assert speed_mps(lock_step) < 0.02


@pytest.mark.parametrize("mux", [JACKAL.mux, None])
def test_a_takeover_has_motion_wait_for_a_resume(tmp_path: Path, mux: MuxSettings | None) -> None:
    lock_step = LockStep(replace(JACKAL, mux=mux), World(), tmp_path)
    lock_step.run(0.2)
    submit(lock_step, 1, MoveTo(Waypoint(3.0, 0.0, 0.05)))
    submit(lock_step, 2, MoveForward(0.5))
    lock_step.run(1.5)
    lock_step.rover.inject(faults.CmdVelOverridden(travel_mps=0.0, rotate_radps=0.8))
    lock_step.run(0.4)
    executive = lock_step.executive
    assert executive.mode.name == "PAUSED"
    name = "joystick" if mux else VELOCITY_TOPIC
    assert f"{name} drives the rover" in executive.why
    readings = [r for r in lock_step.downlink_record.reports if r.reason is Reason.OTHER_PUBLISHER]
    assert [report.text for report in readings] == [f"{name} drives the rover"]
    lock_step.run(2.0)
    answer = lock_step.submit(Command(Identity("MOE", 3), Resume(), "direct"))
    assert isinstance(answer, Rejected)
    assert answer.refusal.reason is Reason.CAUSE_PERSISTS
    lock_step.rover.clear(faults.CmdVelOverridden)
    lock_step.run(2.0)
    assert executive.mode.name == "PAUSED"
    assert speed_mps(lock_step) < 0.02
    submit(lock_step, 4, Resume())
    lock_step.run(20.0)
    assert executive.mode.name == "IDLE"
    ends = [r.stage for r in lock_step.downlink_record.reports if r.stage is Stage.EXECUTED]
    assert len(ends) == 3
    assert hypot(lock_step.rover.true_pose.x_m - 3.0, lock_step.rover.true_pose.y_m) > 0.4


def test_an_unknown_input_is_detected_by_the_wheels(lock_step: LockStep) -> None:
    lock_step.rover.inject(faults.CmdVelOverridden(priority=77.0))
    submit(lock_step, 1, DriveFor(-0.5, 0.0, 30.0))
    lock_step.run(2.0)
    assert lock_step.executive.mode is Mode.STOPPED
    assert speed_mps(lock_step) < 0.02


def test_relative_motion_fails_by_a_takeover(lock_step: LockStep) -> None:
    submit(lock_step, 1, MoveForward(3.0))
    lock_step.run(1.0)
    lock_step.rover.inject(faults.CmdVelOverridden(travel_mps=-0.3))
    lock_step.run(1.0)
    (last,) = [r for r in lock_step.downlink_record.reports if r.stage is Stage.FAILED]
    assert last.reason is Reason.OTHER_PUBLISHER


def test_a_lower_input_does_not_disturb_a_motion_and_is_reported(lock_step: LockStep) -> None:
    lock_step.rover.inject(faults.CmdVelOverridden(travel_mps=-0.5, priority=EXTERNAL))
    submit(lock_step, 1, MoveForward(1.0))
    lock_step.run(3.0)
    assert lock_step.rover.true_pose.x_m == pytest.approx(1.0, abs=0.03)
    readings = [report.text for report in lock_step.downlink_record.reports]
    assert any("external is active; it drives the base while" in text for text in readings)
    assert "external" in lock_step.executive.why
    lock_step.rover.clear(faults.CmdVelOverridden)
    lock_step.run(1.0)
    readings = [report.text for report in lock_step.downlink_record.reports]
    assert any("no longer commanded by external" in text for text in readings)
    assert lock_step.executive.mode is Mode.IDLE


def test_the_driver_of_an_idle_rover_is_reported_with_duration_and_distance(
    lock_step: LockStep,
) -> None:
    lock_step.run(3.0)
    x_m = lock_step.rover.true_pose.x_m
    lock_step.rover.inject(faults.CmdVelOverridden(travel_mps=0.3, priority=EXTERNAL))
    lock_step.run(4.0)
    executive = lock_step.executive
    assert executive.mode is Mode.IDLE
    assert "driven by external, duration 3." in executive.why
    lock_step.rover.clear(faults.CmdVelOverridden)
    lock_step.run(2.0)
    driven_m = lock_step.rover.true_pose.x_m - x_m
    assert driven_m > 1.0
    (ended,) = [
        r
        for r in lock_step.downlink_record.reports
        if "no longer commanded by external, duration" in r.text
    ]
    figures = {each.name: each.value for each in ended.figures}
    assert figures["driven"] == pytest.approx(driven_m, abs=0.05)
    assert figures["duration"] == pytest.approx(4.0, abs=0.1)
    assert executive.safety.active == []


def test_an_asset_may_prevent_lower_inputs_from_driving_it_while_it_is_idle(tmp_path: Path) -> None:
    assert JACKAL.mux is not None
    mux = replace(JACKAL.mux, lower_may_drive=False)
    lock_step = LockStep(replace(JACKAL, mux=mux), World(), tmp_path)
    lock_step.run(3.0)
    lock_step.rover.inject(faults.CmdVelOverridden(travel_mps=0.3, priority=EXTERNAL))
    lock_step.run(4.0)
    assert lock_step.executive.mode is Mode.STOPPED
    (why,) = [r for r in lock_step.downlink_record.reports if r.reason is Reason.UNCOMMANDED_MOTION]
    assert why.text.endswith("(velocity publishers: external)")
    assert lock_step.rover.true_pose.x_m < 0.5
    lock_step.run(2.0)
    assert speed_mps(lock_step) < 0.02


def test_the_lock_outlives_the_executive_until_its_successor_releases_it(
    lock_step: LockStep,
) -> None:
    submit(lock_step, 1, Stop())
    lock_step.run(0.5)
    lock_step.kill()
    lock_step.rover.inject(faults.CmdVelOverridden(priority=JOYSTICK))
    lock_step.run(2.0)
    assert speed_mps(lock_step) < 0.02
    lock_step.start()
    lock_step.run(1.0)
    assert lock_step.executive.mode is Mode.STOPPED
    assert speed_mps(lock_step) < 0.02
    submit(lock_step, 2, Resume())
    lock_step.run(1.0)
    assert speed_mps(lock_step) > 0.4
    assert "driven by joystick" in lock_step.executive.why


def test_without_a_mux_the_newest_command_counts() -> None:
    rover = SimulatedJackal(World())
    rover.mux_lock("e_stop", True)
    rover.mux_command(None, Velocity(0.5, 0.0))
    rover.advance(0.2)
    rover.emergency_stop()
    rover.inject(faults.CmdVelOverridden())
    rover.advance(0.5)
    assert rover.true_velocity.travel_mps > 0.4
    rover.clear(faults.CmdVelOverridden)
    rover.drive(STANDING)
    rover.advance(0.5)
    assert abs(rover.true_velocity.travel_mps) < 0.02
