"""Over which runs something must hold: `inject != none and world.friction < 0.5`."""

import operator
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from executive.settings import hint, in_degrees

if TYPE_CHECKING:
    from pandas import DataFrame, Series

_TERM: Final = re.compile(r"\s*([\w./-]+)\s*(==|!=|<=|>=|<|>)\s*(\S(?:.*\S)?)\s*")
_AND: Final = re.compile(r"\s+and\s+")
_ORDER: Final = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
ALIKE: Final = 5e-6
"""By which part numbers may differ that are not whole and are the same: reports show six digits."""


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

    def of(self, column: "Series") -> "Series":
        """Return for each value of a column whether it holds; NA where there is none."""
        value = self.value
        if not isinstance(value, str) and column.dtype == "string[pyarrow]":
            value = f"{value:g}"
        if compare := _ORDER.get(self.comparison):
            return compare(column, value)
        if isinstance(value, str) or value.is_integer():
            same = column == value
        else:
            apart = ALIKE * abs(value)
            same = column.between(value - apart, value + apart)
        return same if self.comparison == "==" else ~same


@dataclass(frozen=True, slots=True)
class RunFilter:
    """Several comparisons, all of which hold. What is missing in a run compares with nothing."""

    terms: tuple[Term, ...]

    @classmethod
    def parse(cls, text: str) -> "RunFilter":
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

    def of(self, runs: "DataFrame") -> "DataFrame":
        """Return the runs for which all comparisons hold."""
        for term in self.terms:
            runs = runs[term.of(runs[term.key])]
        return runs

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
            if not numeric[term.key] and term.comparison in _ORDER:
                raise ValueError(f"{term}: {term.key} is a text, and only == or != compares it")


EVERYWHERE: Final = RunFilter(())
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
