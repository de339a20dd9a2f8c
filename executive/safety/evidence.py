"""What monitors return, and how they are declared."""

from collections.abc import Callable
from dataclasses import dataclass

from executive.faults import Window
from executive.safety.history import MotionHistory
from executive.values.reasons import Figure


@dataclass(frozen=True, slots=True)
class Evidence:
    """What shows a fault: one sentence, and the figures behind it with their bound."""

    text: str
    figures: tuple[Figure, ...] = ()


Monitor = Callable[[MotionHistory, Window, float], Evidence | None]
"""Looks at the history with the figures of a window, at a time; None where it shows no fault."""
