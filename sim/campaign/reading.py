"""`load_campaign` reads a campaign file, or raises one error that names the file and the key.

The scenarios define the valid values of a key: each end of a varied quantity is tried on each.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import yaml

from executive.settings import (
    FormatError,
    SettingsError,
    StrictReader,
    angle_of,
    config_folder,
    faults_of,
    load_yaml,
    quoted,
)
from sim.campaign import draws, runs
from sim.campaign.draws import INJECT, fault_change
from sim.campaign.model import (
    MAX_RUNS,
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
    Quantile,
    Scalar,
    Uniform,
    Until,
    Variation,
    combinations,
)
from sim.campaign.run_filter import RunFilter, require_key
from sim.scenario.changes import NO_FAULT, Override
from sim.scenario.model import RunMode
from sim.scenario.reading import SUFFIXES, load_scenario, path_of

MAX_COMBINATIONS: Final = 1_000_000
_NAME: Final = re.compile(r"[A-Za-z_][\w-]*")
TRIED_STANDARD_DEVIATIONS: Final = 6.0
"""Tried range of a normal distribution in standard deviations from its mean; one draw in 500
million is beyond."""


def campaign_folder() -> Path:
    """Return the folder of the named campaigns."""
    return config_folder() / "campaigns"


def campaign_path(name: str) -> Path:
    """Return the file of a campaign, given by its path or by its name in config/campaigns.

    Raises:
        SettingsError: no campaign has this name.
    """
    return path_of("campaign", name, campaign_folder())


def load_campaign(name: str, runs: int | None = None) -> Campaign:
    """Read a campaign.

    Args:
        name: a path, or the name of a file in config/campaigns.
        runs: number of runs; replaces that of the file.

    Raises:
        SettingsError: the campaign is unknown or invalid, or a value is invalid in one of its
            scenarios.
    """
    path = campaign_path(name)
    raw = load_yaml(path)
    with faults_of(path):
        campaign = _campaign(raw, path.parent)
        if runs is not None:
            campaign = replace(campaign, runs=runs)
        _check_criteria(campaign)
        _check_scenarios(campaign)
    return campaign


def _campaign(raw: object, folder: Path) -> Campaign:
    if not isinstance(raw, dict):
        raise FormatError(
            "", "a campaign is keys and values, such as scenario, runs, vary, criteria"
        )
    scenarios = _scenarios(raw, folder)
    vary = read_vary(raw.get("vary", {}))
    filled = {key: value for key, value in raw.items() if key not in ("scenario", "vary")}
    filled |= {"scenarios": list(scenarios), "vary": list(vary)}
    many = combinations(scenarios, vary)
    if many > MAX_COMBINATIONS:
        raise FormatError("vary", f"{many} combinations of grids; {MAX_COMBINATIONS} at most")
    if "runs" not in raw and any(variation.grids for variation in vary):
        filled["runs"] = many
    if "criteria" in raw and not raw["criteria"]:
        raise FormatError("criteria", "no criterion is given")
    campaign = _reader().read(filled, Campaign)
    if isinstance(campaign.runs, Until) and campaign.runs.max < many:
        text = f"{campaign.runs.max} is below {many}, the combinations of scenarios and grids"
        raise FormatError("runs.max", text)
    return campaign


@cache
def _reader(*, faults: bool = False) -> StrictReader:
    """Return the reader of campaigns, or of the alternatives of `inject`, which are faults."""
    special: dict[Any, Callable[[Any], Any]] = {
        RunFilter: lambda raw: RunFilter.parse(reader.read(raw, str)),
        Interval: _interval,
        Scalar: _scalar,
        FaultDraw: _fault,
        tuple[Alternative, ...]: _faults if faults else _alternatives,
        int | Until: _runs,
        tuple[Variation, ...]: tuple,
    }
    reader = StrictReader(special)
    return reader


def _scenarios(raw: dict[Any, Any], folder: Path) -> tuple[str, ...]:
    """Return the scenarios; a relative path starts at the campaign's folder."""
    if ("scenario" in raw) == ("scenarios" in raw):
        raise FormatError("", "one of scenario, scenarios is needed")
    named = [raw["scenario"]] if "scenario" in raw else raw["scenarios"]
    key = "scenario" if "scenario" in raw else "scenarios"
    if not isinstance(named, list) or not named:
        raise FormatError(key, f"expected a list of names, got {named!r}")
    for name in named:
        if not isinstance(name, str) or not name.isprintable():
            raise FormatError(key, f"{name!r} is no name")
    if len(set(named)) != len(named):
        raise FormatError(key, "duplicate name")
    return tuple(str(folder / name) if name.endswith(SUFFIXES) else name for name in named)


