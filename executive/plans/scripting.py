"""Scripts of plans: values, static types, compiled evaluation.

The semantics are those of BehaviorTree.CPP v4: both operands of `&&` and `||` are evaluated.
Differences: a value that is not known raises `UnknownValueError`, and a division by zero
`EvaluationError`; types are checked when the script is read.
"""

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, unique
from itertools import pairwise
from math import isfinite
from typing import Final

from executive.plans.syntax import (
    ASSIGNMENTS,
    COMPARE,
    CONSTANTS,
    LITERAL,
    NAME,
    Expression,
    ScriptError,
    Value,
)

MAX_TEXT_LENGTH: Final = 1024
"""Maximum length in characters of a text that a script builds."""
EQUALITY_TOLERANCE: Final = 2.0**-23
"""Difference within which two numbers are equal; the epsilon of a 32-bit float."""

Cells = list[Value | None]
Evaluation = Callable[[Cells], Value]


class UnknownValueError(Exception):
    """A cell that a script reads has no known value.

    Attributes:
        cell: number of the cell.
    """

    def __init__(self, cell: int) -> None:
        super().__init__(f"cell {cell}")
        self.cell = cell


class EvaluationError(Exception):
    """A script cannot be evaluated, as it divides by zero; the plan fails."""


@unique
class ValueType(Enum):
    """Type of a cell or an expression."""

    NUMBER = "a number"
    TEXT = "a text"


def type_of(value: Value) -> ValueType:
    """Return the type of a value."""
    return ValueType.TEXT if isinstance(value, str) else ValueType.NUMBER


def text_of(value: Value) -> str:
    """Return a value as text; whole numbers have no decimals."""
    if isinstance(value, str):
        return value
    return str(int(value)) if isfinite(value) and value == int(value) else repr(value)


_NUMBER: Final = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")


def value_of(text: str) -> Value:
    """Return the value of a literal: a number where it is one, else the text."""
    if text in {"true", "false"}:
        return CONSTANTS[text]
    if not _NUMBER.fullmatch(text) or not isfinite(number := float(text)):
        return text
    return number


def equal(left: Value, right: Value) -> bool:
    """Return whether two values of one type are equal; numbers within the tolerance."""
    if isinstance(left, str) or isinstance(right, str):
        return left == right
    return left == right or abs(left - right) <= EQUALITY_TOLERANCE


def case_matches(variable: Value, case: Value) -> bool:
    """Return whether a variable has the value of a case: equal texts, else equal numbers."""
    if text_of(variable) == text_of(case):
        return True
    one, other = as_number(variable), as_number(case)
    return one is not None and other is not None and equal(one, other)


def as_number(value: Value) -> float | None:
    """Return a value as a number; None if it is a text that is neither a number nor a constant."""
    if not isinstance(value, str):
        return value
    if value in CONSTANTS:
        return CONSTANTS[value]
    found = value_of(value)
    return None if isinstance(found, str) else found


@dataclass(frozen=True, slots=True)
class Script:
    """Statements in order; the last one has the value of the script.

    Attributes:
        run: evaluates it on the cells. Raises `UnknownValueError` or `EvaluationError`.
        statements: its syntax trees.
    """

    text: str
    statements: tuple[Expression, ...]
    run: Evaluation

    def holds(self, cells: Cells) -> bool:
        """Return whether the value is not 0; a text is not empty."""
        return bool(self.run(cells))


Types = list[ValueType | None]
"""Type of each cell; None as long as it is not determined."""

NUMBER, TEXT = ValueType.NUMBER, ValueType.TEXT


def infer(expression: Expression, types: Types) -> ValueType | None:
    """Return the type of an expression, and set those of the cells that it assigns.

    Raises:
        ScriptError: types are mixed.
    """
    found = [infer(each, types) for each in expression.operands]
    sign, column = expression.sign, expression.column
    if sign == LITERAL:
        return type_of(expression.value)
    if sign == NAME:
        return types[expression.cell]
    if sign == COMPARE:
        for each, pair in zip(expression.text.split(), pairwise(found), strict=True):
            _common(pair, column, f"{each!r} compares {{}} with {{}}")
        return NUMBER
    if sign == "?":
        return _common(found[1:], column, "'?' chooses between {} and {}")
    if sign == "..":
        if found == [NUMBER, NUMBER]:
            raise ScriptError(column, "'..' joins texts: one side at least is a text")
        return TEXT
    result: ValueType | None = NUMBER
    if sign in {"+", ":=", "=", "+="}:
        result = _common(found, column, f"{sign!r} adds a number to a text: join them by '..'")
    elif TEXT in found:
        needs = "a number" if len(found) == 1 else "numbers"
        text = expression.operands[found.index(TEXT)]
        raise ScriptError(text.column, f"{sign!r} needs {needs}, not a text")
    return _assigned(expression, result, types) if sign in ASSIGNMENTS else result


def _common(found: Sequence[ValueType | None], column: int, text: str) -> ValueType | None:
    known = [each for each in found if each is not None]
    if len({*known}) > 1:
        raise ScriptError(column, text.format(*(each.value for each in known)))
    return known[0] if known else None


