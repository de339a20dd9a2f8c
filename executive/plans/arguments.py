"""Texts of attributes as values: numbers with units, times, choices, waypoints."""

import re
from calendar import monthrange, timegm
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from enum import Enum
from itertools import islice
from typing import Final, TypeVar

from executive.commands import Argument, Waypoint
from executive.plans.scripting import text_of, value_of
from executive.plans.syntax import ArgumentError, Value
from executive.values.quantities import QuantityError, read_quantity

MAX_VALUE_LENGTH: Final = 16_384
"""Maximum length in characters of an attribute. All attributes of a plan may use an argument:
without a bound one plan could block the core, and with it a stop, for minutes."""
MAX_WAYPOINTS: Final = 200
"""Maximum number of waypoints of one leaf; the asset's own bound is lower."""

_TIME: Final = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)[T ](\d\d):(\d\d)(?::(\d\d))?"
    r"(?:Z|(?P<sign>[+-])(?P<hours>\d\d):?(?P<minutes>\d\d))",
    re.ASCII,
)
_COUNT: Final = re.compile(r"[+-]?[0-9]{1,9}")
_MAX_QUOTED_LENGTH: Final = 40
"""Maximum length in characters of an invalid word that is compared and quoted."""
_MAX_SUGGESTIONS: Final = 200
"""Maximum number of candidates for a suggestion: more would delay a stop."""

ArgumentValue = float | int | str | Enum | tuple[Waypoint, ...]


T = TypeVar("T")


def quote(word: str) -> str:
    """Return an invalid word, quoted and truncated for a message."""
    return repr(word[:_MAX_QUOTED_LENGTH])


_MAX_LISTED: Final = 10
"""Maximum number of choices in a message that has a suggestion."""


def suggest(word: str, known: Iterable[str]) -> str:
    """Return a suffix for a message about an invalid word: the nearest known word, if any."""
    short = [
        each for each in islice(known, _MAX_SUGGESTIONS) if len(each) <= 2 * _MAX_QUOTED_LENGTH
    ]
    near = get_close_matches(word[:_MAX_QUOTED_LENGTH], short, 1)
    return f": did you mean {near[0]}?" if near else ""


def check_length(name: str, text: str) -> str:
    """Return a text that is not too long.

    Raises:
        ArgumentError: it is.
    """
    if len(text) > MAX_VALUE_LENGTH:
        raise ArgumentError(f"{name} has {len(text)} characters: {MAX_VALUE_LENGTH} at most")
    return text


def number(name: str, text: str, unit: str = "") -> float:
    """Return a number in its SI unit, which may be written with another, as `90deg`.

    Raises:
        ArgumentError: it is no number.
    """
    try:
        return read_quantity(text, unit)
    except QuantityError:
        of_unit = f" in {unit}" if unit else ""
        raise ArgumentError(f"{name} {text[:40]!r} is not a number{of_unit}") from None


def count(name: str, text: str) -> int:
    """Return a whole number.

    Raises:
        ArgumentError: it is none.
    """
    if not _COUNT.fullmatch(text.strip()):
        raise ArgumentError(f"{name} {text[:40]!r} is not a whole number")
    return int(text)


def utc(name: str, text: str) -> float:
    """Return a time in seconds since 1970-01-01 UTC, from ISO 8601 with an offset, or from seconds.

    Raises:
        ArgumentError: it is no such time.
    """
    found = _TIME.fullmatch(text.strip())
    if found is None:
        if not isinstance(seconds := value_of(text.strip()), str):
            return seconds
    elif _is_date(*(figures := [int(each or 0) for each in found.groups()[:6]])):
        sign = -1 if found["sign"] == "-" else 1
        ahead_s = sign * (int(found["hours"] or 0) * 3600 + int(found["minutes"] or 0) * 60)
        return float(timegm((*figures, 0, 0, 0)) - ahead_s)
    raise ArgumentError(f"{name} {text[:40]!r}: a time as 2026-11-27T09:00:00Z is needed")


def _is_date(year: int, month: int, day: int, hour: int, minute: int, second: int) -> bool:
    if not (1970 <= year <= 9999 and 1 <= month <= 12 and 1 <= day <= monthrange(year, month)[1]):
        return False
    return hour < 24 and minute < 60 and second < 60


def choice(name: str, text: str, choices: Mapping[str, T]) -> T:
    """Return one of several values by its text.

    Raises:
        ArgumentError: the text is none of them.
    """
    if text.strip() not in choices:
        near = suggest(text.strip(), choices)
        known = f": {' or '.join(choices)} is required"
        known = "" if near and len(choices) > _MAX_LISTED else known
        raise ArgumentError(f"{name} {quote(text)}{known}{near}")
    return choices[text.strip()]


def position(name: str, text: str) -> list[float]:
    """Return a position `x,y` or `x,y,heading`, in m and rad.

    Raises:
        ArgumentError: it is no position.
    """
    figures = enumerate(text.split(","))
    found = [number(name, part, "rad" if at == 2 else "m") for at, part in figures]
    if len(found) not in {2, 3}:
        raise ArgumentError(f"{name} {text[:40]!r} is neither x,y nor x,y,heading")
    return found


def waypoints(name: str, text: str) -> tuple[Waypoint, ...]:
    """Return positions joined by `;`.

    Raises:
        ArgumentError: a waypoint is not valid, or there are too many.
    """
    parts = text.strip().strip(";").split(";")
    if len(parts) > MAX_WAYPOINTS:
        raise ArgumentError(f"{name}: {len(parts)} waypoints, {MAX_WAYPOINTS} at most")
    return tuple(Waypoint(*position(name, each)) for each in parts)


def argument_value(argument: Argument, value: Value) -> ArgumentValue:
    """Return the value of a command's argument.

    Args:
        argument: the argument.
        value: text of the attribute, or value of a cell.

    Raises:
        ArgumentError: it is no value of the argument.
    """
    name = argument.name
    if argument.kind is float and not isinstance(value, str):
        return value
    text = text_of(value)
    if argument.kind is float:
        return number(name, text, argument.unit)
    if argument.kind is int:
        return count(name, text)
    if argument.kind is str:
        return text
    if issubclass(argument.kind, Enum):
        return choice(name, text, {str(each.value): each for each in argument.kind})
    return waypoints(name, text)
