"""An executive that commands MOCUP by strings, in lock step with physics."""

from pathlib import Path

import pytest

from executive.commands.catalogue import (
    Command,
    MoveForward,
    Request,
    Resume,
    Stop,
)
from executive.reasons import Reason
from executive.reports import Identity, Report, Stage
from executive.settings import load_settings
from sim.rover.faults import LeftStuck, OdometryLost
from sim.rover.lockstep import LockStep
from sim.rover.world import World


class Mocup:
    """MOCUP and its executive."""

    def __init__(self, folder: Path, seed: int = 1) -> None:
        self.lock = LockStep(load_settings("mocup"), World(), folder, seed)
        self._numbers = 0
        self.lock.run(0.5)

    def ask(self, request: Request) -> int:
        self._numbers += 1
        self.lock.submit(Command(Identity("MOE", self._numbers), request, "direct"))
        return self._numbers

    def life(self, number: int) -> list[Report]:
        return [
            report
            for report in self.lock.heard.reports
            if report.identity == Identity("MOE", number)
        ]

    def ended(self, number: int) -> bool:
        life = self.life(number)
        return bool(life) and life[-1].stage is not None and life[-1].stage.terminal

    def do(self, request: Request) -> Report:
        number = self.ask(request)
        assert self.lock.run_until(lambda: self.ended(number), 90.0), self.life(number)
        return self.life(number)[-1]


@pytest.fixture
def mocup(tmp_path: Path) -> Mocup:
    return Mocup(tmp_path)


def test_a_stop_stands_within_a_tenth_of_a_second_and_ends_the_motion(mocup: Mocup) -> None:
    moving = mocup.ask(MoveForward(5.0))
    mocup.lock.run(2.0)
    assert mocup.lock.rover.true_velocity.travel_mps == pytest.approx(0.2, abs=0.01)
    stop = mocup.ask(Stop())
    mocup.lock.run(0.1)
    assert mocup.lock.rover.true_velocity.travel_mps == pytest.approx(0.0, abs=0.005)
    assert mocup.lock.run_until(lambda: mocup.ended(stop), 2.0)
    assert mocup.life(stop)[-1].stage is Stage.EXECUTED
    assert mocup.life(moving)[-1].stage is Stage.CANCELLED
    assert mocup.do(Resume()).stage is Stage.EXECUTED
    assert mocup.do(MoveForward(0.2)).stage is Stage.EXECUTED


def test_a_stuck_motor_fails_the_command(mocup: Mocup) -> None:
    mocup.lock.rover.inject(LeftStuck())
    ended = mocup.do(MoveForward(1.0))
    assert (ended.stage, ended.reason) == (Stage.FAILED, Reason.MOTION_NOT_EXECUTED)
    assert "the left motor is stuck" in ended.text


def test_lost_telemetry_makes_it_stand(mocup: Mocup) -> None:
    mocup.ask(MoveForward(5.0))
    mocup.lock.run(2.0)
    mocup.lock.rover.inject(OdometryLost())
    mocup.lock.run(1.5)
    assert mocup.lock.rover.true_velocity.travel_mps == pytest.approx(0.0, abs=0.005)


def test_an_executive_that_comes_back_commands_the_brick_again(mocup: Mocup) -> None:
    mocup.ask(MoveForward(5.0))
    mocup.lock.run(2.0)
    mocup.lock.restart()
    mocup.lock.run(1.0)
    assert mocup.lock.rover.true_velocity.travel_mps == pytest.approx(0.0, abs=0.005)
    mocup.do(Resume())
    assert mocup.do(MoveForward(0.2)).stage is Stage.EXECUTED
