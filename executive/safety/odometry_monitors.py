"""Monitors that need odometry, and what was commanded."""

from typing import Final, TypeGuard

from executive.fault_table import Row
from executive.reasons import Figure
from executive.safety.evidence import Evidence
from executive.safety.history import History, Jump

SHOWN_S: Final = 0.1
"""For which a single message is evidence."""


def jumped(history: History, _: Row, now_s: float) -> Evidence | None:
    """See a step of the pose that is longer than the speed explains."""
    jump = history.jump
    return _told(jump) if _recent(jump, now_s) and jump.step_m > jump.bound_m else None


def turned(history: History, _: Row, now_s: float) -> Evidence | None:
    """See a turn in one step of the pose that is greater than the rate explains."""
    jump = history.jump
    return _told(jump) if _recent(jump, now_s) and jump.step_m <= jump.bound_m else None


def _recent(jump: Jump | None, now_s: float) -> TypeGuard[Jump]:
    return jump is not None and now_s - jump.at_s <= SHOWN_S


def _told(jump: Jump) -> Evidence:
    return Evidence(
        f"odometry jumped by {jump.step_m:.2f} m and {jump.turn_rad:.2f} rad",
        (
            Figure("jump", jump.step_m, "m"),
            Figure("bound", jump.bound_m, "m"),
            Figure("turn", jump.turn_rad, "rad"),
            Figure("turn bound", jump.bound_rad, "rad"),
        ),
    )


def stale(history: History, row: Row, now_s: float) -> Evidence | None:
    """See that the newest odometry is too old to move by."""
    age_s = now_s - history.odometry_at_s
    if age_s <= row.bound:
        return None
    figures = Figure("age", age_s, "s"), Figure("bound", row.bound, "s")
    return Evidence(f"odometry is {age_s:.2f} s old", figures)
