from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import (
    ActivatePlan,
    Mode,
    MoveForward,
    MoveTo,
    Resume,
    Stop,
    SubmitPlan,
    Waypoint,
)
from executive.commands.lifecycle import Accepted
from executive.faults import ClearPolicy, Reaction
from executive.settings import load_settings
from executive.values.geometry import STANDING
from executive.values.reasons import Reason
from executive.values.reports import PlanStatus, Report, ReportKind, Severity, Stage
from tests.support.kinematic import Bench, with_figures
from tests.support.plans import plan

LOW_V, FULL_V = 20.0, 26.0
Make = Callable[..., "WeakBench"]


class WeakBench(Bench):
    """A bench whose battery shows what a test says."""

    def battery(self, voltage_v: float, seconds: float = 0.05) -> None:
        """Let the battery show a voltage for a time."""
        self.voltage_v = voltage_v
        self.run(seconds)

    def is_in(self, mode: Mode) -> bool:
        return self.executive.mode is mode

    @property
    def events(self) -> list[Report]:
        return [each for each in self.received.reports if each.kind is ReportKind.EVENT]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    """Make a bench with a row for its battery."""
    with ExitStack() as stack:

        def make_bench(then: Reaction, clears: ClearPolicy, for_s: float = 0.0) -> WeakBench:
            settings = load_settings("jackal")
            row = replace(settings.faults.battery_low, reaction=then, clears=clears)
            row = with_figures(row, for_s=for_s)
            faults = replace(settings.faults, battery_low=row)
            return stack.enter_context(WeakBench(tmp_path, replace(settings, faults=faults)))

        yield make_bench


def go(number: int = 1) -> tuple[MoveTo, int]:
    return MoveTo(Waypoint(5.0, 0.0)), number


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("then", "mode"), [(Reaction.STOP, Mode.STOPPED), (Reaction.SAFE, Mode.SAFE)]
)
def test_stop_and_safe_hold_the_rover_until_a_resume(
    make: Make, then: Reaction, mode: Mode
) -> None:
    bench = make(then, ClearPolicy.ON_RESUME)
    bench.submit(*go(1))
    bench.submit(*go(2))
    bench.run(2.0)
    bench.battery(LOW_V)
    assert bench.rover.velocity == STANDING
    assert bench.is_in(mode)
    assert (bench.stages(1)[-1], bench.stages(2)[-1]) == (Stage.FAILED, Stage.CANCELLED)
    assert bench.last(1).reason is Reason.BATTERY_LOW
    assert [(f.name, f.value) for f in bench.last(1).figures[:2]] == [
        ("voltage", 20.0),
        ("bound", 22.0),
    ]
    assert bench.refusal(Resume(), 3).reason is Reason.CAUSE_PERSISTS
    assert "clear the cause, then send resume" in bench.executive.why
    bench.battery(FULL_V, 1.0)
    assert bench.is_in(mode)
    assert "the cause is cleared: send resume" in bench.executive.why
    assert isinstance(bench.submit(Resume(), 4), Accepted)
    assert bench.is_in(Mode.IDLE)
    bench.execute(MoveForward(0.5), 5)


def test_what_clears_itself_holds_the_rover_no_longer_than_it_lasts(make: Make) -> None:
    bench = make(Reaction.STOP, ClearPolicy.AUTO)
    bench.submit(*go())
    bench.run(2.0)
    bench.battery(LOW_V, 1.0)
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.is_in(Mode.STOPPED)
    assert "; continues once the cause is cleared" in bench.executive.why
    bench.battery(FULL_V, 1.0)
    assert bench.is_in(Mode.IDLE)
    bench.execute(MoveForward(0.5), 2)
    begun, over = (each for each in bench.events if each.identity is None)
    assert (begun.severity, over.severity) == (Severity.ALARM, Severity.INFORMATIONAL)
    assert (begun.reason, over.reason) == (Reason.BATTERY_LOW, Reason.FAULT_CLEARED)
    assert over.text == "battery_low cleared"


def test_a_stop_outlasts_what_clears_itself(make: Make) -> None:
    bench = make(Reaction.STOP, ClearPolicy.AUTO)
    bench.battery(LOW_V)
    bench.submit(Stop(), 1)
    assert "; send resume once the cause is cleared" in bench.executive.why
    bench.battery(FULL_V, 1.0)
    assert bench.is_in(Mode.STOPPED)
    assert "stopped by MOE:1; send resume" in bench.executive.why


@pytest.mark.at_length
def test_a_pause_has_motion_wait_and_then_go_on(make: Make) -> None:
    bench = make(Reaction.PAUSE, ClearPolicy.ON_RESUME)
    bench.submit(*go())
    bench.run(2.0)
    bench.battery(LOW_V, 60.0)
    assert bench.rover.velocity == STANDING
    assert bench.is_in(Mode.PAUSED)
    assert bench.stages(1)[-1] is Stage.STARTED
    assert "PAUSED: battery voltage 20.0 V is below 22.0 V" in bench.executive.why
    assert bench.refusal(Resume(), 2).reason is Reason.CAUSE_PERSISTS
    bench.battery(FULL_V)
    bench.submit(Resume(), 3)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.rover.pose.x_m == pytest.approx(5.0, abs=0.05)


