"""Writes the typed Python module of a service specification.

Usage, in a checkout: python -m tests.mal.generate SPECIFICATION.xml [TYPE=CLASS ...] > module.py

TYPE=CLASS takes a type from elsewhere, such as Stage=executive.values.reports.Stage.
"""

import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from adapters.mal import values
from adapters.mal.specification import (
    Area,
    CompositeType,
    EnumerationType,
    Field,
    TypeRef,
    python_name,
)
from adapters.mal.specification_xml import read_areas

_WIDTH: Final = 100
_PYTHON: Final = {
    "Blob": "bytes",
    "Boolean": "bool",
    **dict.fromkeys(("Duration", "Float", "Double"), "float"),
    **dict.fromkeys(("String", "Identifier", "URI"), "str"),
    **dict.fromkeys(("Octet", "UOctet", "Short", "UShort", "Integer", "UInteger"), "int"),
    **dict.fromkeys(("Long", "ULong", "Time", "FineTime"), "int"),
    "Attribute": "TypedAttribute",
    "Element": "Any",
    "Composite": "Any",
}
_UNITS: Final = {"Time": "ns since 1970 UTC", "FineTime": "ns since 1970 UTC", "Duration": "s"}
_MAL: Final = {
    name
    for name, found in vars(values).items()
    if getattr(found, "__module__", "") == values.__name__
}
"""The types of the MAL that have a class in `adapters.mal`."""


def generate(
    areas: tuple[Area, ...], source: str, known: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Write a module with an enum for every enumeration and a dataclass for every composite.

    Args:
        areas: The areas of one file, as `specification_xml.read_areas` gives them.
        source: The name of that file, for the module's docstring.
        known: Classes that are there already: their full names, by type name.

    Returns:
        The module's text; `load_specification(path, classes=module)` takes the module.
    """
    body = "\n".join(
        (
            *([""] if known else []),
            *(f"{name} = {cls}" for name, cls in known.items()),
            *(line for area in areas for line in _area(area, known)),
        )
    )
    imports = [
        ["from __future__ import annotations"],
        [
            *_import("dataclasses", ["dataclass"], body),
            *_import("enum", ["Enum"], body),
            *_import("typing", ["Any"], body),
        ],
        [
            *sorted({f"import {cls.rpartition('.')[0]}" for cls in known.values()}),
            *_import("adapters.mal", sorted(_MAL), body),
        ],
    ]
    names = ", ".join(area.name for area in areas)
    head = f'"""Types of area {names}, generated from {source}."""\n\n'
    head += "# ruff: noqa: N815 - names are those of the specification\n\n"
    return head + "\n\n".join("\n".join(group) for group in imports if group) + "\n" + body + "\n"


def _import(module: str, names: list[str], body: str) -> Iterator[str]:
    used = [
        name
        for name in names
        if re.search(rf"^(@|class .*\(|    \w+: .*\b){name}\b", body, re.MULTILINE)
    ]
    if used:
        yield f"from {module} import {', '.join(used)}"


def _area(area: Area, known: Mapping[str, str]) -> Iterator[str]:
    for definition in area.types:
        if isinstance(definition, EnumerationType) and definition.name not in known:
            yield from _enumeration(definition)
    waiting = [
        definition
        for definition in area.types
        if isinstance(definition, CompositeType) and definition.name not in known
    ]
    while waiting:
        unmet = {definition.name for definition in waiting}
        for definition in waiting:
            if definition.extends.name not in unmet:
                yield from _composite(definition)
        children = [definition for definition in waiting if definition.extends.name in unmet]
        if len(children) == len(waiting):
            raise ValueError(f"composites extend each other: {', '.join(sorted(unmet))}")
        waiting = children


def _enumeration(definition: EnumerationType) -> Iterator[str]:
    yield from ("", "", f"class {definition.name}(Enum):")
    notes = [(python_name(item.name), item.comment) for item in definition.items if item.comment]
    yield from _docstring(definition.name, definition.comment, notes)
    yield ""
    for item in definition.items:
        yield f"    {python_name(item.name)} = {item.value}"


def _composite(definition: CompositeType) -> Iterator[str]:
    parent = definition.extends.name
    bases = "" if parent == "Composite" else f"({parent})"
    yield from (
        "",
        "",
        "@dataclass(frozen=True, slots=True, kw_only=True)",
        f"class {definition.name}{bases}:",
    )
    notes = [(python_name(field.name), _note(field)) for field in definition.fields if _note(field)]
    yield from _docstring(definition.name, definition.comment, notes)
    if definition.fields:
        yield ""
    for field in definition.fields:
        null = " | None = None" if field.nullable else ""
        yield f"    {python_name(field.name)}: {_annotation(field.type)}{null}"


def _note(field: Field) -> str:
    unit = _UNITS.get(field.type.name)
    return " ".join(part for part in (field.comment, f"({unit})" if unit else "") if part)


def _annotation(ref: TypeRef) -> str:
    known = ref.area != "MAL" or ref.name in _MAL
    name = _PYTHON.get(ref.name, ref.name if known else "Any")
    return f"tuple[{name}, ...]" if ref.is_list else name


def _docstring(name: str, comment: str, notes: list[tuple[str, str]]) -> Iterator[str]:
    summary, _, rest = " ".join(comment.replace("\\", "\\\\").replace('"', "'").split()).partition(
        ". "
    )
    if len(summary) > _WIDTH - 12 or not summary:
        summary, rest = f"{name}.", comment
    elif not summary.endswith("."):
        summary += "."
    if not rest and not notes:
        yield f'    """{summary}"""'
        return
    yield f'    """{summary}'
    if rest:
        yield ""
        yield from textwrap.wrap(rest, _WIDTH, initial_indent="    ", subsequent_indent="    ")
    if notes:
        yield from ("", "    Attributes:")
        for attribute, note in notes:
            text = f"{attribute}: " + " ".join(note.replace("\\", "\\\\").replace('"', "'").split())
            yield from textwrap.wrap(
                text, _WIDTH, initial_indent=" " * 8, subsequent_indent=" " * 12
            )
    yield '    """'


if __name__ == "__main__":
    path = Path(sys.argv[1])
    known = dict(each.split("=") for each in sys.argv[2:])
    print(generate(read_areas(path), path.name, known), end="")
