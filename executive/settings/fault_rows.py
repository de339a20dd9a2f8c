"""Reads and writes settings that contain rows of faults, which have keys of their own.

A row has `when`, `reaction` and `clears`, and the figures of its window: directly if the fault has
one window, otherwise under the name of each. A missing key has the value of the declaration.
Written rows have all their keys.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Final

from executive.faults import (
    DECLARED,
    FIGURES,
    ClearPolicy,
    FaultResponse,
    FaultTable,
    MonitoredWhen,
    Reaction,
    Window,
)
from executive.settings.strict_reader import FormatError, StrictReader, unknown_keys

_CHOICES: Final = {"when": MonitoredWhen, "reaction": Reaction, "clears": ClearPolicy}


def settings_reader(
    special: Mapping[Any, Callable[[Any], Any]] | None = None,
    plain: Mapping[Any, Callable[[Any], Any]] | None = None,
    *,
    units: bool = False,
) -> StrictReader:
    """Return a reader of settings.

    Args:
        special: functions that read these types instead of the default.
        plain: functions that write values of these types.
        units: whether keys carry the units of their fields.
    """
    read = {**(special or {}), FaultTable: _read_faults}
    return StrictReader(read, {FaultTable: _plain_faults, **(plain or {})}, units=units)


@cache
def _figures() -> StrictReader:
    """Return the reader of rows; a figure has the unit of its fault, not one of its own."""
    return StrictReader({})


def _read_faults(raw: object) -> FaultTable:
    if isinstance(raw, FaultTable):
        return raw
    given = _mapping(raw, DECLARED, "")
    return FaultTable(**{name: _read_row(name, row) for name, row in given.items()})


def _read_row(name: str, raw: object) -> FaultResponse:
    row = DECLARED[name].row
    several = {each.name: each for each in row.windows if each.name}
    given = _mapping(raw, [*_CHOICES, *(several or FIGURES)], name)
    choices: dict[str, Any] = {
        key: _figures().read(given[key], kind, f"{name}.{key}")
        for key, kind in _CHOICES.items()
        if key in given
    }
    if several:
        windows = [
            _read_window(each, given.get(window, {}), f"{name}.{window}")
            for window, each in several.items()
        ]
    else:
        figures = {key: value for key, value in given.items() if key not in _CHOICES}
        windows = [_read_window(row.window, figures, name)]
    changed: FaultResponse = replace(row, windows=tuple(windows), **choices)
    return changed


def _read_window(window: Window, raw: object, path: str) -> Window:
    return _figures().overlay(window, _mapping(raw, FIGURES, path), path)


def _mapping(raw: object, known: Iterable[str], path: str) -> dict[str, Any]:
    given: dict[str, Any] = _figures().read(raw, dict[str, Any], path)
    if unknown := given.keys() - set(known):
        raise FormatError(path, unknown_keys(unknown, list(known)))
    return given


def _plain_faults(table: FaultTable) -> dict[str, dict[str, Any]]:
    return {declared.name: _plain_row(row) for declared, row in table}


def _plain_row(row: FaultResponse) -> dict[str, Any]:
    found: dict[str, Any] = {key: getattr(row, key).value for key in _CHOICES}
    for window in row.windows:
        plain = _figures().plain(window)
        figures = {key: plain[key] for key in FIGURES if plain[key] is not None}
        found |= {window.name: figures} if window.name else figures
    return found
