"""A sequence of steps is written as XML, and read back with the same arguments."""

from enum import Enum
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from executive.commands import Argument, PlanDefinition, argument_values
from executive.plans import FORMAT, LEAVES, WrittenStep, read_plan, sequence_xml, steps_of
from executive.values.reasons import Refusal

FIGURES = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text("ab/é<>&\"'; \n\t", min_size=1)
POINTS = st.fixed_dictionaries({"x": FIGURES, "y": FIGURES}, optional={"heading": FIGURES})


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
def steps(draw: st.DrawFn) -> WrittenStep:
    leaf = LEAVES[draw(st.sampled_from(sorted(LEAVES)))]
    arguments = [each for each in leaf.user_arguments if not each.optional or draw(st.booleans())]
    args = {each.name: draw(value_of(each)) for each in arguments}
    name = draw(st.none() | st.text("wp1 é<&", min_size=1))
    return WrittenStep(leaf.name, args, name, draw(st.none() | st.floats(1, 9)))


@given(st.lists(steps(), min_size=1, max_size=4))
def test_what_is_written_is_read_back(written: list[WrittenStep]) -> None:
    content = sequence_xml(written).encode()
    root = read_plan(PlanDefinition("a", "a", FORMAT, content))
    assert not isinstance(root, Refusal), root
    found = steps_of(root)
    assert isinstance(found, tuple)
    for step, asked in zip(found, written, strict=True):
        assert step.request is not None
        values = argument_values(step.request)
        assert {name: values[name] for name in asked.args} == asked.args
        assert asked.deadline_s in {None, step.deadline_s}
        assert asked.name is None or step.location.name.startswith(asked.name)
