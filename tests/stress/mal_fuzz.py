"""Wrong messages by the million against a living provider of the MRS: does anything give way?"""

import multiprocessing
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from random import Random
from typing import Any, Final

import psutil

from adapters.mal import Codec, Encoding, MalUri, Operation
from adapters.mrs.fleet.directory_service import MOST_SERVICES
from adapters.mrs.spec.specification import mrs_specification
from adapters.mrs.spec.types import CommandHeader
from executive.settings import Settings
from tests.stress.mal_attack import Attack, Outcome
from tests.stress.mal_messages import Messages
from tests.stress.mal_target import (
    FILE,
    Look,
    Options,
    serve,
)
from tests.support.figures import Figure, Goal

WARM_UP: Final = 0.3
"""Part of the messages after which memory is first looked at."""
START_S: Final = 60.0
SETTLE_S: Final = 5.0
LOOK_S: Final = 0.2
GRACE_S: Final = 5.0
MB: Final = 1e6
PLAN: Final = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
<RotateBy angle="0.5"/><MoveForward distance="0.5"/></Sequence></BehaviorTree></root>"""
WORDS: Final = (
    *("", "*", "MOE", "MOPS", "jackal", "all", "append", "replace", "POS_X", "BATERY_VOLTAGE"),
    *(FILE, "pictures", "/", "../secret", "x" * 300, "VIDEO ON", "VIDEO OFF"),
    *("BTCPP4", "<root/>", PLAN, "maltcp://127.0.0.1:1/MRS"),
)
"""Texts that mean something to a rover."""


@dataclass(frozen=True, slots=True)
class Found:
    """What a provider is and holds, when nobody is connected.

    Attributes:
        resident_mb: memory of the process.
        files: its open file descriptors, sockets included.
        look: what it says of itself.
    """

    resident_mb: float
    files: int
    look: Look


@dataclass(frozen=True, slots=True)
class Result:
    """What a campaign found.

    Attributes:
        duration_s: how long the messages took.
        mutated: how many had something done to them; by chance a few are sound all the same.
        outcomes: what became of all that were sent, storms of sound ones included.
        unserved: good clients that were not answered.
        unproven: commands that were admitted though no sound message asked for them.
        reached: service and operation of every message that was sound.
        before: the provider after its warm-up.
        after: the provider in the end.
    """

    duration_s: float
    mutated: int
    outcomes: Counter[Outcome]
    unserved: int
    unproven: int
    reached: frozenset[tuple[str, str]]
    before: Found
    after: Found


class DeadError(Exception):
    """The provider's process ended, or hangs; the text says how."""


def break_nothing() -> None:
    """Break nothing."""


def campaign(
    settings: Settings,
    count: int,
    seed: int,
    encoding: Encoding,
    held: bool,
    prepare: Callable[[], None] = break_nothing,
) -> Result:
    """Attack a provider of its own.

    Args:
        settings: of its rover.
        count: how many mutated messages.
        seed: of everything that is random.
        encoding: of message bodies.
        held: whether the rover cannot move at all, for want of odometry.
        prepare: called in the provider's process before it starts; tests break it there.

    Raises:
        DeadError: the provider ended.
    """
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        pipe, theirs = spawn.Pipe()
        options = Options(encoding, held, Path(folder), prepare)
        process = spawn.Process(target=serve, args=(options, settings, theirs), daemon=True)
        process.start()
        theirs.close()
        try:
            return _attacked(process.pid or 0, pipe, count, Random(seed), encoding)
        except (EOFError, ConnectionError, TimeoutError, psutil.Error) as error:
            process.join(GRACE_S)
            raise DeadError(f"exit code {process.exitcode}: {error!r}") from error
        finally:
            pipe.close()
            process.join(GRACE_S)
            process.kill()


def _attacked(pid: int, pipe: Pipe, count: int, random: Random, encoding: Encoding) -> Result:
    proven: set[tuple[str, int]] = set()

    reached: set[tuple[str, str]] = set()

    def taken(operation: Operation, values: tuple[Any, ...]) -> None:
        reached.add((operation.service_name, operation.name))
        if values and isinstance(values[0], CommandHeader):
            proven.add((values[0].source, values[0].commandId))

    uri, specification = _heard(pipe), mrs_specification()
    messages = Messages(specification, encoding, random, uri, WORDS)
    attack = Attack(
        specification,
        Codec(specification, encoding),
        messages,
        random,
        MalUri.parse(uri).port,
        taken,
    )
    warm_up = round(WARM_UP * count)
    began_s = time.perf_counter()
    attack.send(warm_up)
    before = _settled(pid, pipe)
    attack.send(count - warm_up)
    duration_s = time.perf_counter() - began_s
    after = _settled(pid, pipe)
    return Result(
        duration_s,
        attack.mutated,
        attack.outcomes,
        attack.unserved,
        len(after.look.admitted - proven),
        frozenset(reached),
        before,
        after,
    )


def _settled(pid: int, pipe: Pipe) -> Found:
    """The provider when it has noticed that everybody hung up, or after a while."""
    process, deadline_s = psutil.Process(pid), time.monotonic() + SETTLE_S
    while True:
        pipe.send(True)
        look: Look = _heard(pipe)
        if not look.open or time.monotonic() > deadline_s:
            return Found(process.memory_info().rss / MB, process.num_fds(), look)
        time.sleep(LOOK_S)


def _heard(pipe: Pipe) -> Any:
    if not pipe.poll(START_S):
        raise TimeoutError(f"nothing heard in {START_S:.0f} s")
    return pipe.recv()


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