def _runs(raw: object) -> int | Until:
    if isinstance(raw, dict):
        return _reader().read(raw, Until)
    if type(raw) is not int or not 1 <= raw <= MAX_RUNS:
        raise ValueError(f"expected 1 .. {MAX_RUNS}, or until: WIDTH, got {quoted(raw)}")
    return raw


def _interval(raw: object) -> Interval:
    if not isinstance(raw, list) or len(raw) != 2:
        raise ValueError(f"expected [LOW, HIGH], got {quoted(raw)}")
    low, high = map(angle_of, raw)
    return Interval(low, high)


def _scalar(raw: object) -> Scalar:
    """Return one value; a non-scalar, such as a list, as YAML. An angle in degrees is a number."""
    if isinstance(raw, float) or (isinstance(raw, str) and raw.strip().endswith("deg")):
        return angle_of(raw)
    if isinstance(raw, str | bool | int):
        return raw
    written: str = yaml.safe_dump(raw, default_flow_style=True, width=10**9)
    return written.removesuffix("\n").removesuffix("\n...")


def _alternatives(raw: object) -> tuple[Alternative, ...]:
    """Return the values of a choice or grid, some of them by their names."""
    if not isinstance(raw, dict):
        return _reader().read(raw, tuple[Scalar, ...])
    for name in raw:
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise ValueError(f"{quoted(name)} is no name of letters, digits, - and _")
    return tuple(Named(name, _scalar(value)) for name, value in raw.items())


def _faults(raw: object) -> tuple[Alternative, ...]:
    return _reader().read(raw, tuple[FaultDraw, ...])


def _fault(raw: object) -> FaultDraw:
    if isinstance(raw, str):
        return FaultDraw(raw)
    if not (isinstance(raw, dict) and len(raw) == 1 and isinstance(next(iter(raw)), str)):
        raise ValueError(f"expected a fault, as odometry_jump: {{by: 0.5}}, got {quoted(raw)}")
    ((name, content),) = raw.items()
    if not isinstance(content, dict):
        raise FormatError(name, f"expected parameters, as {{by: 0.5}}, got {quoted(content)}")
    return FaultDraw(
        name,
        tuple(
            (parameter, _parameter(value, f"{name}.{parameter}"))
            for parameter, value in content.items()
        ),
    )


def _parameter(raw: object, path: str) -> Scalar | Number:
    value: Scalar | Number = _reader().read(raw, Number if isinstance(raw, dict) else Scalar, path)
    return value


def read_vary(raw: object) -> tuple[Variation, ...]:
    """Return the varied quantities, sorted, so that a world precedes its friction."""
    if not isinstance(raw, dict):
        raise FormatError("vary", f"expected keys and values, got {quoted(raw)}")
    found = []
    for key, content in raw.items():
        path = f"vary.{key}"
        if not isinstance(key, str):
            raise FormatError("vary", f"{quoted(key)} is no key of a scenario")
        if key == INJECT:
            found.append(_injected(content, path))
        else:
            distribution: Distribution = _reader().read(content, Distribution, path)
            found.append(Variation(key=key, distribution=distribution))
    return tuple(sorted(found, key=lambda variation: variation.key))


def _injected(raw: object, path: str) -> Variation:
    """Return the variation of faults: like other values, with `at` and, if they end, `for`."""
    if not isinstance(raw, dict) or "at" not in raw:
        raise FormatError(path, "expected choice or grid of faults, and at: their start")
    content = {key: value for key, value in raw.items() if key not in ("at", "for")}
    distribution: Distribution = _reader(faults=True).read(content, Distribution, path)
    if not isinstance(distribution, Choice | Grid):
        raise FormatError(path, "expected choice or grid of faults")
    return Variation(
        key=INJECT,
        distribution=distribution,
        at=_time(raw["at"], f"{path}.at"),
        duration=_time(raw["for"], f"{path}.for") if "for" in raw else None,
    )


