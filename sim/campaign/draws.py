"""`draw`: the scenario and drawn values of a run, from the campaign's seed and the run's number.

Neither the order of the runs, nor their host, nor other varied quantities change a draw: each key
of each run has random numbers of its own.
"""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, unique
from math import exp, log
from pathlib import Path
from typing import Final, assert_never
from zlib import crc32

import numpy as np

from sim.campaign.model import (
    Alternative,
    Campaign,
    Choice,
    Distribution,
    FaultDraw,
    Grid,
    Integers,
    Interval,
    LogUniform,
    Named,
    Normal,
    Number,
    Scalar,
    Uniform,
    Variation,
)
from sim.rover.faults import Onset, read_kind
from sim.scenario.changes import NO_FAULT, Override
from sim.scenario.reading import SUFFIXES

INJECT: Final = "inject"


@unique
class ValueKind(Enum):
    """Type of a varied quantity's values."""

    NUMBER = "number"
    WHOLE = "whole number"
    TEXT = "text"


@dataclass(frozen=True, slots=True)
class VariedQuantity:
    """A varied quantity, a column of the data set.

    Attributes:
        name: the key, or `inject.onset`, `inject.at`, `inject.for` and `inject.PARAMETER`.
    """

    name: str
    kind: ValueKind


@dataclass(frozen=True, slots=True)
class Draw:
    """Scenario and drawn values of one run.

    Attributes:
        values: value of each varied quantity, in the order of `quantities`; None if a fault has
            no such parameter.
    """

    run: int
    scenario: str
    changes: tuple[Override, ...]
    values: tuple[Scalar | None, ...]

    @property
    def command(self) -> str:
        """The command that repeats the run bit for bit, from any folder."""
        file = self.scenario.endswith(SUFFIXES)
        parts = ["rover", "scenario", str(Path(self.scenario).resolve()) if file else self.scenario]
        for change in self.changes:
            if change.key == "seed":
                parts += ["--seed", change.value]
            else:
                parts += ["--set", str(change)]
        return shlex.join(parts)


def quantities(campaign: Campaign) -> tuple[VariedQuantity, ...]:
    """Return the varied quantities of a campaign."""
    return tuple(found for variation in campaign.vary for found in _quantities(variation))


def draw(campaign: Campaign, run: int) -> Draw:
    """Return the draw of a run, with any number from 0 on."""
    index, turn = divmod(run, len(campaign.scenarios))
    scenario = campaign.scenarios[turn]
    chosen: dict[str, int] = {}
    for name, grid in campaign.grids:
        index, chosen[name] = divmod(index, len(grid.grid))
    changes: list[Override] = []
    values: list[Scalar | None] = []
    for variation in campaign.vary:
        value = _drawn(campaign.seed, run, variation.key, variation.distribution, chosen)
        if variation.key == INJECT:
            change, given = _drawn_fault(campaign.seed, run, variation, value, chosen)
        else:
            assert not isinstance(value, FaultDraw)
            change = Override(variation.key, written(value))
            given = [value.name if isinstance(value, Named) else value]
        changes.append(change)
        values += given
    kinds = [quantity.kind for quantity in quantities(campaign)]
    typed = tuple(map(_typed, values, kinds))
    return Draw(run, scenario, tuple(changes), typed)


