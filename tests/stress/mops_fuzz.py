"""Wrong MOPS strings against everything that reads them: does anything give way?"""

import resource
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Final

from adapters.mops import load_dictionary
from executive.settings import Settings
from tests.stress.mops_aboard import Aboard
from tests.stress.mops_readers import (
    BRICK,
    Brick,
    Fault,
    Faults,
    Orbiter,
    Parsers,
    Reader,
)
from tests.stress.mops_strings import Samples, Wrong
from tests.support.figures import Figure, Goal

WARM_UP: Final = 0.3
"""Part of the strings after which memory is first looked at."""
MB: Final = 1e6


@dataclass(frozen=True, slots=True)
class Result:
    """What a campaign found.

    Attributes:
        duration_s: how long it took.
        mutated: messages that something was done to.
        texts: texts of one to four messages, each with a sound one behind them.
        grown_mb: memory of this process, since the warm-up.
    """

    duration_s: float
    mutated: int
    texts: int
    grown_mb: float
    faults: Faults


def campaign(settings: Settings, count: int, seed: int, prepare: Callable[[], None]) -> Result:
    """Feed everybody.

    Args:
        settings: of the rover.
        count: how many messages are to be spoilt.
        seed: of everything random.
        prepare: is called when everybody is there; tests break them.
    """
    random, dictionary, faults = Random(seed), load_dictionary(), Faults()
    asset = settings.asset.upper()
    with tempfile.TemporaryDirectory(prefix="rover-mops-") as place, ExitStack() as stack:
        folder = Path(place)
        jackal: list[Reader] = [
            Parsers(dictionary),
            Aboard(dictionary, settings, folder / "aboard"),
            Orbiter(dictionary, folder / "orbiter", asset),
        ]
        brick: list[Reader] = [Brick(dictionary)]
        for reader in (*jackal, *brick):
            stack.enter_context(closing(reader))
        prepare()
        ours = Wrong(Samples(dictionary, random, asset), random)
        theirs = Wrong(Samples(dictionary, random, BRICK), random)
        turns = [*((ours, reader) for reader in jackal), *((theirs, reader) for reader in brick)]
        texts, warm_mb, began_s = 0, None, time.perf_counter()
        while (mutated := ours.mutated + theirs.mutated) < count:
            wrong, reader = turns[texts % len(turns)]
            texts += 1
            portions = wrong.cuts(wrong.octets())
            try:
                reader.take(portions, faults)
            except Exception as error:
                # Whatever it is, it is what this looks for.
                faults.add(Fault.RAISED, (b"".join(portions), error))
            if warm_mb is None and mutated >= WARM_UP * count:
                warm_mb = _resident_mb()
        duration_s = time.perf_counter() - began_s
        return Result(duration_s, mutated, texts, _resident_mb() - (warm_mb or 0.0), faults)


def break_nothing() -> None:
    """Break nothing."""


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / MB


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
