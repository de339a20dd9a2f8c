"""Evidence of sources that disagree, in words and in figures."""

from collections.abc import Mapping
from math import inf
from typing import Final

from executive.faults import Window
from executive.safety.evidence import Evidence
from executive.safety.history import MotionHistory
from executive.values.reasons import Figure

FIRST_HEARD_S: Final = 10.0
"""After the start, in which nodes find each other: so long a sensor may be unheard."""


def compared(what: str, figures: tuple[Figure, ...], bound: float, window_s: float) -> Evidence:
    """Return evidence of what sources say of a window.

    Args:
        what: is wrong, for people.
        figures: what each source says, of one unit.
        bound: of the difference, in that unit.
        window_s: how long the window is.
    """
    said = ", ".join(f"{each.name} {each.value:.2f} {each.unit}" for each in figures)
    limits = Figure("bound", bound, figures[-1].unit), Figure("window", window_s, "s")
    return Evidence(f"{what}: {said} over {window_s:.1f} s", (*figures, *limits))


def speeds(
    history: MotionHistory, window_s: float, to_s: float, ways_m: Mapping[str, float]
) -> tuple[Figure, ...]:
    """Return the mean speed that was commanded, and those that sources tell, as figures.

    Args:
        history: has what was commanded.
        window_s: the window.
        to_s: its end.
        ways_m: in the window, by who tells of them.
    """
    wanted = history.commanded_in(window_s, to_s)
    known_m = ways_m if wanted is None else {"commanded": wanted.way_m, **ways_m}
    return tuple(Figure(name, way_m / window_s, "m/s") for name, way_m in known_m.items())


def turns(
    history: MotionHistory, window_s: float, to_s: float, turned_rad: Mapping[str, float]
) -> tuple[Figure, ...]:
    """Return the turn that was commanded, and those that sources tell, as figures.

    Args:
        history: has what was commanded.
        window_s: the window.
        to_s: its end.
        turned_rad: in the window, by who tells of them.
    """
    wanted = history.commanded_in(window_s, to_s)
    known = turned_rad if wanted is None else {"commanded": wanted.turn_rad, **turned_rad}
    return tuple(Figure(name, turn_rad, "rad") for name, turn_rad in known.items())


def silent(
    history: MotionHistory, who: str, what: str, last_s: float, window: Window, now_s: float
) -> Evidence | None:
    """Return evidence that a source tells nothing, if so.

    Args:
        history: has when it began.
        who: the source, for people.
        what: is not monitored then, with its verb.
        last_s: when what it told last was measured; minus infinity if it never told anything.
        window: with the greatest age.
        now_s: the time.
    """
    unheard = last_s == -inf
    age_s = now_s - (history.start_s + FIRST_HEARD_S if unheard else last_s)
    if age_s <= window.bound:
        return None
    figures = Figure("age", age_s, "s"), Figure("bound", window.bound, "s")
    if unheard:
        return Evidence(f"{who} has told nothing yet: {what} not monitored", figures)
    return Evidence(f"{who} tells nothing for {age_s:.1f} s: {what} not monitored", figures)