def test_a_pause_ends_what_is_relative_to_where_it_began(make: Make) -> None:
    bench = make(Reaction.PAUSE, ClearPolicy.AUTO)
    bench.drive_on(2.0)
    bench.battery(LOW_V, 1.0)
    assert bench.stages(1)[-1] is Stage.FAILED
    bench.submit(*go(2))
    assert bench.stages(2) == [Stage.RECEIVED, Stage.ACCEPTED]
    bench.battery(FULL_V)
    assert bench.finish(2) is Stage.EXECUTED


def begin_plan(bench: WeakBench, body: str) -> None:
    """Submit and activate a plan, as commands 1 and 2."""
    bench.execute(SubmitPlan(plan(body)), 1)
    bench.execute(ActivatePlan("survey"), 2)
    bench.run(2.0)


def plan_status(bench: WeakBench) -> PlanStatus:
    (update,) = bench.executive.plans()
    return update.status


@pytest.mark.parametrize("clears", ClearPolicy)
def test_a_plan_waits_in_a_pause_that_ends_by_itself(make: Make, clears: ClearPolicy) -> None:
    bench = make(Reaction.PAUSE, clears)
    begin_plan(bench, '<moveTo x="5" y="0" deadline_s="60"/>')
    bench.battery(LOW_V, 10.0)
    assert bench.rover.velocity == STANDING
    assert bench.is_in(Mode.PAUSED)
    if clears is ClearPolicy.ON_RESUME:
        assert plan_status(bench) is PlanStatus.SUSPENDED
        return
    assert plan_status(bench) is PlanStatus.EXECUTING
    assert bench.refusal(*go(3)).reason is Reason.WRONG_MODE  # only the plan moves the rover
    bench.battery(FULL_V, 20.0)
    assert plan_status(bench) is PlanStatus.COMPLETED
    assert bench.rover.pose.x_m == pytest.approx(5.0, abs=0.05)


def test_a_long_pause_fails_the_step_of_a_plan_at_its_deadline(make: Make) -> None:
    bench = make(Reaction.PAUSE, ClearPolicy.AUTO)
    drive = '<moveTo x="{x}" y="0" deadline_s="{s}"/>'
    first, second = (
        drive.replace("{x}", x).replace("{s}", s) for x, s in (("5", "6"), ("1", "60"))
    )
    begin_plan(bench, f"<Fallback>{first}{second}</Fallback>")
    bench.battery(LOW_V, 10.0)
    assert plan_status(bench) is PlanStatus.EXECUTING
    bench.battery(FULL_V, 20.0)
    assert plan_status(bench) is PlanStatus.COMPLETED
    assert bench.rover.pose.x_m == pytest.approx(1.0, abs=0.05)


def test_slowing_down_leaves_a_part_of_the_speed(make: Make) -> None:
    bench = make(Reaction.SLOW_DOWN, ClearPolicy.AUTO)
    bench.submit(*go())
    bench.run(2.0)
    assert bench.rover.velocity.travel_mps == pytest.approx(1.0)
    bench.battery(LOW_V, 1.5)
    assert bench.rover.velocity.travel_mps == pytest.approx(0.3)
    assert bench.is_in(Mode.MOVING)
    bench.battery(FULL_V, 1.5)
    assert bench.rover.velocity.travel_mps > 0.5
    assert bench.finish(1) is Stage.EXECUTED


def test_a_warning_moves_nothing_and_nothing_is_ignored_aloud(make: Make) -> None:
    bench = make(Reaction.WARN, ClearPolicy.AUTO)
    bench.submit(*go())
    bench.battery(LOW_V, 0.5)
    assert [each.severity for each in bench.events] == [Severity.WARNING]
    assert bench.finish(1) is Stage.EXECUTED


def test_what_is_ignored_is_not_told(make: Make) -> None:
    bench = make(Reaction.IGNORE, ClearPolicy.AUTO)
    bench.battery(LOW_V, 1.0)
    assert not bench.events


def test_a_fault_begins_once_it_has_lasted(make: Make) -> None:
    bench = make(Reaction.SAFE, ClearPolicy.ON_RESUME, for_s=1.0)
    bench.battery(LOW_V, 0.9)
    bench.battery(FULL_V)
    bench.battery(LOW_V, 1.0)
    assert not bench.events
    bench.battery(LOW_V, 0.05)
    assert bench.is_in(Mode.SAFE)
    bench.run(5.0)
    assert len(bench.events) == 1


def test_resume_says_that_nothing_holds_a_rover_with_a_suspended_plan(make: Make) -> None:
    bench = make(Reaction.WARN, ClearPolicy.AUTO)
    refusal = bench.refusal(Resume(), 1)
    assert refusal.reason is Reason.WRONG_MODE
