"""The tick of a plan of 300 nodes with 60 branches running, its state, and the stored text."""

import statistics
from collections.abc import Callable
from time import thread_time
from typing import Final

import py_trees

from executive.commands import PlanDefinition
from executive.plans import FORMAT, PlanRoot, read_plan
from executive.plans.state import PlanState, encode
from tests.support.figures import Figure, Goal
from tests.support.scripted_plans import ScriptedPort
from trees.plan import PlanTree

BRANCHES: Final = 60
_BRANCH: Final = """<ReactiveSequence>
  <ScriptCondition code="@BATERY_VOLTAGE &gt; 20"/>
  <Sequence><WaitFor if="@LINK_UP == 1" deadline_s="9"/><takePicture deadline_s="9"/></Sequence>
</ReactiveSequence>"""
TICK_S: Final = 0.5e-3
"""Bound of the tick."""
BATCH: Final = 20
"""Ticks that are timed together."""


def plan_text() -> str:
    """Return the text of the plan: five nodes in each branch, below two."""
    branches = BRANCHES * _BRANCH
    body = f'<ParallelAll max_failures="{BRANCHES}">{branches}</ParallelAll>'
    tree = f'<BehaviorTree ID="Main">{body}</BehaviorTree>'
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">{tree}</root>'


def _py_trees_root() -> py_trees.behaviour.Behaviour:
    """Return a tree of the same form of py_trees' own nodes."""
    status, policy = py_trees.common.Status, py_trees.common.ParallelPolicy.SuccessOnAll()
    branches = []
    for number in range(BRANCHES):
        wait = py_trees.behaviours.Running(f"wait {number}")
        picture = py_trees.behaviours.Success(f"picture {number}")
        inner = py_trees.composites.Sequence(f"in {number}", memory=True, children=[wait, picture])
        holds = py_trees.behaviours.StatusQueue(f"holds {number}", [], status.SUCCESS)
        children = [holds, inner]
        branches.append(py_trees.composites.Sequence(f"{number}", memory=False, children=children))
    return py_trees.composites.Parallel("all", policy, children=branches)


def measure(batches: int) -> list[Figure]:
    """Return the figures.

    Args:
        batches: number of timed batches of ticks; the median of them counts.
    """
    root = read_plan(PlanDefinition("large", "large", FORMAT, plan_text().encode(), ()))
    assert isinstance(root, PlanRoot)
    port = ScriptedPort()
    port.values = {"BATERY_VOLTAGE": 25.0, "LINK_UP": 0.0}
    tree, other = PlanTree(root, port), _py_trees_root()
    plan_s, other_s = _interleaved_s(tree.tick, other.tick_once, batches)
    tree.tick()
    state_s, encode_s = _interleaved_s(tree.state, lambda: encode(PlanState(tree.state())), batches)
    count = len(tree.nodes)
    assert tree.state().statuses.count("R") == 2 + 3 * BRANCHES
    beside = f"{count} nodes, {BRANCHES} branches running"
    own = f"{other_s * 1e3:.3f} ms: a tree of py_trees of this form"
    return [
        Figure("plan: tick", plan_s * 1e3, "ms", own, Goal(TICK_S * 1e3)),
        Figure("plan: tick / tick of py_trees", plan_s / other_s, "", beside),
        Figure("plan: taking the state", state_s * 1e6, "µs", beside),
        Figure("plan: taking the state as text", encode_s * 1e6, "µs", beside),
        Figure("plan: stored state", len(encode(PlanState(tree.state()))), "octets", beside),
    ]


def _interleaved_s(
    one: Callable[[], object], other: Callable[[], object], batches: int
) -> tuple[float, float]:
    """Return the median durations of two calls, timed in turn."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(batches):
        for call, found in zip((one, other), times, strict=True):
            begin_s = thread_time()
            for _ in range(BATCH):
                call()
            found.append((thread_time() - begin_s) / BATCH)
    return statistics.median(times[0]), statistics.median(times[1])
