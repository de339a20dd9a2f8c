"""Syntax of the scripts of plans: tokens, a tree of expressions with columns.

The language is that of BehaviorTree.CPP v4. A name is a numbered cell of the blackboard when the
script is read; nothing is looked up by name later.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from executive.commands import Mode

MAX_TOKENS: Final = 400
MAX_LEVELS: Final = 32

Value = float | str

CONSTANTS: Final[dict[str, float]] = {
    "true": 1.0,
    "false": 0.0,
    **{mode.name: float(mode.value) for mode in Mode},
}
"""Names of numbers: truth values and the modes of the asset."""


class ArgumentError(ValueError):
    """A text is no value of its attribute; the message begins with the attribute."""


class ScriptError(ArgumentError):
    """A script is not valid; the message has the column, from 1."""

    def __init__(self, column: int, text: str) -> None:
        super().__init__(f"column {column}: {text}")


@dataclass(frozen=True, slots=True)
class Expression:
    """One operation of a script.

    Attributes:
        sign: LITERAL, NAME, COMPARE, or the operator; `?` chooses.
        column: where it is in the script, from 1.
        value: of a literal.
        cell, text: the cell that it reads or assigns and its name; the operators of a comparison.
    """

    sign: str
    column: int
    operands: tuple["Expression", ...] = ()
    value: Value = 0.0
    cell: int = -1
    text: str = ""


LITERAL: Final = "literal"
NAME: Final = "name"
COMPARE: Final = "compare"
ASSIGNMENTS: Final = frozenset({":=", "=", "+=", "-=", "*=", "/="})


_TOKEN: Final = re.compile(
    r"(?P<text>'[^']*')|(?P<hex>0[xX][0-9a-fA-F]{1,16})(?![\w.])"
    r"|(?P<number>(?>[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?))(?![A-Za-z_]|\.(?!\.))"
    r"|(?P<name>[A-Za-z_@][A-Za-z0-9_]*)"
    r"|(?P<sign>:=|==|!=|<=|>=|&&|\|\||\+=|-=|\*=|/=|\.\.|[-+*/&|^~!<>=?:();])|(?P<other>\S)"
)
_POWERS: Final = {
    **dict.fromkeys(ASSIGNMENTS, 2),
    **{"?": 4, "||": 6, "&&": 8},
    **dict.fromkeys(("==", "!=", "<", ">", "<=", ">="), 10),
    **{"|": 12, "^": 12, "&": 14, "+": 16, "-": 16, "..": 16, "*": 18, "/": 18},
}
"""Binding power of each infix operator; a higher one binds tighter."""
_ASSIGNING, _CHOOSING, _COMPARING, _PREFIX = 2, 4, 10, 20


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    column: int


def _tokens(text: str) -> list[_Token]:
    found: list[_Token] = []
    for match in _TOKEN.finditer(text):
        column, kind = match.start() + 1, match.lastgroup or ""
        if kind == "other":
            raise ScriptError(column, f"{text[column - 1 : column + 11]!r} is no part of a script")
        if len(found) == MAX_TOKENS:
            raise ScriptError(column, f"a script has {MAX_TOKENS} tokens at most")
        found.append(_Token(kind, match[0], column))
    return found


Resolve = Callable[[str], int]
"""Returns the cell of a name."""


class _Parser:
    def __init__(self, text: str, resolve: Resolve) -> None:
        self._tokens = _tokens(text)
        self._end = _Token("end", "the end", len(text) + 1)
        self._resolve = resolve
        self._at = 0
        self._levels = 0

    def statements(self) -> tuple[Expression, ...]:
        found = []
        while self._peek.kind != "end":
            if self._peek.text == ";" and self._peek.kind == "sign":
                self._at += 1
                continue
            found.append(self._expression(0))
            if self._peek.kind != "end":
                self._expect(";")
        return tuple(found)

    @property
    def _peek(self) -> _Token:
        return self._tokens[self._at] if self._at < len(self._tokens) else self._end

    def _next(self) -> _Token:
        token = self._peek
        self._at += 1
        return token

    def _expect(self, sign: str) -> None:
        token = self._next()
        if token.kind != "sign" or token.text != sign:
            raise ScriptError(token.column, f"{sign!r} is expected, not {token.text[:20]!r}")

    def _expression(self, bound: int) -> Expression:
        self._levels += 1
        if self._levels > MAX_LEVELS:
            raise ScriptError(self._peek.column, f"a script is {MAX_LEVELS} levels deep at most")
        left = self._prefix()
        while (power := self._power) >= bound:
            token = self._next()
            if power == _ASSIGNING:
                if left.sign != NAME:
                    text = f"the left side of {token.text!r} is a variable"
                    raise ScriptError(token.column, text)
                value = (self._expression(0),)
                left = Expression(token.text, left.column, value, cell=left.cell, text=left.text)
                break
            if power == _CHOOSING:
                first = self._expression(0)
                self._expect(":")
                parts = (left, first, self._expression(_CHOOSING))
                left = Expression("?", token.column, parts)
                break
            if power == _COMPARING:
                signs, operands = [token.text], [left, self._expression(_COMPARING + 1)]
                while self._power == _COMPARING:
                    signs.append(self._next().text)
                    operands.append(self._expression(_COMPARING + 1))
                left = Expression(COMPARE, token.column, tuple(operands), text=" ".join(signs))
                continue
            left = Expression(token.text, token.column, (left, self._expression(power + 1)))
        self._levels -= 1
        return left

    @property
    def _power(self) -> int:
        token = self._peek
        return _POWERS.get(token.text, -1) if token.kind == "sign" else -1

    def _prefix(self) -> Expression:
        token = self._next()
        text, column = token.text, token.column
        match token.kind, text:
            case "sign", "(":
                inner = self._expression(0)
                self._expect(")")
                return inner
            case "sign", "-" | "~" | "!":
                return Expression(text, column, (self._expression(_PREFIX),))
            case "text", _:
                return Expression(LITERAL, column, value=text[1:-1])
            case (("hex" | "number"), _):
                number = float(int(text, 16)) if token.kind == "hex" else float(text)
                if not isfinite(number):
                    raise ScriptError(column, f"{text[:20]} is too large")
                return Expression(LITERAL, column, value=number)
            case "name", _ if text in CONSTANTS:
                return Expression(LITERAL, column, value=CONSTANTS[text])
            case "name", _:
                try:
                    return Expression(NAME, column, cell=self._resolve(text), text=text)
                except ValueError as error:
                    raise ScriptError(column, str(error)) from error
            case _:
                raise ScriptError(column, f"a value is expected, not {text[:20]!r}")


def parse(text: str, resolve: Resolve) -> tuple[Expression, ...]:
    """Return the statements of a script.

    Raises:
        ScriptError: it is not valid, or `resolve` raised ValueError for a name.
    """
    return _Parser(text, resolve).statements()


def expressions(statements: Sequence[Expression]) -> Iterator[Expression]:
    """Yield each expression of a script, in the order of evaluation."""
    for each in statements:
        yield from expressions(each.operands)
        yield each
