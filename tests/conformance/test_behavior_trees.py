"""Plans against BehaviorTree.CPP 4.10: traces of random plans, and each known difference."""

import json
import re
from dataclasses import dataclass
from math import inf
from typing import Any

import pytest

from executive.plans import LeafError, PlanRoot, Value
from executive.values.reasons import Refusal
from tests.stress import plan_traces
from tests.support.behaviortree_cpp.differences import DIFFERENCES_OF_4_10
from tests.support.behaviortree_cpp.traces import (
    DIFFERENCES,
    RecordedPlan,
    Trace,
    recorded_digests,
    recorded_plans,
    recorded_scripts,
    trace_of,
)
from tests.support.random_plans import RandomPlan
from tests.support.random_scripts import RESULT, random_script, script_plan
from tests.support.scripted_plans import play, read
from trees.plan import Answer
from trees.plan.controls import OrderedBranch
from trees.plan.decorators import LoopDecorator

RECORDED: dict[str, Any] = json.loads(DIFFERENCES.read_text("utf-8"))
EXCEPTIONS = ("exception in a condition", "division by zero")
"""Differences that have no common trace."""
SAME_RECORDED = ("tick without end", "Sleep begun again")
"""Not to be seen in a trace: the driver ends the tick, and its timers have no thread."""


def root_of(plan: RandomPlan) -> PlanRoot:
    root = read(plan)
    assert not isinstance(root, Refusal), root.text
    return root


@pytest.fixture(scope="module")
def recorded() -> list[RecordedPlan]:
    """Give the plans with full traces."""
    return list(recorded_plans())


def first_difference(trace: Trace, wanted: Trace) -> str:
    """Return the first tick that differs."""
    for tick, (found, expected) in enumerate(zip(trace, wanted, strict=False)):
        if found != expected:
            return f"tick {tick}: {found}\n  4.10: {expected}"
    return f"{len(trace)} ticks, 4.10: {len(wanted)}"


@pytest.mark.parametrize("stored", [False, True], ids=["in memory", "state stored each tick"])
def test_random_plans_do_in_each_tick_what_4_10_does(
    recorded: list[RecordedPlan], stored: bool
) -> None:
    # The full run of both is part of the stress test; here the second is run for a quarter.
    for each in recorded[:: 4 if stored else 1]:
        plan = each.plan
        trace = play(plan, root_of(plan), stored)
        if trace != each.trace:
            pytest.fail(f"seed {each.seed}: {first_difference(trace, each.trace)}\n{plan.text}")


def test_nine_in_ten_traces_are_of_4_10_without_corrections(recorded: list[RecordedPlan]) -> None:
    assert len(recorded) == 1000
    corrected = [each for each in recorded if each.corrections]
    assert len(corrected) <= 100
    for each in corrected:
        assert all(f"<{kind} " in each.plan.text or f"<{kind}>" in each.plan.text
                   for kind in each.corrections)  # fmt: skip


def test_the_recorded_plans_have_every_kind_of_node_and_condition(
    recorded: list[RecordedPlan],
) -> None:
    texts = "".join(each.plan.text for each in recorded)
    kinds = """
        Sequence Fallback AsyncSequence AsyncFallback SequenceWithMemory ReactiveSequence
        ReactiveFallback Parallel ParallelAll IfThenElse WhileDoElse Switch2 Switch3 TryCatch
        Inverter ForceSuccess ForceFailure Repeat RetryUntilSuccessful KeepRunningUntilFailure
        RunOnce Timeout Delay Sleep Precondition LoopString LoopDouble Script ScriptCondition
        SetBlackboard AlwaysSuccess AlwaysFailure SubTree TreeNodesModel"""
    assert [kind for kind in kinds.split() if texts.count(f"<{kind}") < 40] == []
    names = "_failureIf _successIf _skipIf _while _onHalted _onFailure _onSuccess _post _autoremap"
    assert [name for name in names.split() if texts.count(f" {name}=") < 100] == []
    ends = [each.trace[-1].result for each in recorded]
    assert min(ends.count(result) for result in "SFRH") > 30


