"""Scripts are parsed, typed and evaluated as those of BehaviorTree.CPP v4."""

import pytest

from executive.plans.scripting import (
    EvaluationError,
    Types,
    UnknownValueError,
    compile_script,
    infer,
)
from executive.plans.syntax import MAX_LEVELS, MAX_TOKENS, ScriptError, Value, parse

NAMES = ("x", "y", "text", "unknown")


def resolve(name: str) -> int:
    if name not in NAMES:
        raise ValueError(f"nothing sets {name}")
    return NAMES.index(name)


def run(text: str) -> tuple[Value, list[Value | None]]:
    """Run a script where x is 3, y is 0.5, and text is 'ab'."""
    statements = parse(text, resolve)
    types: Types = [None] * len(NAMES)
    for each in parse("x := 3; y := 0.5; text := 'ab'", resolve):
        infer(each, types)
    for each in statements:
        infer(each, types)
    cells: list[Value | None] = [3.0, 0.5, "ab", None]
    return compile_script(text, statements).run(cells), cells


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("-2 * -3", 6),
        ("7 / 2 - 1", 2.5),
        ("2 - 1 - 1", 0),
        ("0x10 + 1e2", 116),
        ("1 < x <= 3", 1),
        ("1 < 2 == 2", 1),
        ("x != 3 || y == 0.5 && true", 1),
        ("!(x > 2) || false", 0),
        ("6 & 3 | 8", 10),
        ("5 ^ 1 == 4", 1),
        ("~0", -1),
        ("x > 2 ? 'far' : 'near'", "far"),
        ("x > 3 ? 1 : x > 2 ? 2 : 3", 2),
        ("text .. '/' .. x", "ab/3"),
        ("text + 'c'", "abc"),
        ("text == 'ab' && text < 'b'", 1),
        ("0.1 + 0.2 == 0.3", 1),
        ("IDLE", 1),
        ("x = 4; y := x; y += 1;; y", 5),
        ("x -= 1; x *= 4; x /= 2", 4),
        ("y := (x := 7)", 7),
    ],
)
def test_a_script_has_its_value(text: str, value: Value) -> None:
    assert run(text)[0] == value


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("x + ", "column 5: a value is expected, not 'the end'"),
        ("(x", "column 3: ')' is expected, not 'the end'"),
        ("x y", "column 3: ';' is expected, not 'y'"),
        ("3x", "column 1: '3x' is no part of a script"),
        ("65. + 1", "column 1: '65. + 1' is no part"),
        ("'open", 'column 1: "\'open" is no part'),
        ("1 = x", "column 3: the left side of '=' is a variable"),
        ("true := 1", "the left side of ':=' is a variable"),
        ("0x" + "f" * 300, "column 1"),
        ("1e999", "column 1: 1e999 is too large"),
        ("x == 'a'", "column 3: '==' compares a number with a text"),
        ("text * 2", "column 1: '*' needs numbers, not a text"),
        ("-text", "column 2: '-' needs a number, not a text"),
        ("x + text", "column 3: '+' adds a number to a text: join them by '..'"),
        ("x .. y", "column 3: '..' joins texts"),
        ("x := 'a'", "column 1: x is a number, and gets a text: use another name"),
        ("y > 0 ? 1 : 'a'", "column 7: '?' chooses between a number and a text"),
        ("nothing > 1", "column 1: nothing sets nothing"),
        ("+".join(["1"] * 201), f"a script has {MAX_TOKENS} tokens at most"),
        ("(" * 33 + "1" + ")" * 33, f"a script is {MAX_LEVELS} levels deep at most"),
    ],
)
def test_an_invalid_script_is_refused_with_its_column(text: str, problem: str) -> None:
    with pytest.raises(ScriptError) as found:
        run(text)
    assert problem in str(found.value)


@pytest.mark.parametrize(
    "text", ["unknown > 1", "true || unknown", "x := unknown", "unknown += 1", "1 < x < unknown"]
)
def test_an_unknown_value_stops_a_script(text: str) -> None:
    with pytest.raises(UnknownValueError) as found:
        run(text)
    assert found.value.cell == NAMES.index("unknown")


@pytest.mark.parametrize("text", ["1 / 0", "1e300 * 1e300", "x /= x - 3", "0.5 & 1", "~1e30"])
def test_a_script_without_a_value_is_an_error(text: str) -> None:
    with pytest.raises(EvaluationError):
        run(text)


def test_a_text_cannot_grow_without_end() -> None:
    with pytest.raises(EvaluationError, match="1024 at most"):
        run("; ".join(["text := text .. text"] * 14))
