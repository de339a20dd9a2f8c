"""Reduces a storm that breaks a promise to the fewest deeds that still break it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from tests.simulated.deeds import Deed, Storm

Breaks = Callable[[Storm], bool]


def shrink(storm: Storm, breaks: Breaks, max_runs: int = 150) -> Storm:
    """Return a storm with as few deeds as can be found (delta debugging, Zeller 2002).

    Args:
        storm: breaks a promise.
        breaks: plays a storm, and returns whether it breaks the same promise.
        max_runs: how many storms are played at most.
    """
    left = max_runs

    def still(deeds: Sequence[Deed]) -> bool:
        nonlocal left
        left -= 1
        return left >= 0 and breaks(replace(storm, deeds=tuple(deeds)))

    deeds, parts = list(storm.deeds), 2
    while deeds and left > 0:
        size = max(1, len(deeds) // parts)
        for begin in range(0, len(deeds), size):
            rest = deeds[:begin] + deeds[begin + size :]
            if still(rest):
                deeds, parts = rest, max(2, parts - 1)
                break
        else:
            if size == 1:
                break
            parts = min(len(deeds), 2 * parts)
    return replace(storm, deeds=tuple(deeds))
