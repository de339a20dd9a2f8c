"""Random plans against the traces of BehaviorTree.CPP 4.10: is each of their ticks the same?"""

import random
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from enum import Enum, unique
from functools import partial
from typing import Final

from executive.plans import EvaluationError, LeafError
from executive.values.reasons import Refusal
from tests.stress.findings import Finding, Findings, Log
from tests.support.behaviortree_cpp.traces import digest_of, recorded_digests
from tests.support.figures import Figure, Goal
from tests.support.random_plans import random_plan
from tests.support.scripted_plans import Classes, play, read

PORTION: Final = 500
WORKERS: Final = 2


@unique
class TraceFault(Enum):
    """How a plan can differ."""

    REFUSED = "plans refused"
    TOO_LARGE = "results that are too large; infinite in 4.10"
    DIFFERS = "traces that differ"
    DIFFERS_STORED = "traces that differ with the state written and read before each tick"


def measure(count: int, seed: int, log: Log, classes: Classes | None = None) -> list[Figure]:
    """Return how many plans differ from their recorded traces.

    Args:
        count: plans; of the recorded ones, at most all.
        seed: selects them.
        log: called with a line on each of the first that differ.
        classes: classes of nodes to use instead of the product's; tests give faulty ones.
    """
    recorded = list(recorded_digests().items())
    random.Random(seed).shuffle(recorded)
    selected = recorded[:count]
    findings, ticks = Findings(log), 0
    portions = [selected[at : at + PORTION] for at in range(0, len(selected), PORTION)]
    play_portion = partial(_play_portion, classes=classes)
    with ExitStack() as stack:
        played: Iterable[tuple[list[Finding], int]] = map(play_portion, portions)
        if len(portions) > 1:
            played = stack.enter_context(ProcessPoolExecutor(WORKERS)).map(play_portion, portions)
        for found, count_of_ticks in played:
            ticks += count_of_ticks
            for fault, about in found:
                findings.add(fault, about)
    beside = f"{len(selected)} plans, seed {seed}"
    return [
        Figure("plans: compared", len(selected), "plans", beside, Goal(count, at_least=True)),
        Figure("plans: ticks", ticks, "ticks", beside),
        *(
            replace(each, goal=Goal(len(selected) / 500))
            if TraceFault.TOO_LARGE.value in each.name
            else each
            for each in findings.figures("plans", TraceFault, "against BehaviorTree.CPP 4.10")
        ),
    ]


def _play_portion(
    portion: Sequence[tuple[int, bytes]], classes: Classes | None
) -> tuple[list[Finding], int]:
    """Return what differs, and the number of ticks."""
    found: list[Finding] = []
    ticks = 0
    for seed, digest in portion:
        plan = random_plan(seed)
        root = read(plan)
        if isinstance(root, Refusal):
            found.append((TraceFault.REFUSED, f"seed {seed}: {root.text}"))
            continue
        for fault, stored in ((TraceFault.DIFFERS, False), (TraceFault.DIFFERS_STORED, True)):
            try:
                trace = play(plan, root, stored, classes)
            except LeafError as error:
                too_large = isinstance(error.__cause__, EvaluationError)
                found.append((TraceFault.TOO_LARGE if too_large else fault, f"seed {seed}"))
                continue
            ticks += len(trace)
            if digest_of(trace) != digest:
                found.append((fault, f"seed {seed}"))
    return found, ticks
