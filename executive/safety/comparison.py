"""Evidence that sources disagree, as text and figures."""

from collections.abc import Mapping
from math import inf
from typing import Final

from executive.faults import Window
from executive.safety.evidence import Evidence
from executive.safety.motion_history import MotionHistory
from executive.values.reasons import Figure

DISCOVERY_GRACE_S: Final = 10.0
"""Grace period after the start, for the discovery of nodes: no message is required yet."""


def disagreement_evidence(
    what: str, figures: tuple[Figure, ...], bound: float, window_s: float
) -> Evidence:
    """Return evidence of a disagreement over a window.

    Args:
        what: the disagreement, for display.
        figures: the value of each source, in one unit.
        bound: of the difference, in that unit.
        window_s: length of the window.
    """
    text = ", ".join(f"{each.name} {each.value:.2f} {each.unit}" for each in figures)
    limits = Figure("bound", bound, figures[-1].unit), Figure("window", window_s, "s")
    return Evidence(f"{what}: {text} over {window_s:.1f} s", (*figures, *limits))


def speeds(
    history: MotionHistory, window_s: float, to_s: float, distances_m: Mapping[str, float]
) -> tuple[Figure, ...]:
    """Return the commanded mean speed and those by sources, as figures.

    Args:
        history: has the commands.
        window_s: length of the window.
        to_s: its end.
        distances_m: distance in the window by source.
    """
    wanted = history.commanded_in(window_s, to_s)
    known_m = distances_m if wanted is None else {"commanded": wanted.twist_travel_m, **distances_m}
    return tuple(Figure(name, distance_m / window_s, "m/s") for name, distance_m in known_m.items())


def turns(
    history: MotionHistory, window_s: float, to_s: float, turned_rad: Mapping[str, float]
) -> tuple[Figure, ...]:
    """Return the commanded turn and those by sources, as figures.

    Args:
        history: has the commands.
        window_s: length of the window.
        to_s: its end.
        turned_rad: turn in the window by source.
    """
    wanted = history.commanded_in(window_s, to_s)
    known = turned_rad if wanted is None else {"commanded": wanted.twist_turn_rad, **turned_rad}
    return tuple(Figure(name, turn_rad, "rad") for name, turn_rad in known.items())


def silent_sensor(
    history: MotionHistory, sensor: str, what: str, last_s: float, window: Window, now_s: float
) -> Evidence | None:
    """Return evidence that no recent message of a source was received, or None.

    Args:
        history: has the time of the start.
        sensor: the source, for display.
        what: the quantity that is not monitored then, with its verb.
        last_s: time of the last measurement; minus infinity before the first.
        window: with the maximum age.
        now_s: the time.
    """
    unheard = last_s == -inf
    age_s = now_s - (history.start_s + DISCOVERY_GRACE_S if unheard else last_s)
    if age_s <= window.bound:
        return None
    figures = Figure("age", age_s, "s"), Figure("bound", window.bound, "s")
    if unheard:
        return Evidence(f"no {sensor} message yet: {what} not monitored", figures)
    return Evidence(
        f"no {sensor} message for {age_s:.1f} s (limit {window.bound:g} s): {what} not monitored",
        figures,
    )
