"""How well the pose of a rover behind a delay is predicted, on random sites with an operator."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Final

from tests.benchmarks.delayed_sites import LENGTH_M, Judged, Mission, Played, stuck_after_m
from tests.support.figures import Figure, Goal, quantile

ROUND_TRIPS_S: Final = (2.6, 10.0, 300.0)
COMPARED_S: Final = 10.0
"""Round trip of the comparison with moving and waiting."""
FITTED_SITES: Final = 9
"""Number of sites that 2 sigma was fitted to: the first ones, which are not measured."""
OFF_PATH_M: Final = 0.3
IN_2_SIGMA: Final = Goal(0.9, at_least=True)
ON_PATH: Final = Goal(0.99, at_least=True)
GAIN: Final = Goal(1.3, at_least=True)
NO_CONTACT: Final = Goal(0.0)
MIN_PAIRS: Final = 10
"""Minimum number of sites for the gain to have a goal: that of one site is chance."""
H_S: Final = 3600.0


def measure(sites: int, log: Callable[[str], None]) -> list[Figure]:
    """Play each site with each delay, and again by moving and waiting at `COMPARED_S`.

    Logs the figures of each site, for a run that is cut off.
    """
    played: dict[float, list[Played]] = {each: [] for each in ROUND_TRIPS_S}
    waited: list[Played] = []
    numbers = range(FITTED_SITES, FITTED_SITES + sites)
    for number in numbers:
        for round_trip_s, missions in played.items():
            missions.append(_play(number, round_trip_s, committed=True))
            log(_line(number, f"{round_trip_s:g} s", missions[-1]))
        waited.append(_play(number, COMPARED_S, committed=False))
        log(_line(number, f"{COMPARED_S:g} s, moving and waiting", waited[-1]))
    figures = [figure for each in ROUND_TRIPS_S for figure in _figures(f"{each:g} s", played[each])]
    return figures + _gains(numbers, played[COMPARED_S], waited)


def _line(number: int, name: str, played: Played) -> str:
    usual = [each for each in played.judged if each.moving and not each.unexpected]
    inside = sum(each.error_m <= each.predicted.deviation_m for each in usual)
    on_path = sum(each.off_path_m <= OFF_PATH_M for each in played.judged)
    took = "not crossed" if played.duration_s is None else f"{played.duration_s:.1f} s"
    shares = f"{inside} of {len(usual)} in 2 sigma, {on_path} of {len(played.judged)} on the path"
    return f"site {number}, {name}: {took}, {played.contacts} contacts, {shares}"


def _play(site: int, round_trip_s: float, *, committed: bool) -> Played:
    with tempfile.TemporaryDirectory() as folder:
        mission = Mission(site, Path(folder), round_trip_s, committed=committed)
        return mission.play(predicts=committed)


def _figures(name: str, played: list[Played]) -> list[Figure]:
    judged = [each for mission in played for each in mission.judged]
    usual = [each for each in judged if each.moving and not each.unexpected]
    unexpected = [each for each in judged if each.moving and each.unexpected]
    beside = f"{len(usual)} predictions of a moving rover before wheels stick"
    on_path = sum(each.off_path_m <= OFF_PATH_M for each in judged) / len(judged)
    figures = [
        Figure(f"{name}: error, median", median(each.error_m for each in usual), "m", beside),
        Figure(f"{name}: error, 95 %", quantile([each.error_m for each in usual], 0.95), "m"),
        Figure(f"{name}: 2 sigma, median", median(_deviations_m(usual)), "m"),
        Figure(f"{name}: within 2 sigma", _within(usual), "", beside, IN_2_SIGMA),
        Figure(f"{name}: on the drawn path", on_path, "", f"{len(judged)} in all", ON_PATH),
        Figure(f"{name}: contacts", sum(each.contacts for each in played), "", "", NO_CONTACT),
    ]
    if unexpected:
        after = f"{len(unexpected)} predictions after wheels have stuck"
        figures.append(Figure(f"{name}: within 2 sigma then", _within(unexpected), "", after))
    return figures


def _deviations_m(judged: list[Judged]) -> list[float]:
    return [each.predicted.deviation_m for each in judged]


def _within(judged: list[Judged]) -> float:
    return sum(each.error_m <= each.predicted.deviation_m for each in judged) / len(judged)


def _gains(numbers: range, played: list[Played], waited: list[Played]) -> list[Figure]:
    """Return the paces, and the gain of sites where wheels stick and where none do."""
    pairs = [
        (one.duration_s, other.duration_s, stuck_after_m(site) is not None)
        for site, one, other in zip(numbers, played, waited, strict=True)
        if one.duration_s is not None and other.duration_s is not None
    ]

    def gain(*, stuck: bool) -> float:
        gains = (other_s / one_s for one_s, other_s, sticks in pairs if sticks is stuck)
        return median(gains)

    pace = median(LENGTH_M * H_S / one_s for one_s, _, _ in pairs)
    waiting = median(LENGTH_M * H_S / other_s for _, other_s, _ in pairs)
    contacts = sum(each.contacts for each in waited)
    beside = f"{len(pairs)} sites of {len(played)}; the others were not crossed by both"
    goal = GAIN if len(pairs) >= MIN_PAIRS else None
    return [
        Figure("10 s: committed path", pace, "m/h", beside),
        Figure("10 s: moving and waiting", waiting, "m/h", beside),
        Figure("10 s: gain, median", gain(stuck=False), "", "where nothing sticks", goal),
        Figure("10 s: gain, median, stuck", gain(stuck=True), "", "where wheels stick for 1.5 s"),
        Figure("10 s: contacts, moving and waiting", contacts, "", "", NO_CONTACT),
    ]
