"""`constant_conditions`: conditions on telemetry that never hold, or always do.

Only conditions are examined that compare telemetry with numbers: between two of these numbers, and
the bounds of the telemetry, the answer is constant, so that few values represent all.
"""

from collections.abc import Iterator
from itertools import pairwise, product
from math import inf, pi, prod
from typing import Final

from executive.plans.abstraction import scripts_of
from executive.plans.dialect import BATTERY_CHARGE, LINK_UP
from executive.plans.model import PlanNode
from executive.plans.scripting import Cells
from executive.plans.syntax import COMPARE, LITERAL, NAME, Expression, Value, expressions
from executive.values.parameters import Parameter

BOUNDS: Final = {
    LINK_UP: (0.0, 1.0, "0 or 1"),
    BATTERY_CHARGE: (0.0, 1.0, "0 to 1"),
    Parameter.HEAD.value: (-pi, pi, "-pi to pi rad"),
}
"""Minimum, maximum, and both as text, of the telemetry with bounds of its own."""
_MAX_COMBINATIONS: Final = 1000


def constant_conditions(node: PlanNode, telemetry: dict[int, str]) -> Iterator[tuple[bool, str]]:
    """Yield whether a condition of a node always holds or never, and the text for the operator.

    Args:
        node: the node.
        telemetry: names of the cells with telemetry.
    """
    for attribute, script in scripts_of(node):
        found = tuple(expressions(script.statements))
        cells = sorted({each.cell for each in found if each.sign == NAME})
        if not cells or not all(map(_is_comparison, found)) or not telemetry.keys() >= {*cells}:
            continue
        numbers = [each.value for each in found if each.sign == LITERAL]
        values = [tuple(_values(telemetry[cell], numbers)) for cell in cells]
        if prod(map(len, values)) > _MAX_COMBINATIONS:
            continue
        blackboard: Cells = [None] * (cells[-1] + 1)
        answers = set()
        for combination in product(*values):
            for cell, value in zip(cells, combination, strict=True):
                blackboard[cell] = value
            answers.add(script.holds(blackboard))
        if len(answers) == 1:
            holds = answers == {True}
            names = [telemetry[cell] for cell in cells if telemetry[cell] in BOUNDS]
            bounds = " and ".join(f"{name} is {BOUNDS[name][2]}" for name in names)
            text = f"{attribute}: {script.text}: it {'always' if holds else 'never'} holds"
            yield holds, f"{text}: {bounds}" if bounds else text


def _is_comparison(expression: Expression) -> bool:
    """Return whether an expression may be part of comparisons with numbers."""
    if expression.sign == LITERAL:
        return not isinstance(expression.value, str)
    if expression.sign == "-":
        return [each.sign for each in expression.operands] == [LITERAL]
    return expression.sign in {COMPARE, NAME, "&&", "||", "!"}


def _values(name: str, numbers: list[Value]) -> Iterator[float]:
    """Yield the numbers within the bounds of a telemetry, one between each two, and beyond."""
    low, high, _ = BOUNDS.get(name, (-inf, inf, ""))
    compared = {sign * each for each in numbers if not isinstance(each, str) for sign in (-1, 1)}
    known = sorted(each for each in {0.0, low, high, *compared} if low <= each <= high)
    finite = [each for each in known if abs(each) < inf]
    yield from finite
    if name != LINK_UP:
        yield from ((one + other) / 2 for one, other in pairwise(finite))
    yield from (each for each in (finite[0] - 1.0, finite[-1] + 1.0) if low <= each <= high)