def _time(raw: object, path: str) -> Distribution | float:
    if not isinstance(raw, dict):
        return _seconds(raw, path)
    time: Distribution = _reader().read(raw, Distribution, path)
    for end in _ends_of(time):
        _seconds(end, path)
    return time


def _seconds(raw: object, path: str) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise FormatError(path, f"expected seconds or a distribution, got {quoted(raw)}")
    return float(raw)


def _check_criteria(campaign: Campaign) -> None:
    """Raise FormatError if a criterion uses an unknown key."""
    known = runs.keys_of(campaign)
    for index, criterion in enumerate(campaign.criteria):
        path = f"criteria[{index}]"
        try:
            criterion.where.check(known)
        except ValueError as error:
            raise FormatError(f"{path}.where", str(error)) from error
        if isinstance(criterion, Quantile):
            try:
                require_key(criterion.of, [key for key, numeric in known.items() if numeric])
            except ValueError as error:
                raise FormatError(f"{path}.of", str(error)) from error


def _check_scenarios(campaign: Campaign) -> None:
    """Try the ends of each varied quantity, one after the other, on each scenario.

    Asset, world and settings are set before a fault, which may need a sensor that these add.
    """
    for scenario in campaign.scenarios:
        _check_loads(scenario, (), "scenarios")
        base = tuple(
            change
            for variation in campaign.vary
            if variation.key in ("asset", "world") or variation.key.startswith("settings.")
            for _, change in list(_ends(variation))[:1]
        )
        for variation in campaign.vary:
            last = variation.key == INJECT
            before = tuple(change for change in base if last or change.key < variation.key)
            for path, change in _ends(variation):
                try:
                    _check_loads(scenario, (*before, change), path)
                except FormatError as error:
                    if not _boundless(variation):
                        raise
                    hint = (
                        f"normal is tried {TRIED_STANDARD_DEVIATIONS:g} standard deviations from"
                        " its mean"
                    )
                    raise FormatError(path, f"{error.faults[0][1]}; {hint}: add within") from error


def _check_loads(scenario: str, changes: tuple[Override, ...], path: str) -> None:
    try:
        load_scenario(scenario, RunMode.LOCK_STEP, changes)
    except SettingsError as error:
        raise FormatError(path, str(error)) from error


def _ends(variation: Variation) -> Iterator[tuple[str, Override]]:
    """Yield the minimum and maximum of a key, or all its values, each with its path."""
    path = f"vary.{variation.key}"
    values = list(_ends_of(variation.distribution))
    if variation.key != INJECT:
        for value in values:
            assert not isinstance(value, FaultDraw)
            yield path, Override(variation.key, draws.written(value))
        return
    raw = {"at": variation.at, "for": variation.duration}
    times = {
        key: [time] if isinstance(time, float) else list(_ends_of(time))
        for key, time in raw.items()
        if time is not None
    }
    faults = [each for each in values if isinstance(each, FaultDraw) and each.name != NO_FAULT]
    for index, fault in enumerate(faults):
        drawn = any(isinstance(raw, Number) for _, raw in fault.parameters)
        for end in (0, -1) if drawn or not index else (0,):
            given = {
                name: list(_ends_of(raw))[end] if isinstance(raw, Number) else raw
                for name, raw in fault.parameters
            }
            ends = {key: found[end] for key, found in times.items()}
            yield path, fault_change(fault.name, given, ends)


def _boundless(variation: Variation) -> bool:
    """Return whether a value is drawn from a normal distribution without bounds."""
    alternatives = [variation.distribution, variation.at, variation.duration]
    for each in draws.alternatives(variation.distribution):
        if isinstance(each, FaultDraw):
            alternatives += [value for _, value in each.parameters if isinstance(value, Number)]
    return any(isinstance(each, Normal) and each.within is None for each in alternatives)


def _ends_of(distribution: Distribution) -> Iterator[Any]:
    match distribution:
        case Uniform(interval) | LogUniform(interval):
            yield from (interval.low, interval.high)
        case Normal((mean, deviation), None):
            yield from (
                mean - TRIED_STANDARD_DEVIATIONS * deviation,
                mean + TRIED_STANDARD_DEVIATIONS * deviation,
            )
        case Normal(_, Interval(low, high)):
            yield from (low, high)
        case Integers((first, last)):
            yield from (first, last)
        case Choice(choice=values) | Grid(grid=values):
            yield from values
        case _:
            raise AssertionError(distribution)
