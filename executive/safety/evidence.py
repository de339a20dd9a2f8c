"""`Evidence` of a fault, as text and figures; helpers for sources that disagree or are silent."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Final

from executive.faults import Window
from executive.safety.motion_history import MotionHistory
from executive.values.quantities import quantity_text
from executive.values.reasons import Figure

DISCOVERY_GRACE_S: Final = 10.0
"""Grace period after the start, for the discovery of nodes: no message is required yet."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence of a fault: one sentence, and its figures with their bound."""

    text: str
    figures: tuple[Figure, ...] = ()


Monitor = Callable[[MotionHistory, Window, float], Evidence | None]
"""Checks the history against a window of a fault, at a time; None without evidence."""


def disagreement_evidence(
    what: str, figures: tuple[Figure, ...], bound: float, window_s: float
) -> Evidence:
    """Return evidence of a disagreement over a window.

    Args:
        what: text that names the disagreement.
        figures: the value of each source, in one unit.
        bound: of the difference, in that unit.
        window_s: length of the window.
    """
    text = ", ".join(
        f"{each.name} {quantity_text(each.value, each.unit, '.2f')}" for each in figures
    )
    limits = Figure("bound", bound, figures[-1].unit), Figure("window", window_s, "s")
    return Evidence(f"{what}: {text} over {window_s:.1f} s", (*figures, *limits))


def speed_evidence(
    what: str,
    history: MotionHistory,
    window_s: float,
    to_s: float,
    distances_m: Mapping[str, float],
    bound_m: float,
) -> Evidence:
    """Return evidence that mean speeds disagree: the commanded one and those by sources.

    Args:
        what: text that names the disagreement.
        history: has the commands.
        window_s: length of the window.
        to_s: its end.
        distances_m: distance in the window by source.
        bound_m: of their difference.
    """
    wanted = history.commanded_in(window_s, to_s)
    known_m = distances_m if wanted is None else {"commanded": wanted.twist_travel_m, **distances_m}
    figures = tuple(Figure(name, each_m / window_s, "m/s") for name, each_m in known_m.items())
    return disagreement_evidence(what, figures, bound_m / window_s, window_s)


def turn_evidence(
    what: str,
    history: MotionHistory,
    window_s: float,
    to_s: float,
    turned_rad: Mapping[str, float],
    bound_rad: float,
) -> Evidence:
    """Return evidence that turns disagree, likewise."""
    wanted = history.commanded_in(window_s, to_s)
    known = turned_rad if wanted is None else {"commanded": wanted.twist_turn_rad, **turned_rad}
    figures = tuple(Figure(name, each_rad, "rad") for name, each_rad in known.items())
    return disagreement_evidence(what, figures, bound_rad, window_s)


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
