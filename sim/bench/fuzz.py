"""Wrong messages against a living provider of the MRS: does anything give way?"""

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import product
from typing import Final

from adapters.mal.attribute_codec import Encoding
from adapters.mrs.registry import MOST_SERVICES
from executive.settings import Settings
from sim.bench.figures import Figure, Goal
from sim.fuzz.campaign import DeadError, Result, break_nothing, campaign
from sim.fuzz.judge import Outcome

MOST_GROWTH_MB: Final = 5.0
FAULTS: Final = {
    Outcome.LOST: "left without an answer",
    Outcome.UNFOUNDED: "hung up on without a reason",
    Outcome.UNEARNED: "taken though not sound",
    Outcome.INTERNAL: "answered by INTERNAL",
    Outcome.STRAY: "answers to nothing",
}
"""What must not become of a message."""
PARTS: Final = tuple(product(Encoding, (True, False)))
Tell = Callable[[str], None]


def measure(
    settings: Settings,
    count: int,
    seed: int,
    tell: Tell,
    prepare: Callable[[], None] = break_nothing,
    parts: Sequence[tuple[Encoding, bool]] = PARTS,
) -> list[Figure]:
    """Return how often a promise was broken, and what the providers gained in weight.

    Args:
        settings: of the rovers.
        count: mutated messages in all, shared out evenly.
        seed: of everything random.
        tell: called with a line on each provider.
        prepare: called in each provider's process before it starts; tests break it there.
        parts: the providers: their encodings, and whether their rovers cannot move.
    """
    results, dead = [], 0
    for number, (encoding, held) in enumerate(parts):
        name = f"{encoding.value}, {'held' if held else 'free'}"
        part = count * (number + 1) // len(parts) - count * number // len(parts)
        try:
            result = campaign(settings, part, seed + number, encoding, held, prepare)
        except DeadError as error:
            tell(f"{name}: {error}")
            dead += 1
            continue
        results.append(result)
        tell(f"{name}: {_line(result)}")
    outcomes = sum((result.outcomes for result in results), Counter())
    beside = f"{outcomes.total()} messages, {len(parts)} providers"
    return [
        *_course(results, outcomes, beside),
        Figure("fuzz: providers that died or hung", dead, "providers", beside, Goal(0)),
        *(
            Figure(f"fuzz: {text}", outcomes[outcome], "messages", beside, Goal(0))
            for outcome, text in FAULTS.items()
        ),
        *_weight(results, beside),
    ]


def _course(results: list[Result], outcomes: Counter[Outcome], beside: str) -> list[Figure]:
    duration_s = sum(result.duration_s for result in results)
    rate = outcomes.total() / duration_s if results else 0.0
    reached = frozenset().union(*(result.reached for result in results))
    kinds = (Outcome.ERROR, Outcome.CLOSED, Outcome.TAKEN, Outcome.NOT_OWED)
    return [
        Figure("fuzz: mutated messages", sum(r.mutated for r in results), "messages", beside),
        Figure("fuzz: rate", rate, "1/s", "making, sending, judging and answering"),
        Figure("fuzz: operations with sound messages", len(reached), "operations", "of the MRS"),
        *(Figure(f"fuzz: {kind.value}", outcomes[kind], "messages", beside) for kind in kinds),
    ]


def _weight(results: list[Result], beside: str) -> list[Figure]:
    def most(gained: Callable[[Result], float]) -> float:
        return max((gained(result) for result in results), default=0.0)

    def total(found: Callable[[Result], int]) -> int:
        return sum(found(result) for result in results)

    grown_mb = most(lambda result: result.after.resident_mb - result.before.resident_mb)
    files = most(lambda result: result.after.files - result.before.files)
    tasks = most(lambda result: result.after.look.tasks - result.before.look.tasks)
    kept = most(lambda result: result.after.look.kept)
    moved = total(lambda result: result.after.look.moved)
    errors = total(lambda result: result.after.look.error_count)
    return [
        Figure("fuzz: good clients not served", total(lambda r: r.unserved), "", beside, Goal(0)),
        Figure("fuzz: motion that nobody commanded", moved, "turns", beside, Goal(0)),
        Figure("fuzz: commands that nobody gave", total(lambda r: r.unproven), "", beside, Goal(0)),
        Figure("fuzz: errors in the log", errors, "lines", beside, Goal(0)),
        Figure("fuzz: memory gained", grown_mb, "MB", "since 30% of it", Goal(MOST_GROWTH_MB)),
        Figure("fuzz: files gained", files, "files", beside, Goal(0)),
        Figure("fuzz: tasks gained", tasks, "tasks", beside, Goal(0)),
        Figure(
            "fuzz: connections kept",
            kept,
            "connections",
            "a registered service keeps its own",
            Goal(MOST_SERVICES),
        ),
    ]


def _line(result: Result) -> str:
    outcomes, look = result.outcomes, result.after.look
    counts = ", ".join(f"{outcomes[kind]} {kind.name}" for kind in Outcome if outcomes[kind])
    memory = f"{result.before.resident_mb:.1f} then {result.after.resident_mb:.1f} MB"
    errors = "".join(f"\n  {error}" for error in look.errors)
    return f"{result.duration_s:.1f} s, {counts}; {len(look.admitted)} commands; {memory}{errors}"
