"""A rover that carries out whole motions, also for another way than the executive's."""

from pathlib import Path

import pytest

from executive.commands.catalogue import MoveForward, Stop
from executive.commands.modes import Mode
from executive.geometry import STANDING
from executive.ports import Advance, WholeMotion
from executive.reasons import Reason
from executive.reports import Identity, Stage
from executive.state.status import CommandEnded, CommandUnderWay, Stopped
from tests.support.self_moving import SelfMovingBench


@pytest.fixture
def bench(tmp_path: Path) -> SelfMovingBench:
    return SelfMovingBench(tmp_path)


@pytest.mark.parametrize("executed", [True, False])
def test_a_command_that_the_rover_had_by_another_way_ends_as_it_ended_there(
    bench: SelfMovingBench, executed: bool
) -> None:
    bench.submit(MoveForward(1.0), 1)
    bench.submit(MoveForward(1.0), 2)
    bench.run(0.2)
    bench.executive.observe(CommandEnded(Identity("MOE", 1), executed))
    bench.step()
    assert bench.stages(1)[-1] is (Stage.EXECUTED if executed else Stage.FAILED)
    assert bench.finish(2) is Stage.EXECUTED


def test_what_the_rover_carries_out_already_is_neither_stopped_nor_given_up(
    bench: SelfMovingBench,
) -> None:
    bench.run(0.2)
    bench.rover.told.clear()
    bench.rover.carry_out(WholeMotion(0, Advance(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    bench.submit(MoveForward(5.0), 1)
    bench.run(0.2)
    bench.executive.observe(CommandUnderWay(Identity("MOE", 1)))
    bench.run(20.0)
    assert len(bench.rover.told) == 1
    bench.executive.observe(CommandEnded(Identity("MOE", 1), True))
    bench.step()
    assert bench.stages(1)[-1] is Stage.EXECUTED


def test_what_the_rover_carries_out_already_outlasts_the_deadline_of_its_part(
    bench: SelfMovingBench,
) -> None:
    bench.rover.deaf = True
    bench.submit(MoveForward(0.1), 1)
    bench.run(0.5)
    bench.executive.observe(CommandUnderWay(Identity("MOE", 1)))
    bench.run(60.0)
    bench.executive.observe(CommandEnded(Identity("MOE", 1), True))
    bench.step()
    assert bench.stages(1)[-1] is Stage.EXECUTED


def test_a_rover_that_another_command_moves_stands_before_its_leg(bench: SelfMovingBench) -> None:
    bench.run(0.2)
    bench.rover.carry_out(WholeMotion(0, Advance(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    bench.submit(MoveForward(0.5), 2)
    assert bench.finish(2) is Stage.EXECUTED
    assert None in bench.rover.told


def test_an_executive_that_comes_or_goes_leaves_alone_what_another_link_moves(
    bench: SelfMovingBench,
) -> None:
    bench.rover.told.clear()
    bench.rover.carry_out(WholeMotion(0, Advance(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    bench.crash()
    bench.run(1.0)
    bench.executive.close()
    assert None not in bench.rover.told
    assert bench.rover.velocity != STANDING


def test_an_executive_that_comes_or_goes_halts_what_it_had_the_rover_do(
    bench: SelfMovingBench,
) -> None:
    bench.submit(MoveForward(9.0), 1)
    bench.run(1.0)
    bench.crash()
    assert bench.rover.told[-1] is None
    bench.rover.facts.clear()
    bench.run(0.2)
    bench.submit(MoveForward(9.0), 2)
    bench.run(1.0)
    assert bench.rover.velocity != STANDING
    bench.executive.close()
    assert bench.rover.told[-1] is None


def test_a_stop_halts_what_another_link_moves_and_leaves_alone_what_that_begins_later(
    bench: SelfMovingBench,
) -> None:
    bench.rover.carry_out(WholeMotion(0, Advance(5.0, 0.2), Identity("MOE", 1)))
    bench.run(1.0)
    for number in (2, 3):
        bench.submit(Stop(), number)
        assert bench.rover.told[-1] is None
        assert bench.finish(number) is Stage.EXECUTED
        bench.run(0.2)
        bench.rover.carry_out(WholeMotion(0, Advance(5.0, 0.2), Identity("MOE", 4)))
        bench.run(3.0)
        assert bench.rover.told[-1] is not None
    assert bench.executive.mode is Mode.STOPPED


def test_a_stop_by_another_way_cancels_all_and_latches_nothing(bench: SelfMovingBench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(5.0), 2)
    bench.run(1.0)
    bench.rover.told.clear()
    bench.rover.halt()
    bench.executive.observe(Stopped("MOE:40"))
    bench.run(0.5)
    for number in (1, 2):
        assert (bench.stages(number)[-1], bench.last(number).reason) == (
            Stage.CANCELLED,
            Reason.STOPPED,
        )
    assert bench.rover.velocity == STANDING
    bench.submit(MoveForward(0.5), 3)
    assert bench.finish(3) is Stage.EXECUTED
