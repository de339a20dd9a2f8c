"""`request_text` formats a request as one line; `argument_values` returns its arguments by name."""

from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Any, Final

from executive.commands.catalogue import Request, SubmitPlan
from executive.commands.declaration import (
    Argument,
    CommandDeclaration,
    arguments_of,
    declaration_of,
)
from executive.values.quantities import quantity_text

MAX_VALUE_LENGTH: Final = 40
"""Maximum length in characters of a displayed argument, such as a path."""
MAX_READ_LENGTH: Final = 4 * MAX_VALUE_LENGTH
"""Maximum number of characters read of an argument: formatting runs between the ticks, too."""


def request_text(request: Request) -> str:
    """Return a request with its arguments and their units, on one line."""
    declared = declaration_of(type(request))
    given = [
        _argument(declared, request, each.field, each.name, each.unit)
        for each in declared.user_arguments
    ]
    return " ".join([declared.name, *filter(None, given)])


def _argument(
    declared: CommandDeclaration, request: Request, field: str, name: str, unit: str
) -> str:
    composite = declared.composite
    holder: object = request
    if composite is not None and field in {each.field for each in arguments_of(composite)}:
        holder = getattr(request, declared.arguments[0].field)
    value = getattr(holder, field)
    match value:
        case None:
            return ""
        case Enum():
            shown = str(value.value)
        case float() | int() if unit in {"rad", "rad/s"}:
            return f"{name} {quantity_text(value, unit)}"
        case float():
            shown = f"{value:.4g}"
        case tuple():
            return f"{len(value)} {name}"
        case bytes():
            return f"{name} of {len(value)} octets"
        case _:
            shown = " ".join(str(value)[:MAX_READ_LENGTH].split())
    if len(shown) > MAX_VALUE_LENGTH:
        shown = f"{shown[:MAX_VALUE_LENGTH]}…"
    return f"{name} {shown} {unit}".rstrip()


def argument_values(request: Request) -> dict[str, Any]:
    """Return the given arguments of a request by name, as JSON values; of a plan without its text.

    A list, such as that of the waypoints, has such a dictionary for each item.
    """
    if isinstance(request, SubmitPlan):
        plan = request.plan
        given = {each.name: each.text for each in plan.arguments}
        return {"plan_id": plan.plan_id, "name": plan.name, "arguments": given}
    declaration = declaration_of(type(request))
    values = [getattr(request, each.field) for each in declaration.arguments]
    if declaration.composite is not None:
        parts = arguments_of(declaration.composite)
        values[:1] = [getattr(values[0], part.field) for part in parts]
    return _values_by_name(declaration.user_arguments, values)


def _values_by_name(arguments: Sequence[Argument], values: Iterable[Any]) -> dict[str, Any]:
    pairs = zip(arguments, values, strict=True)
    return {each.name: _plain(each, value) for each, value in pairs if value is not None}


def _plain(argument: Argument, value: Any) -> Any:
    if argument.repeated:
        parts = arguments_of(argument.kind)
        return [
            _values_by_name(parts, [getattr(each, part.field) for part in parts]) for each in value
        ]
    return value.value if isinstance(value, Enum) else value
