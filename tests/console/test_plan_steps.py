"""A list of steps is written as XML, and read back with the same arguments and conditions."""

from enum import Enum
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.console.requests.plan_steps import (
    DraftStep,
    WrittenStep,
    commands_of,
    sequence_xml,
    steps_of,
)
from adapters.console.rovers.dictionary import CONDITION_ENTRIES, NODE_ENTRIES
from executive.commands import Argument, PlanDefinition
from executive.plans import CONDITIONS, DIALECT, FORMAT, LEAVES, PlanNode, PlanRoot, read_plan
from executive.values.reasons import Refusal
from tests.support.plans import AHEAD, xml

FIGURES = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text("ab/é<>&\"'; \n\t", min_size=1)
POINTS = st.fixed_dictionaries({"x": FIGURES, "y": FIGURES}, optional={"heading": FIGURES})
SCRIPTS = st.fixed_dictionaries(
    {},
    optional={
        **dict.fromkeys(CONDITIONS, st.sampled_from(["@HEAD > 0 && @UTC < 5", "'a<\"' == 'b'"])),
        "if": st.just("@MODE == PLAN"),
    },
)
NODES: tuple[tuple[str, dict[str, str]], ...] = (
    ("WaitUntil", {"utc": "2026-11-27T09:00:00Z", "late_s": "60"}),
    ("WaitFor", {"if": "@LINK_UP", "deadline_s": "600"}),
    ("Sleep", {"msec": "500"}),
    (
        "Ask",
        {
            "question": 'cross "it" & go?',
            "options": "yes;no",
            "default": "no",
            "deadline_s": "90",
            "answer": "{choice}",
        },
    ),
    ("Near", {"x": "1", "y": "-2.5", "within": "0.3"}),
    ("Reachable", {"x": "1", "y": "2"}),
    ("FaultActive", {"name": "battery_low"}),
    ("ScriptCondition", {"code": "@BATERY_VOLTAGE > 22"}),
    ("Script", {"code": "n := 1; m := 'a'"}),
    ("SetBlackboard", {"value": "3", "output_key": "k"}),
    ("AlwaysSuccess", {}),
    ("AlwaysFailure", {}),
)


def value_of(argument: Argument) -> st.SearchStrategy[Any]:
    if argument.kind is float:
        return FIGURES
    if argument.kind is int:
        return st.integers(0, 999)
    if argument.kind is str:
        return TEXTS
    if issubclass(argument.kind, Enum):
        return st.sampled_from([each.value for each in argument.kind])
    return st.lists(POINTS, min_size=1, max_size=4)


@st.composite
def commands(draw: st.DrawFn) -> WrittenStep:
    leaf = LEAVES[draw(st.sampled_from(sorted(LEAVES)))]
    arguments = [each for each in leaf.user_arguments if not each.optional or draw(st.booleans())]
    args = {each.name: draw(value_of(each)) for each in arguments}
    name = draw(st.none() | st.text("wp1 é<&", min_size=1))
    return WrittenStep(leaf.name, args, name, draw(st.none() | st.floats(1, 9)), draw(SCRIPTS))


@st.composite
def other_nodes(draw: st.DrawFn) -> WrittenStep:
    kind, args = draw(st.sampled_from(NODES))
    return WrittenStep(kind, args, None, None, draw(SCRIPTS))


def read(content: bytes) -> PlanRoot:
    root = read_plan(PlanDefinition("a", "a", FORMAT, content))
    assert not isinstance(root, Refusal), root
    return root


@given(st.lists(commands() | other_nodes(), max_size=3), commands())
def test_written_steps_are_read_back(written: list[WrittenStep], last: WrittenStep) -> None:
    content = sequence_xml([*written, last]).encode()
    found = steps_of(read(content), content)
    assert isinstance(found, tuple)
    for step, expected in zip(found, [*written, last], strict=True):
        assert (step.operation, {name: step.args[name] for name in expected.args}) == (
            expected.operation,
            expected.args,
        )
        assert expected.deadline_s in {None, step.deadline}
        assert expected.name is None or step.name.startswith(expected.name)
        assert {name: step.conditions[name] for name in expected.conditions} == expected.conditions
        assert step.conditions.keys() == expected.conditions.keys()
    again = sequence_xml([written_again(each) for each in found])
    assert steps_of(read(again.encode()), again.encode()) == found


def written_again(step: DraftStep) -> WrittenStep:
    return WrittenStep(step.operation, step.args, step.name, step.deadline, step.conditions)


def test_the_palette_has_each_node_without_children_of_the_dialect_and_its_ports() -> None:
    others = {each.name for each in DIALECT.values() if each.max_children == 0} - LEAVES.keys()
    assert {each.name for each in NODE_ENTRIES} == others == {name for name, _ in NODES}
    for each in NODE_ENTRIES:
        needed = {port.name for port in DIALECT[each.name].ports if port.required}
        assert needed <= {one.name for one in each.arguments if not one.optional}, each.name
    assert {"_skipIf", "_failureIf", "if", "else"} <= {each.name for each in CONDITION_ENTRIES}


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (f"<Fallback>{AHEAD}</Fallback>", "Fallback"),
        (f"<Sequence>{AHEAD}<Inverter><AlwaysFailure/></Inverter></Sequence>", "Inverter"),
        (f'<Sequence _skipIf="@LINK_UP">{AHEAD}</Sequence>', "Sequence"),
        (f'<Sequence><Precondition name="a" if="@LINK_UP">{AHEAD}</Precondition></Sequence>', "a"),
        (
            '<Sequence><Script code="x := 1"/><moveForward distance="{x}" deadline_s="9"/>'
            "</Sequence>",
            "moveForward",
        ),
    ],
)
def test_other_plans_have_no_list(body: str, kind: str) -> None:
    found = steps_of(read(xml(body)), xml(body))
    assert isinstance(found, PlanNode)
    assert found.location.name == kind
    assert commands_of(read(xml(body))) is None


def test_a_plan_that_continues_after_a_restart_has_no_list_that_would_lose_it() -> None:
    text = xml(f"<Sequence>{AHEAD}</Sequence>")
    resumes = text.replace(b"<root", b'<root after_restart="resume"')
    assert isinstance(steps_of(read(text), text), tuple)
    assert isinstance(steps_of(read(resumes), resumes), PlanRoot)
