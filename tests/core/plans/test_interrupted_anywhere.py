"""Whatever happens to a plan, and when: nothing is done twice, every command has one end."""

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from executive.commands import AbortPlan, Resume, ResumePlan, Stop, SuspendPlan
from executive.plans import FINAL_STATUSES
from executive.plans.plan_lifecycle import PLAN_EDGES
from executive.values.facts import Odometry
from executive.values.geometry import STANDING, Pose
from executive.values.reports import PlanStatus, Stage
from tests.support.plans import PlanBench, plan

BODY = """<Sequence>
  <moveForward distance="0.31" deadline_s="60"/>
  <Parallel success_count="1">
    <setCameraAngles pan="2.1" deadline_s="60"/>
    <Sequence><rotateBy angle="0.4" deadline_s="60"/><moveForward distance="0.32" deadline_s="60"/></Sequence>
  </Parallel>
  <Fallback>
    <Timeout msec="900"><moveForward distance="5"/></Timeout>
    <rotateBy angle="-0.5" deadline_s="60"/>
  </Fallback>
  <Inverter>
    <RetryUntilSuccessful num_attempts="2"><deleteFile path="nothing.jpg" deadline_s="5"/></RetryUntilSuccessful>
  </Inverter>
  <Repeat num_cycles="2"><setTravelSpeed speed="0.7" deadline_s="5"/></Repeat>
  <Script code="driven := 0"/>
  <LoopDouble queue="0.11;0.12" value="{far}">
    <moveForward distance="{far}" deadline_s="60" _onSuccess="driven += 1"/>
  </LoopDouble>
  <ReactiveSequence>
    <ScriptCondition code="@BATERY_VOLTAGE &gt; 20 &amp;&amp; driven == 2"/>
    <Sequence><Sleep msec="150"/><rotateBy angle="0.21" deadline_s="60"/></Sequence>
  </ReactiveSequence>
  <takePicture deadline_s="9"/>
</Sequence>"""  # noqa: E501

ALWAYS = Counter(
    {
        '{"distance_m": 0.31}': 1,
        '{"angle_rad": -0.5}': 1,
        '{"distance_m": 0.11}': 1,
        '{"distance_m": 0.12}': 1,
        '{"angle_rad": 0.21}': 1,
        '{"speed_mps": 0.7}': 2,
        '{"width_px": null, "height_px": null, "format": null, "quality": null}': 1,
    }
)
"""What is executed in the end, whatever happened: each as often as the plan says."""

SOMETIMES = {'{"angle_rad": 0.4}', '{"distance_m": 0.32}', '{"pan_rad": 2.1, "tilt_rad": null}'}


def suspend(bench: PlanBench) -> None:
    bench.request(SuspendPlan("survey"))


def stop(bench: PlanBench) -> None:
    bench.numbered(Stop())
    assert bench.rover.velocity == STANDING


def locate(bench: PlanBench) -> None:
    """Let odometry come, if none has come since a crash."""
    if bench.executive.status.odometry is None:
        bench.step()


def jump(bench: PlanBench) -> None:
    locate(bench)  # the first odometry after a crash cannot be a jump
    rover = bench.rover
    rover.pose = Pose(rover.pose.x_m + 3.0, rover.pose.y_m, heading_rad=rover.pose.heading_rad)
    odometry = Odometry(bench.clock.now_s(), rover.pose, rover.velocity)
    bench.executive.observe(odometry)
    bench.executive.tick()


def crash(bench: PlanBench) -> None:
    bench.crash()


def crash_twice(bench: PlanBench) -> None:
    bench.crash()
    bench.crash()


def executed(bench: PlanBench) -> Counter[str]:
    """Return what was asked in the plan's commands that were executed."""
    rows = bench.ledger.rows(
        "SELECT command_id, request FROM commands WHERE source = 'plan:survey'"
    )
    requested = dict(rows)
    done = (number for number, stages in bench.commanded() if stages[-1] is Stage.EXECUTED)
    return Counter(requested[number] for number in done)


def poll(bench: PlanBench) -> None:
    """Check what holds at any time."""
    allowed = {(edge.source, edge.target) for edge in PLAN_EDGES}
    for before, after in pairwise(update.status for update in bench.received.plans):
        assert before is after or (before, after) in allowed
    for _, stages in bench.commanded():
        assert sum(stage.terminal for stage in stages) <= 1
    assert not executed(bench) - ALWAYS - Counter(SOMETIMES)


