"""Over which runs something must hold: `inject != none and world.friction < 0.5`."""

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from executive.settings import hint, in_degrees

_TERM: Final = re.compile(r"\s*([\w./-]+)\s*(==|!=|<=|>=|<|>)\s*(\S(?:.*\S)?)\s*")
_AND: Final = re.compile(r"\s+and\s+")
ALIKE: Final = 5e-6
"""By which part numbers may differ that are not whole and are the same: reports show six digits."""


def _same(one: Any, value: str | float) -> Any:
    """Return whether a number or text, or each of a column, is a value."""
    if isinstance(value, str) or value.is_integer():
        return one == value
    apart = ALIKE * abs(value)
    return (one >= value - apart) & (one <= value + apart)


def _other(one: Any, value: str | float) -> Any:
    if isinstance(value, str) or value.is_integer():
        return one != value
    apart = ALIKE * abs(value)
    return (one < value - apart) | (one > value + apart)


COMPARISONS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "==": _same,
    "!=": _other,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}


@dataclass(frozen=True, slots=True)
class Term:
    """One comparison.

    Attributes:
        key: a varied key, `scenario`, or a figure of the runs.
        comparison: `==`, `!=`, `<`, `<=`, `>` or `>=`; the latter four of numbers only.
        value: with what is compared, a number where it reads as one; angles in radians.
        written: the value as the file has it.
    """

    key: str
    comparison: str
    value: str | float
    written: str

    def __str__(self) -> str:
        return f"{self.key} {self.comparison} {self.written}"


@dataclass(frozen=True, slots=True)
class Where:
    """Several comparisons, all of which hold. What is missing in a run compares with nothing."""

    terms: tuple[Term, ...]

    @classmethod
    def parse(cls, text: str) -> "Where":
        """Read comparisons joined by `and`.

        Raises:
            ValueError: they are none.
        """
        terms = []
        for part in _AND.split(text.strip()):
            found = _TERM.fullmatch(part)
            if found is None:
                raise ValueError(
                    f"{part!r} is no comparison, as world.friction < 0.5 or inject != none;"
                    " several are joined by and"
                )
            terms.append(Term(found[1], found[2], _value(found[3]), found[3]))
        return cls(tuple(terms))

    def __str__(self) -> str:
        return f", where {' and '.join(map(str, self.terms))}" if self.terms else ""

    def check(self, numeric: Mapping[str, bool]) -> None:
        """Do nothing where all keys exist and are compared with what they can be.

        Args:
            numeric: all keys there are, and whether they are numbers.

        Raises:
            ValueError: one is not.
        """
        for term in self.terms:
            require_key(term.key, list(numeric))
            if numeric[term.key] and isinstance(term.value, str):
                raise ValueError(f"{term}: {term.key} is a number")
            if not numeric[term.key] and term.comparison not in ("==", "!="):
                raise ValueError(f"{term}: {term.key} is a text, and only == or != compares it")


EVERYWHERE: Final = Where(())
"""Each run."""


def require_key(key: str, known: Sequence[str]) -> None:
    """Do nothing where a key is known.

    Raises:
        ValueError: it is not; the text names near misses and all there are.
    """
    if key not in known:
        near = hint(key, known)
        raise ValueError(f"no {key!r} is known of a run{near}; known are {', '.join(known)}")


def _value(text: str) -> str | float:
    angle_rad = in_degrees(text)
    if angle_rad is not None:
        return angle_rad
    try:
        return float(text)
    except ValueError:
        return text