def as_yaml(value: Scalar) -> str:
    """Return a value as YAML that reads as the same value, to the last bit."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)


def written(value: Scalar | Named) -> str:
    """Return the text that a key is set to."""
    return as_yaml(value.value if isinstance(value, Named) else value)


def _quantities(variation: Variation) -> Iterator[VariedQuantity]:
    distribution = variation.distribution
    if variation.key != INJECT:
        yield VariedQuantity(variation.key, _kind([distribution]))
        return
    yield VariedQuantity(INJECT, ValueKind.TEXT)
    yield VariedQuantity(f"{INJECT}.onset", ValueKind.TEXT)
    yield VariedQuantity(f"{INJECT}.at", ValueKind.NUMBER)
    if variation.duration is not None:
        yield VariedQuantity(f"{INJECT}.for", ValueKind.NUMBER)
    for name in parameters(variation):
        given = [
            value
            for fault in alternatives(distribution)
            if isinstance(fault, FaultDraw)
            for parameter, value in fault.parameters
            if parameter == name
        ]
        yield VariedQuantity(f"{INJECT}.{name}", _kind(given))


def parameters(variation: Variation) -> list[str]:
    """Return the names of the parameters that any fault of a variation has."""
    faults = alternatives(variation.distribution)
    return sorted(
        {name for each in faults if isinstance(each, FaultDraw) for name, _ in each.parameters}
    )


def alternatives(distribution: Distribution) -> Sequence[Alternative]:
    """Return the values that a distribution lists, if it does."""
    match distribution:
        case Choice(choice=values) | Grid(grid=values):
            return values
        case _:
            return ()


def _kind(given: Sequence[Distribution | Scalar]) -> ValueKind:
    """Return the common type of the values of several distributions and constants."""
    found = set()
    for each in given:
        match each:
            case Integers():
                found.add(ValueKind.WHOLE)
            case Uniform() | LogUniform() | Normal():
                found.add(ValueKind.NUMBER)
            case Choice(choice=values) | Grid(grid=values):
                found |= {_kind_of(value) for value in values}
            case _:
                found.add(_kind_of(each))
    if ValueKind.TEXT in found or not found:
        return ValueKind.TEXT
    return ValueKind.NUMBER if ValueKind.NUMBER in found else ValueKind.WHOLE


def _kind_of(value: Alternative) -> ValueKind:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return ValueKind.TEXT
    return ValueKind.WHOLE if isinstance(value, int) else ValueKind.NUMBER


def _typed(value: Scalar | None, kind: ValueKind) -> Scalar | None:
    match kind:
        case _ if value is None:
            return None
        case ValueKind.TEXT:
            return as_yaml(value)
        case ValueKind.NUMBER:
            return float(value)
        case ValueKind.WHOLE:
            return int(value)
        case _:
            assert_never(kind)


def _drawn(
    seed: int, run: int, name: str, distribution: Distribution, chosen: dict[str, int]
) -> Alternative:
    if isinstance(distribution, Grid):
        return distribution.grid[chosen[name]]
    random = np.random.default_rng([seed, run, crc32(name.encode())])
    if isinstance(distribution, Choice):
        weights = distribution.weights
        share = None if weights is None else np.array(weights) / sum(weights)
        return distribution.choice[int(random.choice(len(distribution.choice), p=share))]
    return number(distribution, random)


def number(distribution: Number, random: np.random.Generator) -> float | int:
    """Return a number drawn from a distribution."""
    match distribution:
        case Uniform(Interval(low, high)):
            return float(random.uniform(low, high))
        case LogUniform(Interval(low, high)):
            return min(max(exp(random.uniform(log(low), log(high))), low), high)
        case Normal((mean, deviation), within):
            while True:
                value = float(random.normal(mean, deviation))
                if within is None or within.low <= value <= within.high:
                    return value
        case Integers((first, last)):
            return int(random.integers(first, last, endpoint=True))
        case _:
            raise AssertionError(distribution)


def _drawn_fault(
    seed: int, run: int, variation: Variation, value: Alternative, chosen: dict[str, int]
) -> tuple[Override, list[Scalar | None]]:
    """Return the change that injects a fault, and its name, times and parameters."""
    assert not isinstance(value, Named)
    fault = value if isinstance(value, FaultDraw) else FaultDraw(as_yaml(value))
    names = parameters(variation)
    times = {"at": variation.at}
    if variation.duration is not None:
        times["for"] = variation.duration
    if fault.name == NO_FAULT:
        nothing = [None for _ in (*times, *names)]
        return Override(INJECT, NO_FAULT), [NO_FAULT, Onset.NONE.value, *nothing]
    times_s = {
        key: content
        if isinstance(content, float)
        else _drawn_seconds(seed, run, key, content, chosen)
        for key, content in times.items()
    }
    given: dict[str, Scalar] = {}
    for name, content in fault.parameters:
        if isinstance(content, Number):
            own = crc32(f"{INJECT}.{fault.name}.{name}".encode())
            given[name] = number(content, np.random.default_rng([seed, run, own]))
        else:
            given[name] = content
    onset = read_kind(fault.name).onset.value
    values = [fault.name, onset, *times_s.values(), *map(given.get, names)]
    return fault_change(fault.name, given, times_s), values


def _drawn_seconds(
    seed: int, run: int, key: str, distribution: Distribution, chosen: dict[str, int]
) -> float:
    drawn = _drawn(seed, run, f"{INJECT}.{key}", distribution, chosen)
    assert isinstance(drawn, int | float)
    return drawn


def fault_change(name: str, given: dict[str, Scalar], times_s: dict[str, float]) -> Override:
    """Return the change that injects a fault, with its times `at` and, if it ends, `for`."""
    text = ", ".join(f"{parameter}: {as_yaml(value)}" for parameter, value in given.items())
    fault = f"{name}: {{{text}}}" if text else name
    times = ", ".join(f"{key}: {as_yaml(time_s)}" for key, time_s in times_s.items())
    return Override(INJECT, f"{{{fault}, {times}}}")
