"""Syntax of the scripts of plans: tokens, a tree of expressions with columns.

The language is that of BehaviorTree.CPP v4. A name is a numbered cell of the blackboard when the
script is read; nothing is looked up by name later.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, assert_never

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


class ScriptError(ValueError):
    """A script is not valid; the message has the column, from 1."""

    def __init__(self, column: int, text: str) -> None:
        super().__init__(f"column {column}: {text}")


@dataclass(frozen=True, slots=True)
class Literal:
    """A number or a text."""

    column: int
    value: Value


@dataclass(frozen=True, slots=True)
class Name:
    """A cell that is read."""

    column: int
    cell: int
    text: str


@dataclass(frozen=True, slots=True)
class Unary:
    """`-`, `~` or `!`."""

    column: int
    sign: str
    operand: "Expression"


@dataclass(frozen=True, slots=True)
class Binary:
    """An operator between two operands."""

    column: int
    sign: str
    left: "Expression"
    right: "Expression"


@dataclass(frozen=True, slots=True)
class Comparison:
    """A chain of comparisons, as `1 < x <= 3`."""

    column: int
    signs: tuple[str, ...]
    operands: tuple["Expression", ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """`condition ? first : second`."""

    column: int
    condition: "Expression"
    first: "Expression"
    second: "Expression"


@dataclass(frozen=True, slots=True)
class Assignment:
    """A cell that is written, by `:=`, `=`, `+=`, `-=`, `*=` or `/=`."""

    column: int
    sign: str
    cell: int
    text: str
    value: "Expression"


Expression = Literal | Name | Unary | Binary | Comparison | Choice | Assignment


_TOKEN: Final = re.compile(
    r"\s*(?:(?P<text>'[^']*')|(?P<hex>0[xX][0-9a-fA-F]+)(?![\w.])"
    r"|(?P<number>(?>[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?))(?![A-Za-z_]|\.(?!\.))"
    r"|(?P<name>[A-Za-z_@][A-Za-z0-9_]*)"
    r"|(?P<sign>:=|==|!=|<=|>=|&&|\|\||\+=|-=|\*=|/=|\.\.|[-+*/&|^~!<>=?:();]))"
)
_POWERS: Final = {
    **dict.fromkeys((":=", "=", "+=", "-=", "*=", "/="), 2),
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
    at, end = 0, len(text.rstrip())
    while at < end:
        match = _TOKEN.match(text, at)
        if match is None or match.lastgroup is None:
            at += len(text[at:]) - len(text[at:].lstrip())
            raise ScriptError(at + 1, f"{text[at : at + 12]!r} is no part of a script")
        kind = match.lastgroup
        found.append(_Token(kind, match[kind], match.start(kind) + 1))
        at = match.end()
        if len(found) > MAX_TOKENS:
            raise ScriptError(found[-1].column, f"a script has {MAX_TOKENS} tokens at most")
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
        while True:
            token = self._peek
            power = _POWERS.get(token.text, -1) if token.kind == "sign" else -1
            if power < 0 or power < bound:
                break
            self._at += 1
            if power == _ASSIGNING:
                left = self._assignment(left, token)
                break
            if power == _CHOOSING:
                first = self._expression(0)
                self._expect(":")
                left = Choice(token.column, left, first, self._expression(_CHOOSING))
                break
            if power == _COMPARING:
                left = self._comparison(left, token)
                continue
            left = Binary(token.column, token.text, left, self._expression(power + 1))
        self._levels -= 1
        return left

    def _prefix(self) -> Expression:
        token = self._next()
        match token:
            case _Token("sign", "(", _):
                inner = self._expression(0)
                self._expect(")")
                return inner
            case _Token("sign", "-" | "~" | "!", column):
                return Unary(column, token.text, self._expression(_PREFIX))
            case _Token("text", text, column):
                return Literal(column, text[1:-1])
            case _Token("hex", text, column):
                return Literal(column, float(int(text, 16)))
            case _Token("number", text, column):
                return Literal(column, float(text))
            case _Token("name", text, column) if text in CONSTANTS:
                return Literal(column, CONSTANTS[text])
            case _Token("name", text, column):
                return Name(column, self._cell(text, column), text)
            case _:
                text = f"a value is expected, not {token.text[:20]!r}"
                raise ScriptError(token.column, text)

    def _cell(self, name: str, column: int) -> int:
        try:
            return self._resolve(name)
        except ScriptError:
            raise
        except ValueError as error:
            raise ScriptError(column, str(error)) from error

    def _assignment(self, left: Expression, token: _Token) -> Assignment:
        if not isinstance(left, Name):
            raise ScriptError(token.column, f"the left side of {token.text!r} is a variable")
        value = self._expression(0)
        return Assignment(left.column, token.text, left.cell, left.text, value)

    def _comparison(self, left: Expression, token: _Token) -> Comparison:
        signs, operands = [token.text], [left, self._expression(_COMPARING + 1)]
        while self._peek.kind == "sign" and _POWERS.get(self._peek.text) == _COMPARING:
            signs.append(self._next().text)
            operands.append(self._expression(_COMPARING + 1))
        return Comparison(token.column, tuple(signs), tuple(operands))


def parse(text: str, resolve: Resolve) -> tuple[Expression, ...]:
    """Return the statements of a script.

    Raises:
        ScriptError: it is not valid, or `resolve` raised ValueError for a name.
    """
    return _Parser(text, resolve).statements()


def expressions(statements: Sequence[Expression]) -> Iterator[Expression]:
    """Yield each expression of a script, in the order of evaluation."""
    for each in statements:
        match each:
            case Literal() | Name():
                pass
            case Unary(operand=operand):
                yield from expressions((operand,))
            case Binary(left=left, right=right):
                yield from expressions((left, right))
            case Comparison(operands=operands):
                yield from expressions(operands)
            case Choice(condition=condition, first=first, second=second):
                yield from expressions((condition, first, second))
            case Assignment(value=value):
                yield from expressions((value,))
            case _:
                assert_never(each)
        yield each
