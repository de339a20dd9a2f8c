"""Result and signature of a fault monitor."""

from collections.abc import Callable
from dataclasses import dataclass

from executive.faults import Window
from executive.safety.motion_history import MotionHistory
from executive.values.reasons import Figure


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence of a fault: one sentence, and its figures with their bound."""

    text: str
    figures: tuple[Figure, ...] = ()


Monitor = Callable[[MotionHistory, Window, float], Evidence | None]
"""Checks the history against a window of a fault, at a time; None without evidence."""