def _assigned(assignment: Expression, found: ValueType | None, types: Types) -> ValueType | None:
    text = f"{assignment.text} is {{}}, and gets {{}}: use another name"
    before = types[assignment.cell]
    types[assignment.cell] = _common((before, found), assignment.column, text)
    return types[assignment.cell]


def compile_script(text: str, statements: tuple[Expression, ...]) -> Script:
    """Return a script that can be run."""
    runs = tuple(map(_compiled, statements))

    def run(cells: Cells) -> Value:
        value: Value = 0.0
        for each in runs:
            value = each(cells)
        return value

    return Script(text, statements, runs[0] if len(runs) == 1 else run)


def _compiled(expression: Expression) -> Evaluation:
    sign, value, cell = expression.sign, expression.value, expression.cell
    operands = tuple(map(_compiled, expression.operands))
    if sign in ASSIGNMENTS:
        return _assignment(sign, cell, operands[0])
    match sign, operands:
        case "literal", _:
            return lambda _: value
        case "name", _:
            return _read(cell)
        case "compare", _:
            return _comparison([_COMPARE[each] for each in expression.text.split()], operands)
        case "?", (decides, one, other):
            return lambda cells: one(cells) if decides(cells) else other(cells)
        case "-", (one,):
            return lambda cells: -_number(one(cells))
        case "!", (one,):
            return lambda cells: float(not _number(one(cells)))
        case "~", (one,):
            return lambda cells: float(~_whole(one(cells), truncated=True))
        case _:
            apply, (left, right) = _BINARY[sign], operands
            return lambda cells: apply(left(cells), right(cells))


def _read(cell: int) -> Evaluation:
    def run(cells: Cells) -> Value:
        value = cells[cell]
        if value is None:
            raise UnknownValueError(cell)
        return value

    return run


def _comparison(
    compare: Sequence[Callable[[Value, Value], bool]], operands: tuple[Evaluation, ...]
) -> Evaluation:
    first, *others = operands
    pairs = tuple(zip(compare, others, strict=True))

    def run(cells: Cells) -> Value:
        left = first(cells)
        for holds, operand in pairs:
            right = operand(cells)
            if not holds(left, right):
                return 0.0
            left = right
        return 1.0

    return run


def _assignment(sign: str, cell: int, value: Evaluation) -> Evaluation:
    change, read = _BINARY.get(sign[0]), _read(cell)

    def assign(cells: Cells) -> Value:
        found = value(cells)
        found = cells[cell] = found if change is None else change(read(cells), found)
        return found

    return assign


def _number(value: Value) -> float:
    if isinstance(value, str):
        raise EvaluationError(f"{value[:40]!r} is no number")
    return value


def _finite(number: float) -> float:
    if not isfinite(number):
        raise EvaluationError("a result is too large")
    return number


def _whole(value: Value, *, truncated: bool = False) -> int:
    number = _number(value)
    if not isfinite(number) or abs(number) >= 2.0**63 or not (truncated or number == int(number)):
        raise EvaluationError(f"{number:g} has no bits: a whole number is needed")
    return int(number)


def _add(left: Value, right: Value) -> Value:
    if isinstance(left, str) and isinstance(right, str):
        return _join(left, right)
    return _finite(_number(left) + _number(right))


def _join(left: Value, right: Value) -> Value:
    text = text_of(left) + text_of(right)
    if len(text) > MAX_TEXT_LENGTH:
        raise EvaluationError(f"a text of {len(text)} characters: {MAX_TEXT_LENGTH} at most")
    return text


def _divide(left: Value, right: Value) -> Value:
    divisor = _number(right)
    if divisor == 0.0:
        raise EvaluationError("division by zero")
    return _finite(_number(left) / divisor)


def _ordered(compare: Callable[[float, float], bool]) -> Callable[[Value, Value], bool]:
    def holds(left: Value, right: Value) -> bool:
        if isinstance(left, str) and isinstance(right, str):
            texts: Callable[[str, str], bool] = compare  # type: ignore[assignment]
            return texts(left, right)
        return compare(_number(left), _number(right))

    return holds


_BINARY: Final[dict[str, Callable[[Value, Value], Value]]] = {
    "+": _add,
    "-": lambda left, right: _finite(_number(left) - _number(right)),
    "*": lambda left, right: _finite(_number(left) * _number(right)),
    "/": _divide,
    "..": _join,
    "&": lambda left, right: float(_whole(left) & _whole(right)),
    "|": lambda left, right: float(_whole(left) | _whole(right)),
    "^": lambda left, right: float(_whole(left) ^ _whole(right)),
    "&&": lambda left, right: float(bool(_number(left)) and bool(_number(right))),
    "||": lambda left, right: float(bool(_number(left)) or bool(_number(right))),
}
_COMPARE: Final[dict[str, Callable[[Value, Value], bool]]] = {
    "==": equal,
    "!=": lambda left, right: not equal(left, right),
    "<": _ordered(operator.lt),
    ">": _ordered(operator.gt),
    "<=": _ordered(operator.le),
    ">=": _ordered(operator.ge),
}
