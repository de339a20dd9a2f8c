"""Wrong MOPS strings against all who read them: does anything give way?"""

from collections.abc import Callable
from typing import Final

from executive.settings import Settings
from sim.bench.figures import Figure, Goal
from sim.mops_fuzz.campaign import break_nothing, campaign
from sim.mops_fuzz.faults import Fault

MOST_GROWTH_MB: Final = 5.0
Tell = Callable[[str], None]


def measure(
    settings: Settings,
    count: int,
    seed: int,
    tell: Tell,
    prepare: Callable[[], None] = break_nothing,
) -> list[Figure]:
    """Return how often a promise was broken.

    Args:
        settings: of the rover.
        count: mutated messages in all.
        seed: of everything random.
        tell: called with a line on each of the first faults.
        prepare: called when everybody is there; tests break them.
    """
    result = campaign(settings, count, seed, prepare)
    for example in result.faults.examples:
        tell(example)
    beside = f"{result.mutated} mutated messages, seed {seed}"
    counts = result.faults.counts
    return [
        Figure("MOPS: mutated messages", result.mutated, "messages", beside),
        Figure("MOPS: texts", result.texts, "texts", "the last message of each is sound"),
        Figure("MOPS: rate", result.mutated / result.duration_s, "1/s", "making and judging too"),
        *(Figure(f"MOPS: {each.value}", counts[each], "", beside, Goal(0)) for each in Fault),
        Figure(
            "MOPS: memory gained", result.grown_mb, "MB", "since 30% of it", Goal(MOST_GROWTH_MB)
        ),
    ]
