"""`random_script`: random scripts of all operators, without most parentheses, of mixed types."""

from typing import Final
from xml.sax.saxutils import quoteattr

from tests.support.random_plans import Draw, RandomPlan, plan_text

START: Final = "x := 1.5; y := 2.0; s := 'a'; t := '2'"
"""The variables before a script."""
RESULT: Final = "r"
"""The variable that a script sets last."""

_NUMBERS: Final = ("0", "1", "2", "3", "0.5", "1.5", "2.25", "0x1F", "1e2", "x", "y", "x", "y")
_TEXTS: Final = ("'a'", "'b'", "'1.5'", "''", "s", "t")
_OPERATORS: Final = (
    *("+", "-", "*", "/", "+", "-", "*", "/", "+", "-", "*", "..", "|", "^", "&"),
    *("==", "!=", "<", ">", "<=", ">=", "==", "!=", "<", ">", "<=", ">=", "&&", "||"),
)
_PREFIXES: Final = ("-", "!", "~")
_UPDATES: Final = ("x += {}", "y -= {}", "x *= {}", "y /= {}", "x = {}", "y := {}", "s = {}")


def script_plan(script: str) -> RandomPlan:
    """Return a plan that runs `START`, then a script."""
    scripts = "".join(f"<Script code={quoteattr(code)}/>" for code in (START, script))
    command = '<takePicture name="last S" deadline_s="1000"/>'
    return RandomPlan(plan_text(f"<Sequence>{scripts}{command}</Sequence>"), {}, -1)


def random_script(seed: int) -> str:
    """Return the script of a seed, which sets `RESULT`; it need not be valid."""
    draw = Draw(seed)
    statements = []
    if draw.chance(0.3):
        statements.append(draw.one(_UPDATES).format(_expression(draw, 2)))
    statements.append(f"{RESULT} := {_expression(draw, 3)}")
    return ("; " if draw.chance(0.5) else ";").join(statements)


def _expression(draw: Draw, depth: int) -> str:
    kind = draw.below(12)
    if depth == 0 or kind < 2:
        return draw.one(_TEXTS) if draw.chance(0.06) else draw.one(_NUMBERS)
    inner = _expression(draw, depth - 1)
    if kind == 2:
        return f"{draw.one(_PREFIXES)}{inner}"
    if kind == 3:
        return f"({inner})"
    if kind == 4:
        return f"{inner} ? {_expression(draw, depth - 1)} : {_expression(draw, depth - 1)}"
    space = " " if draw.chance(0.8) else ""
    return f"{inner}{space}{draw.one(_OPERATORS)}{space}{_expression(draw, depth - 1)}"
