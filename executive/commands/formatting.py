"""`request_text` formats a request with its arguments as one human-readable line."""

from enum import Enum
from math import degrees
from typing import Final

from executive.commands.catalogue import Request
from executive.commands.declaration import CommandDeclaration, arguments_of, declaration_of

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
        case float() | int() if unit == "rad":
            return f"{name} {degrees(value):.4g}°"
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
