"""`request_of` converts a command that a page posts into a request of the catalogue.

It is checked against the form of the dictionary; the asset makes the checks that need its state.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from typing import Any, Final

from adapters.console.rovers.dictionary import FORMS, ArgumentEntry, CommandEntry
from executive.commands import Argument, Request, arguments_of
from executive.values.quantities import quantity_text

MAX_TEXT_LENGTH: Final = 1024
"""Maximum length of a text argument."""


@dataclass(frozen=True, slots=True)
class InvalidArgument:
    """An invalid argument of a posted command.

    Attributes:
        field: the argument, in a list as `waypoints[2].heading`; empty for the complete `args`.
        low, high: bounds, if known.
        choices: permitted values of a choice.
    """

    field: str
    text: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] | None = None


class _BadArgumentError(Exception):
    """Carries an `InvalidArgument` to `request_of`."""

    def __init__(self, wrong: InvalidArgument) -> None:
        super().__init__(wrong.text)
        self.wrong = wrong


def request_of(form: CommandEntry, given: object) -> Request | InvalidArgument:
    """Return the request of posted arguments for a form, or the invalid argument."""
    declaration = FORMS[form.name]
    try:
        if not isinstance(given, Mapping):
            raise _invalid("", "args: an object of the command's arguments is needed")
        if form.at_least_one and all(given.get(each.name) is None for each in form.arguments):
            names = ", ".join(each.name for each in form.arguments)
            raise _invalid(form.arguments[0].name, f"give at least one of {names}")
        values = _values("", form.arguments, declaration.user_arguments, given)
    except _BadArgumentError as error:
        return error.wrong
    request: Request = declaration.build_request(*values)
    return request


def _values(
    prefix: str,
    entries: Sequence[ArgumentEntry],
    arguments: Sequence[Argument],
    given: Mapping[str, Any],
) -> list[Any]:
    known = {entry.name for entry in entries}
    if unknown := next((name for name in given if name not in known), None):
        names = ", ".join(sorted(known)) or "none"
        raise _invalid(f"{prefix}{unknown}", f"argument {unknown!r} is unknown; known are: {names}")
    return [
        _value(f"{prefix}{entry.name}", entry, argument, given.get(entry.name))
        for entry, argument in zip(entries, arguments, strict=True)
    ]


def _value(field: str, entry: ArgumentEntry, argument: Argument, value: Any) -> Any:
    if value is None:
        if not entry.optional:
            raise _invalid(field, f"{field} is needed")
        return None
    match entry.type:
        case "number":
            return _number(field, entry, value)
        case "integer":
            if isinstance(value, bool) or not isinstance(value, int):
                raise _invalid(field, f"{field}: a whole number is needed", entry)
            _number(field, entry, value)
            return value
        case "choice":
            if value not in (entry.choices or ()):
                choices = ", ".join(entry.choices or ())
                raise _invalid(field, f"{field}: one of {choices} is needed", entry)
            return argument.kind(value) if issubclass(argument.kind, Enum) else value
        case "list":
            return _items(field, entry, argument, value)
        case _:
            if not isinstance(value, str) or not 0 < len(value) <= MAX_TEXT_LENGTH:
                raise _invalid(
                    field, f"{field}: a text of at most {MAX_TEXT_LENGTH} characters is needed"
                )
            return value


def _number(field: str, entry: ArgumentEntry, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise _invalid(field, f"{field}: a finite number is needed", entry)
    if entry.or_zero and value == 0:
        return 0.0
    if (entry.low is not None and value < entry.low) or (
        entry.high is not None and value > entry.high
    ):
        low, high = entry.low, entry.high
        ends = [quantity_text(each, entry.unit) for each in (low, high) if each is not None]
        bounds = " to ".join(ends)
        if len(ends) == 1:
            bounds = f"at most {bounds}" if low is None else f"at least {bounds}"
        shown = quantity_text(value, entry.unit)
        raise _invalid(field, f"{field} {shown} is out of range, {bounds}", entry)
    return float(value)


def _items(field: str, entry: ArgumentEntry, argument: Argument, value: Any) -> tuple[Any, ...]:
    minimum, maximum = entry.min_items or 0, entry.max_items
    if not isinstance(value, list) or any(not isinstance(each, Mapping) for each in value):
        raise _invalid(field, f"{field}: a list of objects is needed")
    if len(value) < minimum or (maximum is not None and len(value) > maximum):
        bounds = f"at least {minimum}" if maximum is None else f"{minimum} to {maximum}"
        text = f"{field}: {len(value)} are given, {bounds} are needed"
        raise _BadArgumentError(InvalidArgument(field, text, minimum, maximum))
    parts = arguments_of(argument.kind)
    return tuple(
        argument.kind(*_values(f"{field}[{index}].", entry.items, parts, each))
        for index, each in enumerate(value)
    )


def _invalid(field: str, text: str, entry: ArgumentEntry | None = None) -> _BadArgumentError:
    if entry is None:
        return _BadArgumentError(InvalidArgument(field, text))
    return _BadArgumentError(InvalidArgument(field, text, entry.low, entry.high, entry.choices))
