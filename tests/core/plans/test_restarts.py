"""Plans that continue by themselves after restarts: when they do, and what a kill changes."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import ResumePlan, Stop, SuspendPlan
from executive.commands.catalogue import Resume
from executive.values.geometry import Pose
from executive.values.reports import PlanStatus, Stage
from tests.support.examples import examples
from tests.support.kinematic import STEP_S
from tests.support.plans import PlanBench, plan, xml
from trees.plan.tree import NODES

SLEEP = '<Sleep msec="60000"/>'
BACK = '<moveForward distance="-0.3" deadline_s="60"/>'
EXECUTING, SUSPENDED = PlanStatus.EXECUTING, PlanStatus.SUSPENDED


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    with PlanBench(tmp_path) as bench:
        yield bench


def begin(bench: PlanBench, body: str = f"<Sequence>{SLEEP}{BACK}</Sequence>") -> None:
    """Run a plan that continues by itself for a second."""
    content = xml(body).replace(b"<root ", b'<root after_restart="resume" ')
    bench.go(replace(plan(""), content=content))
    bench.run(1.0)


def crash_without_odometry(bench: PlanBench) -> None:
    bench.odometry = False
    bench.crash()
    bench.run(0.5)
    assert bench.status().status is SUSPENDED


@pytest.mark.parametrize("orderly", [False, True])
def test_a_plan_that_waits_for_its_position_also_does_after_the_next_end(
    bench: PlanBench, orderly: bool
) -> None:
    begin(bench)
    crash_without_odometry(bench)
    if orderly:
        bench.executive.close()
    else:
        bench.executive.simulate_crash()
    bench.restart()
    assert continues(bench)


def continues(bench: PlanBench) -> bool:
    bench.odometry = True
    bench.run(0.5)
    return bench.status().status is EXECUTING


@pytest.mark.alike
@pytest.mark.parametrize("kills", [1, 2, 3, 4])
def test_each_kill_while_a_plan_waits_for_its_position_counts(bench: PlanBench, kills: int) -> None:
    begin(bench)
    for _ in range(kills):
        crash_without_odometry(bench)
    assert continues(bench) is (kills <= 3)
    texts = [each.text for each in bench.received.plans]
    assert (f"resumed after a restart, {kills} of 3" in texts) is (kills <= 3)


def test_timers_continue_while_a_plan_waits_for_its_position(bench: PlanBench) -> None:
    begin(bench)
    crash_without_odometry(bench)
    bench.executive.simulate_crash()
    bench.clock.advance(50.0)
    bench.restart()
    assert continues(bench)
    bench.run(6.5)
    assert bench.commanded() == []
    bench.run(2.5)
    assert len(bench.commanded()) == 1


@pytest.mark.alike
@pytest.mark.parametrize("cause", ["stop", "suspended", "activated", "waiting", "too late"])
def test_a_plan_that_another_cause_suspended_waits_over_the_next_kill(
    bench: PlanBench, cause: str
) -> None:
    begin(bench, f'<Sequence><Sleep msec="6000"/>{BACK}</Sequence>')
    crash_without_odometry(bench)
    match cause:
        case "stop":
            bench.numbered(Stop())
            bench.numbered(Resume())
        case "too late":
            bench.run(61.0)
        case "suspended":
            bench.odometry = True
            bench.run(0.5)
            bench.request(SuspendPlan("survey"))
        case _:
            bench.request(ResumePlan("survey"))
            bench.request(SuspendPlan("survey"))
    bench.step()
    bench.crash()
    assert not continues(bench)
    assert bench.status().status is SUSPENDED
    bench.request(ResumePlan("survey"))
    assert bench.until(PlanStatus.COMPLETED) is PlanStatus.COMPLETED
    assert bench.ends() == [Stage.EXECUTED]


def test_the_link_is_not_up_before_the_first_contact_after_a_restart(bench: PlanBench) -> None:
    wait = '<WaitFor if="@LINK_UP == 1" deadline_s="600"/>'
    begin(bench, f"<Sequence>{SLEEP}{wait}{BACK}</Sequence>")
    bench.executive.simulate_crash()
    bench.clock.advance(100.0)
    bench.restart()
    bench.run(5.0)
    assert bench.commanded() == []
    bench.executive.ground.record_contact()
    bench.run(0.5)
    assert len(bench.commanded()) == 1


def why_not(bench: PlanBench) -> list[str]:
    texts = (
        each.text.partition("does not continue by itself: ") for each in bench.received.reports
    )
    return [why for _, found, why in texts if found]


@pytest.mark.alike
@pytest.mark.parametrize(("stored_m", "here_m"), [(0.15, 0.01), (0.15, 0.03), (0.015, 0.01)])
def test_odometry_at_its_origin_may_have_restarted(
    bench: PlanBench, stored_m: float, here_m: float
) -> None:
    bench.rover.pose = Pose(stored_m)
    begin(bench)
    bench.executive.simulate_crash()
    bench.rover.pose = Pose(here_m)
    bench.restart()
    restarted = here_m < 0.02 <= stored_m - here_m
    assert continues(bench) is not restarted
    bench.run(61.0)
    why = ["its position was not certain within 60 s"] * restarted
    assert why_not(bench) == why


def test_a_rover_far_from_its_stored_position_is_reported(bench: PlanBench) -> None:
    begin(bench, f'<Sequence><moveForward distance="50" deadline_s="600"/>{BACK}</Sequence>')
    bench.run(1.0)
    bench.executive.simulate_crash()
    bench.clock.advance(5.0)
    bench.rover.pose = Pose(bench.rover.pose.x_m + 2.5)
    bench.restart()
    assert not continues(bench)
    assert why_not(bench) == ["the rover is not within 1.5 m of a stored position"]


@pytest.mark.at_length
def test_a_suspended_plan_leaves_no_growing_record(bench: PlanBench) -> None:
    begin(bench, f"<Sequence>{SLEEP}{BACK}</Sequence>")
    bench.request(SuspendPlan("survey"))
    bench.run(1.0)
    before = sizes(bench)
    bench.run(examples(10_000) * STEP_S)
    assert sizes(bench) == before
    assert bench.status().status is SUSPENDED


def sizes(bench: PlanBench) -> tuple[object, ...]:
    """Return the number of commits, and of the rows and characters of plans and reports."""
    return (
        bench.ledger.sealed,
        bench.ledger.rows("SELECT count(*), sum(length(state)) FROM plan_states"),
        bench.ledger.rows("SELECT count(*), max(sequence) FROM reports"),
        bench.ledger.rows("SELECT count(*) FROM plan_steps"),
        len(bench.received.reports) + len(bench.received.plans),
    )


STORED = {
    "count |": "Repeat RetryUntilSuccessful",
    "current skipped catching |": "TryCatch",
    "current skipped |": "AsyncFallback AsyncSequence Fallback Sequence SequenceWithMemory",
    "current |": "IfThenElse",
    "ended good bad |": "Parallel ParallelAll",
    "inside |": "Precondition",
    "left busy |": "LoopDouble LoopPlace LoopString",
    "running |": "Switch2 Switch3 Switch4 Switch5 Switch6",
    "until_utc_s |": "Ask WaitFor",
    "was |": "RunOnce",
    "| until_s": "Delay Sleep Timeout",
}
"""Stored attributes and timers of the nodes, in their order: rovers have states with them."""


def test_states_of_earlier_versions_have_the_attributes_of_the_nodes() -> None:
    stored = {name: attributes for attributes, names in STORED.items() for name in names.split()}
    found = {name: " ".join((*kind.memory, "|", *kind.timers)) for name, kind in NODES.items()}
    assert {name: each for name, each in found.items() if each != "|"} == stored