def test_a_run_of_the_stress_part_finds_no_difference() -> None:
    lines: list[str] = []
    figures = plan_traces.measure(40, 1, lines.append)
    assert [each.name for each in figures if each.met is False] == []
    assert lines == []
    assert len(recorded_digests()) == 30_000


class ForgetfulSequence(OrderedBranch):
    """A Sequence that begins anew after its state was stored."""

    memory = ()


class HastyRepeat(LoopDecorator):
    """A Repeat that leaves out its last cycle."""

    def run(self) -> Answer:
        """Count one cycle before the first."""
        self.count = max(self.count, 1)
        return super().run()


@pytest.mark.parametrize(
    ("kind", "fault", "found"),
    [
        ("Sequence", ForgetfulSequence, {"DIFFERS_STORED"}),
        ("Repeat", HastyRepeat, {"DIFFERS", "DIFFERS_STORED"}),
    ],
)
def test_the_stress_part_finds_a_faulty_node(kind: str, fault: type, found: set[str]) -> None:
    figures = plan_traces.measure(40, 1, lambda _: None, {kind: fault})
    broken = {each.name.removeprefix("plans: ") for each in figures if each.met is False}
    assert broken == {plan_traces.TraceFault[name].value for name in found}


TYPES = re.compile(
    r"needs (a number|numbers), not a text|joins texts|adds a number to a text|and gets a text"
    r"|(compares|chooses between) a (text|number) (and|with) a (text|number)"
)


@dataclass(frozen=True, slots=True)
class NoValue:
    """A script has no result."""

    cause: str


def result_of(script: str) -> Value | NoValue:
    plan = script_plan(script)
    root = read(plan)
    if isinstance(root, Refusal):
        return NoValue(root.text)
    try:
        (tick,) = play(plan, root)
    except LeafError as error:
        return NoValue(str(error.__cause__))
    (value,) = (value for _, name, value in tick.cells if name == RESULT)
    return value


def test_random_scripts_have_the_results_of_4_10() -> None:
    # Deliberate differences: types are checked when a plan is read, a division by zero is an error,
    # numbers other than 0 and 1 have a truth value, a number in a text has no zeros at its end.
    same = 0
    for seed, wanted in enumerate(recorded_scripts()):
        script = random_script(seed)
        match result_of(script):
            case NoValue(cause) if wanted is not None:
                assert TYPES.search(cause) or cause == "division by zero", script
            case NoValue():
                same += 1
            case found if wanted is None:
                assert re.search(r"&&|\|\||\?", script), (script, found)
            case found:
                assert found == wanted or ".." in script, (script, found, wanted)
                same += 1
    assert same > 850


@pytest.mark.parametrize("name", [each for each in DIFFERENCES_OF_4_10 if each not in EXCEPTIONS])
def test_a_deliberate_difference_is_as_described(name: str) -> None:
    plan, recording = DIFFERENCES_OF_4_10[name].plan, RECORDED[name]
    trace = play(plan, root_of(plan))
    assert trace == trace_of(recording["corrected"])
    assert (trace == trace_of(recording["4.10"])) == (name in SAME_RECORDED)
    assert recording["bounded"] == (name == "tick without end")


def test_an_unknown_value_fails_its_node_and_not_the_tick() -> None:
    assert "Variable not found: w" in RECORDED["exception in a condition"]["error"]
    plan = DIFFERENCES_OF_4_10["exception in a condition"].plan
    assert [tick.result for tick in play(plan, root_of(plan))] == ["R", "S"]


def test_a_division_by_zero_fails_the_plan() -> None:
    plan = DIFFERENCES_OF_4_10["division by zero"].plan
    assert RECORDED["division by zero"]["4.10"][0][2] == [[0, "x", inf]]
    with pytest.raises(LeafError) as raised:
        play(plan, root_of(plan))
    assert "zero" in str(raised.value.__cause__)
