"""Changes that may save a failed run: limits, speeds, controllers, arguments of its command.

They follow from the declarations of faults, settings and commands, and stay within their bounds.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, log
from typing import Any, Final

from executive.commands import Request, declaration_of, requested_controller
from executive.settings import Controller, Settings, settings_reader
from executive.values.quantities import unit_of
from executive.values.reports import Identity, Report
from sim.fork.model import Change, ReplacedCommand
from sim.scenario.changes import Override

FACTORS: Final = (1.1, 1.25, 1.5, 2.0, 3.0, 5.0)
"""Factors of changed figures; another controller counts as the factor 2; chosen."""


@dataclass(frozen=True, slots=True)
class Adjustable:
    """A figure of the settings or of a command.

    Attributes:
        key: as in `rover whatif --set`, or `command.SOURCE:NUMBER.ARGUMENT`.
        recorded: its value in the recording, not 0.
        bound: limit of its changes.
        request: returns the request of the command with another value; None for a setting.
    """

    key: str
    recorded: float
    bound: float
    request: Callable[[float], ReplacedCommand] | None = None

    def by(self, factor: float) -> float:
        """Return its value changed by a factor above 1, at most to the bound."""
        if abs(self.bound) > abs(self.recorded):
            return min(self.recorded * factor, self.bound)
        return self.recorded / factor if not self.bound else max(self.recorded / factor, self.bound)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A change that may save a run.

    Attributes:
        order: orders candidates by size: one with the recorded arguments is smaller than
            one with another argument, then that with fewer keys, then that with the smaller
            product of factors; of equal ones the first in alphabetical order.
        text: its keys with the new and the recorded values.
    """

    change: Change
    order: tuple[bool, int, float, str]
    text: str


def candidate(figures: Sequence[Adjustable], factor: float) -> Candidate:
    """Return the candidate that changes all figures by the same factor."""
    pairs = [(each, each.by(factor)) for each in figures]
    settings = [Override(each.key, f"{value:.6g}") for each, value in pairs if not each.request]
    replaced = [each.request(value) for each, value in pairs if each.request]
    size = round(sum(abs(log(value / each.recorded)) for each, value in pairs), 6)
    text = ", ".join(f"{e.key}={value:.6g} (recorded {e.recorded:.6g})" for e, value in pairs)
    change = Change(settings=tuple(settings), replaced=tuple(replaced))
    return Candidate(change, (bool(replaced), len(figures), size, text), text)


def candidates(figures: Iterable[Sequence[Adjustable]]) -> list[Candidate]:
    """Return the candidates with each of the factors."""
    return [candidate(each, factor) for each in figures for factor in FACTORS]


def limits_of(report: Report, settings: Settings) -> Iterator[Adjustable]:
    """Yield the limits that may have ended a command.

    These are the bounds of each row with the report's fault, else with its reason; and the other
    settings with value and unit of the bound in the report.
    """
    rows = [each for each in settings.faults if report.fault == each[0].name]
    for declared, row in rows or [e for e in settings.faults if report.reason is e[0].reason]:
        for window in row.windows:
            path = ".".join(filter(None, ("faults", declared.name, window.name)))
            if window.above and declared.above:
                yield Adjustable(f"{path}.above", window.above, declared.above.high)
            elif window.below and declared.below:
                yield Adjustable(f"{path}.below", window.below, declared.below.low)
            elif window.for_s:
                yield Adjustable(f"{path}.for", window.for_s, inf)
    bounds = [each for each in report.figures if each.name == "bound"]
    for key, value, unit in _numbers(settings):
        if not key.startswith("faults.") and (value, unit) in ((b.value, b.unit) for b in bounds):
            yield Adjustable(key, value, inf if report.figures[0].value > value else 0.0)


def speeds_of(settings: Settings) -> Iterator[Adjustable]:
    """Yield the maximum speeds of the drive."""
    for key, value, unit in _numbers(settings):
        if key.startswith("drive.") and unit in ("m/s", "rad/s"):
            yield Adjustable(key, value, 0.0)


def controllers_for(request: Request, settings: Settings) -> Iterator[Candidate]:
    """Yield the other controllers that can drive the motion of a command."""
    now = requested_controller(request, settings.controller)
    for other in Controller:
        is_set = other is not Controller.NAVIGATION or settings.navigation is not None
        if now is not None and other is not now and is_set:
            text = f"controller={other.value} (recorded {now.value})"
            yield Candidate(Change(controller=other), (False, 1, round(log(2.0), 6), text), text)


def arguments_of(identity: Identity, request: Request) -> Iterator[Adjustable]:
    """Yield the figures of a command, each towards 0."""
    made: Any = request
    for each in declaration_of(type(request)).arguments:
        value = getattr(request, each.field)
        if each.kind is float and isinstance(value, float) and value:

            def changed(to: float, field: str = each.field) -> ReplacedCommand:
                return ReplacedCommand(identity, replace(made, **{field: to}))

            yield Adjustable(f"command.{identity}.{each.name}", value, 0.0, changed)


def _numbers(settings: Settings) -> Iterator[tuple[str, float, str]]:
    """Yield key, value and unit of each number of the settings that is not 0."""
    keys, fields = (settings_reader(units=units).plain(settings) for units in (False, True))
    pending = [("", keys, fields)]
    for path, within, named in pending:
        for (key, value), field in zip(within.items(), named, strict=True):
            if isinstance(value, dict):
                pending.append((f"{path}{key}.", value, named[field]))
            elif isinstance(value, float) and value:
                yield f"{path}{key}", value, unit_of(field)
