"""Drives over honest and lying navigations, and interruptions of them, by ground truth."""

from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import Mode
from executive.settings import NavigationGate
from executive.values.reports import Stage
from tests.stress import navigation_trial
from tests.stress.navigated_drives import (
    EXPECTED,
    EXPECTED_OF_STRANGE,
    Drive,
    DriveFault,
    DriveResult,
    carry_out,
    judge,
)
from tests.stress.navigated_interruptions import Interrupted, Interruption, interrupt
from tests.support.navigated import NavigatedRover

RANGE_M = 2.0
LONG = {"drives_away", "spins_at_the_target"}
"""Behaviours that end by a deadline, as one of the others; the trial has them."""
GATES = tuple(NavigationGate)


def found(drive: Drive, folder: Path) -> list[tuple[DriveFault, str]]:
    return list(judge(drive, carry_out(drive, folder)))


@pytest.mark.parametrize("gate", GATES)
@pytest.mark.parametrize("behaviour", EXPECTED)
def test_a_drive_ends_as_the_rover_does(
    behaviour: str, gate: NavigationGate, tmp_path: Path
) -> None:
    path = list(EXPECTED).index(behaviour) % 2 == GATES.index(gate)
    assert found(Drive(behaviour, gate, path, seed=1, range_m=RANGE_M), tmp_path) == []


@pytest.mark.parametrize("behaviour", [each for each in EXPECTED_OF_STRANGE if each not in LONG])
def test_a_strange_navigation_is_found_out(behaviour: str, tmp_path: Path) -> None:
    number = list(EXPECTED_OF_STRANGE).index(behaviour)
    drive = Drive(behaviour, GATES[number % 2], number % 3 == 0, seed=2, range_m=RANGE_M)
    assert found(drive, tmp_path) == []


@pytest.mark.parametrize("interruption", Interruption)
def test_an_interrupted_drive_ends_stationary(interruption: Interruption, tmp_path: Path) -> None:
    gate = GATES[list(Interruption).index(interruption) % 2]
    if interruption is Interruption.JOYSTICK:
        gate = NavigationGate.LOCK
    assert interrupt(Interrupted(interruption, gate, "honest", True, seed=1), tmp_path) == []


@pytest.mark.parametrize(
    ("behaviour", "gate"), [("honest", NavigationGate.LOCK), ("recovers", NavigationGate.RELAY)]
)
def test_all_monitors_let_an_honest_navigation_drive(
    behaviour: str, gate: NavigationGate, tmp_path: Path
) -> None:
    assert found(Drive(behaviour, gate, False, 1, RANGE_M, sensed=True), tmp_path) == []


@pytest.mark.parametrize("gate", GATES)
def test_no_random_act_makes_a_false_success(gate: NavigationGate, tmp_path: Path) -> None:
    assert list(navigation_trial.random_run(gate, 1, tmp_path)) == []


def test_a_gate_that_does_not_shut_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stay_open(self: NavigatedRover, _: bool) -> None:
        self._mux.lock("navigation", False, self.now_s)

    monkeypatch.setattr(NavigatedRover, "open_gate", stay_open)
    drive = Drive("aborts_and_drives_on", NavigationGate.LOCK, False, 1, RANGE_M)
    faults = {fault for fault, _ in found(drive, tmp_path)}
    assert faults >= {DriveFault.MOVED, DriveFault.BRAKING}


def test_a_false_success_and_a_false_alarm_are_found() -> None:
    drive = Drive("honest", NavigationGate.LOCK, False, 1)
    good = DriveResult(Stage.EXECUTED, None, "", 0.02, 0.0, 0.0, 0.0, 0.0, 1.0, Mode.IDLE)
    assert list(judge(drive, good)) == []
    for wrong in (
        replace(good, off_m=0.07),
        replace(good, off_rad=0.2),
        replace(good, missed_m=0.1),
        replace(good, moved_m=0.07),
    ):
        assert [fault for fault, _ in judge(drive, wrong)] == [DriveFault.SILENT_SUCCESS]
    failed = replace(good, stage=Stage.FAILED, reason=EXPECTED["aborts"].reasons[0])
    assert [fault for fault, _ in judge(drive, failed)] == [DriveFault.FALSE_ALARM]
