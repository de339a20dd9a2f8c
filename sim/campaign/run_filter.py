"""`RunFilter` selects the runs of a criterion: `inject != none and world.friction < 0.5`."""

import operator
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from executive.settings import in_degrees, suggestion

if TYPE_CHECKING:
    from pandas import DataFrame, Series

_TERM: Final = re.compile(r"\s*([\w./-]+)\s*(==|!=|<=|>=|<|>)\s*(\S(?:.*\S)?)\s*")
_AND: Final = re.compile(r"\s+and\s+")
_ORDER: Final = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
RELATIVE_TOLERANCE: Final = 5e-6
"""Relative tolerance for equal non-integers: reports show six digits."""


@dataclass(frozen=True, slots=True)
class Term:
    """One comparison.

    Attributes:
        key: a varied key, `scenario`, or a figure of the runs.
        comparison: `==`, `!=`, `<`, `<=`, `>` or `>=`; the latter four for numbers only.
        value: value to compare with, a number if it reads as one; angles in radians.
        written: the value as in the file.
    """

    key: str
    comparison: str
    value: str | float
    written: str

    def __str__(self) -> str:
        return f"{self.key} {self.comparison} {self.written}"

    def of(self, column: "Series") -> "Series":
        """Return whether it holds for each value of a column; NA for missing ones."""
        value = self.value
        if not isinstance(value, str) and column.dtype == "string[pyarrow]":
            value = f"{value:g}"
        if compare := _ORDER.get(self.comparison):
            return compare(column, value)
        if isinstance(value, str) or value.is_integer():
            same = column == value
        else:
            apart = RELATIVE_TOLERANCE * abs(value)
            same = column.between(value - apart, value + apart)
        return same if self.comparison == "==" else ~same


@dataclass(frozen=True, slots=True)
class RunFilter:
    """Conjunction of comparisons. A missing value satisfies no comparison."""

    terms: tuple[Term, ...]

    @classmethod
    def parse(cls, text: str) -> "RunFilter":
        """Read comparisons joined by `and`.

        Raises:
            ValueError: the text is no comparison.
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
        """Return the runs that satisfy all comparisons."""
        for term in self.terms:
            runs = runs[term.of(runs[term.key])]
        return runs

    def check(self, numeric: Mapping[str, bool]) -> None:
        """Raise ValueError unless all keys exist and have a type that fits their comparison.

        Args:
            numeric: all existing keys, and whether they are numbers.

        Raises:
            ValueError: a key is unknown or has another type.
        """
        for term in self.terms:
            require_key(term.key, list(numeric))
            if numeric[term.key] and isinstance(term.value, str):
                raise ValueError(f"{term}: {term.key} is a number")
            if not numeric[term.key] and term.comparison in _ORDER:
                raise ValueError(f"{term}: {term.key} is a text, and only == or != compares it")


EVERYWHERE: Final = RunFilter(())
"""All runs."""


def require_key(key: str, known: Sequence[str]) -> None:
    """Raise ValueError unless a key is known.

    Raises:
        ValueError: it is unknown; the text gives similar keys and all existing ones.
    """
    if key not in known:
        near = suggestion(key, known)
        raise ValueError(f"a run has no {key!r}{near}; it has {', '.join(known)}")


def _value(text: str) -> str | float:
    angle_rad = in_degrees(text)
    if angle_rad is not None:
        return angle_rad
    try:
        return float(text)
    except ValueError:
        return text
