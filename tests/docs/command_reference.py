"""The table of commands on the interface page: name, arguments, bounds, modes and operation."""

from collections.abc import Iterator
from math import pi
from typing import Final

from adapters.mops import load_dictionary
from executive.commands import (
    ACCEPTED,
    Argument,
    Declaration,
    Family,
    FilePath,
    Limit,
    Mode,
    Span,
    Supported,
    Within,
    arguments_of,
    declared,
)

ABOUT: Final = """\
The operations that command a rover, by their names in `rover command`, scenarios and as leaves of
plans (where there is no stop, no resume and no command of plans). `?` may be left out. A bound such
as drive.distance_m is one of the asset's settings, `config/<asset>.yaml`. MOPS is code and name of
the message by the relay, whose inputs are the arguments in this order."""
HEADER: Final = (
    "command",
    "what it does",
    "arguments",
    "accepted in",
    "operation",
    "MOPS",
    "as typed",
)


def command_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each command."""
    mops = load_dictionary().commands
    for each in declared():
        spelled = mops.get(each.name)
        yield (
            f"`{each.name}`",
            each.summary,
            "<br>".join(map(_argument, each.written)),
            _modes(each.family),
            f"{each.service}.{each.operation}",
            "" if spelled is None else f"{spelled.code:03X} {spelled.command}",
            "<br>".join(_typed(each)),
        )


def _argument(argument: Argument) -> str:
    facts = ", ".join(filter(None, (argument.meaning, _values(argument))))
    optional = "?" if argument.optional else ""
    if argument.many:
        names = ", ".join(part.name for part in arguments_of(argument.kind))
        facts = f"each with {names} as above, {facts}"
    return f"`{argument.name}`{optional} {facts}".rstrip()


def _values(argument: Argument) -> str:
    match argument.bound:
        case Within(low, high, or_zero):
            if low is None:
                return f"±{_limit(high)}"
            return f"{_limit(low)} to {_limit(high)}{' or 0' if or_zero else ''}"
        case Span(low, high):
            return f"±({high} − {low})"
        case Supported(path):
            return "refused: it is fixed" if path is None else f"as {path}"
        case FilePath() | None:
            return ""


def _limit(limit: Limit) -> str:
    if isinstance(limit, str):
        return limit
    return "2π" if limit == 2 * pi else f"{limit:g}"


def _modes(family: Family) -> str:
    accepted = ACCEPTED[family]
    return "any mode" if accepted == set(Mode) else ", ".join(m.name for m in Mode if m in accepted)


def _typed(declaration: Declaration) -> Iterator[str]:
    for typed in declaration.examples:
        yield f"`{f'{declaration.name} {typed}'.rstrip()}`"