BREAKS = st.tuples(
    st.integers(0, 90),
    st.sampled_from([suspend, stop, jump, crash, crash_twice]),
    st.sampled_from([0, 1, 50]),
)


@pytest.mark.at_length
@given(st.lists(BREAKS, min_size=1, max_size=5))
@example([(0, crash, 0), (0, jump, 0)])
@example([(1, suspend, 0), (0, crash, 50)])
@settings(max_examples=20, deadline=None)
def test_a_plan_continues_at_its_interruption(
    breaks: list[tuple[int, Callable[[PlanBench], None], int]],
) -> None:
    with TemporaryDirectory() as folder, PlanBench(Path(folder)) as bench:
        bench.rover.lazy_camera = True
        bench.go(plan(BODY))
        for steps, interrupt, pause in breaks:
            for _ in range(steps):
                bench.step()
            interrupt(bench)
            poll(bench)
            if bench.status().status in FINAL_STATUSES:
                break
            assert bench.status().status is PlanStatus.SUSPENDED
            for _ in range(pause):
                bench.step()
            if pause == 50:
                assert bench.rover.velocity == STANDING
            assert all(stages[-1].terminal for _, stages in bench.commanded())
            bench.numbered(Resume())
            locate(bench)
            bench.request(ResumePlan("survey"))
        assert bench.until(*FINAL_STATUSES) is PlanStatus.COMPLETED, bench.status()
        poll(bench)
        assert executed(bench) & ALWAYS == ALWAYS
        assert all(stages[-1].terminal for _, stages in bench.commanded())
        assert bench.ledger.rows("SELECT * FROM plan_steps") == []


GOOD = '<setTravelSpeed speed="0.5" deadline_s="5"/>'
BAD = '<deleteFile path="nothing.jpg" deadline_s="5"/>'
TREES = st.recursive(
    st.sampled_from(["good", "bad"]),
    lambda below: st.one_of(
        st.tuples(
            st.sampled_from(["Sequence", "Fallback"]), st.lists(below, min_size=1, max_size=3)
        ),
        st.tuples(
            st.sampled_from(["Inverter", "Repeat", "RetryUntilSuccessful"]),
            st.lists(below, min_size=1, max_size=1),
        ),
    ),
    max_leaves=8,
)
EXTRA = {"Repeat": ' num_cycles="2"', "RetryUntilSuccessful": ' num_attempts="2"'}


Tree = str | tuple[str, list[Any]]


def written(tree: Tree) -> str:
    """Return a random tree as XML."""
    if isinstance(tree, str):
        return GOOD if tree == "good" else BAD
    kind, children = tree
    return f"<{kind}{EXTRA.get(kind, '')}>{''.join(map(written, children))}</{kind}>"


def expected(tree: Tree, requested: list[bool]) -> bool:
    """Run a random tree in the head: whether it succeeds, and how each command ends."""
    if isinstance(tree, str):
        requested.append(tree == "good")
        return requested[-1]
    kind, children = tree
    match kind:
        case "Sequence":
            return all(expected(child, requested) for child in children)
        case "Fallback":
            return any(expected(child, requested) for child in children)
        case "Inverter":
            return not expected(children[0], requested)
        case "Repeat":
            return expected(children[0], requested) and expected(children[0], requested)
        case _:
            return expected(children[0], requested) or expected(children[0], requested)


@pytest.mark.at_length
@given(TREES, st.lists(st.integers(0, 40), max_size=3), st.booleans())
@settings(max_examples=30, deadline=None)
def test_a_plan_runs_as_in_the_head(tree: Tree, breaks: list[int], crashes: bool) -> None:
    requested: list[bool] = []
    succeeds = expected(tree, requested)
    with TemporaryDirectory() as folder, PlanBench(Path(folder)) as bench:
        bench.go(plan(written(tree)))
        for steps in breaks:
            for _ in range(steps):
                bench.step()
            if crashes:
                bench.crash()
            else:
                bench.request(SuspendPlan("survey"))
            bench.step()
            bench.request(ResumePlan("survey"))
        end = bench.until(*FINAL_STATUSES)
        assert end is (PlanStatus.COMPLETED if succeeds else PlanStatus.FAILED)
        assert [stages[-1] for _, stages in bench.commanded()] == [
            Stage.EXECUTED if good else Stage.REJECTED for good in requested
        ]
        bench.request(AbortPlan("survey"))
        assert bench.status().status is end
