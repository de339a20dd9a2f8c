"""What all fuzzers share: sound values, what makes them wrong, and a loop over who takes them.

Sound values come from hypothesis strategies, the same ones for the same seed, since they know the
edges of what types hold. The millions are made of them by mutation, which is a thousand times
faster.
"""

import time
from collections.abc import Callable, Sequence
from enum import Enum
from random import Random
from typing import Any, Final, TypeVar

import hypothesis
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st

from tests.stress.findings import Findings, resident_mb

T = TypeVar("T")
WARM_UP: Final = 0.3
"""Part of a campaign after which memory is first looked at."""
COUNTS: Final = (0, 1, 0x7F, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
"""Lengths and counts at the edges of what four octets hold."""
GROUP: Final = 100
"""Takes from one `settle` to the next."""


def examples(strategy: st.SearchStrategy[T], count: int, seed: int) -> list[T]:
    """Return about so many values of a strategy."""
    found: list[T] = []

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @hypothesis.given(strategy)
    def collect(value: T) -> None:
        found.append(value)

    collect()
    return found


def mutate(octets: bytes, random: Random, splices: Sequence[bytes] = ()) -> bytes:
    """Return octets with one to three places changed, filled up, cut out or repeated.

    Args:
        octets: what is sound.
        random: chooses where and how.
        splices: octets of other messages, parts of which are put in or take the place of others.
    """
    changed = bytearray(octets)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        at = random.randrange(len(changed) + 1)
        match random.randrange(8 if splices else 6):
            case 0:
                changed[at : at + 1] = random.randbytes(1)
            case 1 if at < len(changed):
                changed[at] ^= 1 << random.randrange(8)
            case 2:
                del changed[at : at + random.randrange(1, 9)]
            case 3:
                end = random.randrange(at, len(changed) + 1)
                changed[end:end] = changed[at:end] * 2
            case 4:
                changed[at : at + 4] = random.choice(COUNTS).to_bytes(4, "big")
            case 6 | 7 as path:
                splice = random.choice(splices)
                part = splice[: random.randrange(1, 40)]
                changed[at : at if path == 6 else len(changed)] = part
            case _:
                changed[at:at] = random.randbytes(random.randrange(1, 9))
    return bytes(changed)


def fragments(octets: bytes, random: Random, sizes: Sequence[int]) -> list[bytes]:
    """Return octets in pieces, each of one of these sizes, as a stream may bring them."""
    pieces, at = [], 0
    while at < len(octets):
        size = random.choice(sizes)
        pieces.append(octets[at : at + size])
        at += size
    return pieces


def attack(
    takers: Sequence[tuple[Callable[[], Any], Callable[[Any], None]]],
    count: int,
    findings: Findings,
    raised: Enum,
    settle: Callable[[], None] = lambda: None,
) -> tuple[float, float]:
    """Have all takers take, in turn, what was made for them.

    Args:
        takers: each as what makes, and what takes.
        count: how often, in all.
        findings: where whatever is raised is counted, as the fault `raised`.
        raised: see above.
        settle: called now and then.

    Returns:
        How long it took, in seconds, and the memory that grew since the warm-up, in MB.
    """
    began_s, warm_mb = time.perf_counter(), resident_mb()
    for number in range(count):
        make, take = takers[number % len(takers)]
        made = make()
        try:
            take(made)
        except Exception as error:
            # Whatever it is, it is what this looks for.
            findings.add(raised, (made, error))
        if number % GROUP == GROUP - 1:
            settle()
        if number == round(WARM_UP * count):
            warm_mb = resident_mb()
    return time.perf_counter() - began_s, resident_mb() - warm_mb


def break_nothing() -> None:
    """Break nothing; tests break whom they attack in its place."""
