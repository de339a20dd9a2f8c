"""The section `faults:` of an asset's file, read and written."""

import re
from dataclasses import replace
from difflib import get_close_matches
from enum import Enum
from math import radians
from typing import Any, Final

from executive.faults.fault_declaration import FIGURES, Clears, Declaration, Row, Then, When
from executive.faults.fault_table import DECLARED, FaultTable

_FIELDS: Final = {key: key + "_s" if key in {"for", "within"} else key for key in FIGURES}
_DEGREES: Final = re.compile(r"([-+]?\d+(?:\.\d*)?)\s*deg")


def read_table(raw: object) -> FaultTable:
    """Return the table that the section `faults:` of a file describes.

    Raises:
        ValueError: it names no fault, or a row does not fit its fault; the text says where.
    """
    if not isinstance(raw, dict):
        raise ValueError(f"expected the names of faults and their rows, got {raw!r}")
    rows: dict[str, Row] = {}
    for name, given in raw.items():
        declared = DECLARED.get(name)
        if declared is None:
            raise ValueError(f"unknown fault {name!r}{_near(name, list(DECLARED))}")
        rows[name] = _row(declared, given)
    return FaultTable(**rows)


def plain_table(table: FaultTable) -> dict[str, dict[str, object]]:
    """Return the plain data that `read_table` makes a table of."""
    found: dict[str, dict[str, object]] = {}
    for name in DECLARED:
        row: Row = getattr(table, name)
        said = {"when": row.when.value, "then": row.then.value, "clears": row.clears.value}
        figures = {key: getattr(row, field) for key, field in _FIELDS.items()}
        found[name] = said | {key: value for key, value in figures.items() if value is not None}
    return found


def _row(declared: Declaration, given: object) -> Row:
    if not isinstance(given, dict):
        raise ValueError(f"{declared.name}: expected keys and values, got {given!r}")
    choices = {"when": When, "then": Then, "clears": Clears}
    values: dict[str, Any] = {}
    for key, raw in given.items():
        if key in choices:
            values[key] = _choice(f"{declared.name}.{key}", raw, choices[key])
        elif key in _FIELDS:
            values[_FIELDS[key]] = _number(f"{declared.name}.{key}", raw)
        else:
            raise ValueError(
                f"{declared.name}: unknown key {key!r}{_near(key, [*choices, *_FIELDS])}"
            )
    return replace(declared.row, **values)


def _choice(path: str, raw: object, kind: type[Enum]) -> Enum:
    for choice in kind:
        if choice.value == raw:
            return choice
    known = [str(choice.value) for choice in kind]
    raise ValueError(f"{path}: {raw!r} is none of {', '.join(known)}")


def _number(path: str, raw: object) -> float:
    degrees = _DEGREES.fullmatch(raw.strip()) if isinstance(raw, str) else None
    if degrees:
        return radians(float(degrees[1]))
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise ValueError(f"{path}: expected a number, got {raw!r}")
    return float(raw)


def _near(name: object, known: list[str]) -> str:
    near = get_close_matches(str(name), known, 1)
    return f" (did you mean {near[0]}?)" if near else f"; known are {', '.join(known)}"
