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
from adapters.mrs.spec import CommandHeader, mrs_specification
from executive.settings import Settings
from tests.stress.findings import Tell, resident_mb
from tests.stress.fuzzing import WARM_UP, break_nothing
from tests.stress.mal_attack import Attack, Outcome
from tests.stress.mal_messages import Messages
from tests.stress.mal_target import FILE, Look, Options, serve
from tests.support.figures import Figure, Goal

START_S: Final = 60.0
SETTLE_S: Final = 5.0
LOOK_S: Final = 0.2
GRACE_S: Final = 5.0
MOST_GROWTH_MB: Final = 5.0
PLAN: Final = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
<RotateBy angle="0.5"/><MoveForward distance="0.5"/></Sequence></BehaviorTree></root>"""
WORDS: Final = (
    *("", "*", "MOE", "MOPS", "jackal", "all", "append", "replace", "POS_X", "BATERY_VOLTAGE"),
    *(FILE, "pictures", "/", "../secret", "x" * 300, "VIDEO ON", "VIDEO OFF"),
    *("BTCPP4", "<root/>", PLAN, "maltcp://127.0.0.1:1/MRS"),
)
"""Texts that mean something to a rover."""
FAULTS: Final = {
    Outcome.LOST: "left without an answer",
    Outcome.UNFOUNDED: "hung up on without a reason",
    Outcome.UNEARNED: "taken though not sound",
    Outcome.INTERNAL: "answered by INTERNAL",
    Outcome.STRAY: "answers to nothing",
}
"""What must not become of a message."""
Part = tuple[Encoding, bool]
"""A provider: its encoding, and whether its rover cannot move at all, for want of odometry."""
PARTS: Final[tuple[Part, ...]] = tuple(product(Encoding, (True, False)))


@dataclass(frozen=True, slots=True)
class Found:
    """What a provider is and holds, when nobody is connected.

    Attributes:
        files: its open file descriptors, sockets included.
        look: what it says of itself.
    """

    resident_mb: float
    files: int
    look: Look


@dataclass(frozen=True, slots=True)
class Result:
    """What was found at one provider.

    Attributes:
        duration_s: how long the messages took.
        attack: what became of all that were sent, storms of sound ones included.
        unproven: commands that were admitted though no sound message asked for them.
        reached: service and operation of every message that was sound.
        before: the provider after its warm-up.
        after: the provider in the end.
    """

    duration_s: float
    attack: Attack
    unproven: frozenset[tuple[str, int]]
    reached: frozenset[tuple[str, str]]
    before: Found
    after: Found


class DeadError(Exception):
    """The provider's process ended, or hangs; the text says how."""


def measure(
    settings: Settings,
    count: int,
    seed: int,
    tell: Tell,
    prepare: Callable[[], None] = break_nothing,
    parts: Sequence[Part] = PARTS,
) -> list[Figure]:
    """Return how often a promise was broken, and what the providers gained in weight.

    Args:
        settings: of the rovers.
        count: mutated messages in all, shared out evenly.
        seed: of everything random.
        tell: called with a line on each provider.
        prepare: called in each provider's process before it starts; tests break it there.
        parts: the providers.
    """
    results, dead = [], 0
    for number, part in enumerate(parts):
        name = f"{part[0].value}, {'held' if part[1] else 'free'}"
        share = count * (number + 1) // len(parts) - count * number // len(parts)
        try:
            result = attack_one(settings, share, seed + number, part, prepare)
        except DeadError as error:
            tell(f"{name}: {error}")
            dead += 1
            continue
        results.append(result)
        tell(f"{name}: {_line(result)}")
    return _figures(results, dead, len(parts))


def attack_one(
    settings: Settings, count: int, seed: int, part: Part, prepare: Callable[[], None]
) -> Result:
    """Attack a provider with so many mutated messages.

    Raises:
        DeadError: the provider ended.
    """
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        pipe, theirs = spawn.Pipe()
        options = Options(*part, Path(folder), prepare)
        process = spawn.Process(target=serve, args=(options, settings, theirs), daemon=True)
        process.start()
        theirs.close()
        try:
            return _attacked(process.pid or 0, pipe, count, seed, part[0])
        except (EOFError, ConnectionError, TimeoutError, psutil.Error) as error:
            process.join(GRACE_S)
            raise DeadError(f"exit code {process.exitcode}: {error!r}") from error
        finally:
            pipe.close()
            process.join(GRACE_S)
            process.kill()


def _attacked(pid: int, pipe: Pipe, count: int, seed: int, encoding: Encoding) -> Result:
    proven: set[tuple[str, int]] = set()
    reached: set[tuple[str, str]] = set()

    def taken(operation: Operation, values: tuple[Any, ...]) -> None:
        reached.add((operation.service_name, operation.name))
        if values and isinstance(values[0], CommandHeader):
            proven.add((values[0].source, values[0].commandId))

    specification = mrs_specification()
    messages = Messages(specification, encoding, seed, uri := _heard(pipe), WORDS)
    codec, port = Codec(specification, encoding), MalUri.parse(uri).port
    attack = Attack(specification, codec, messages, Random(seed), port, taken)
    warm_up = round(WARM_UP * count)
    began_s = time.perf_counter()
    attack.send(warm_up)
    before = _settled(pid, pipe)
    attack.send(count - warm_up)
    duration_s = time.perf_counter() - began_s
    after = _settled(pid, pipe)
    unproven = after.look.admitted - proven
    return Result(duration_s, attack, unproven, frozenset(reached), before, after)


def _settled(pid: int, pipe: Pipe) -> Found:
    """The provider when it has noticed that everybody hung up, or after a while."""
    deadline_s = time.monotonic() + SETTLE_S
    while True:
        pipe.send(True)
        look: Look = _heard(pipe)
        if not look.open or time.monotonic() > deadline_s:
            return Found(resident_mb(pid), psutil.Process(pid).num_fds(), look)
        time.sleep(LOOK_S)


def _heard(pipe: Pipe) -> Any:
    if not pipe.poll(START_S):
        raise TimeoutError(f"nothing heard in {START_S:.0f} s")
    return pipe.recv()


def _figures(results: list[Result], dead: int, providers: int) -> list[Figure]:
    outcomes = sum((result.attack.outcomes for result in results), Counter())
    beside = f"{outcomes.total()} messages, {providers} providers"
    duration_s = sum(result.duration_s for result in results)
    rate = outcomes.total() / duration_s if results else 0.0
    reached = frozenset().union(*(result.reached for result in results))
    mutated = sum(result.attack.mutated for result in results)
    unserved = sum(result.attack.unserved for result in results)
    unproven = sum(len(result.unproven) for result in results)
    moved = sum(result.after.look.moved for result in results)
    errors = sum(result.after.look.error_count for result in results)
    kept = max((result.after.look.kept for result in results), default=0)

    def gained(value: Callable[[Found], float]) -> float:
        return max((value(each.after) - value(each.before) for each in results), default=0.0)

    grown_mb = gained(lambda found: found.resident_mb)
    files, tasks = gained(lambda found: found.files), gained(lambda found: found.look.tasks)
    kinds = (Outcome.ERROR, Outcome.CLOSED, Outcome.TAKEN, Outcome.NOT_OWED)
    must_not: dict[str, tuple[float, str]] = {
        "providers that died or hung": (dead, "providers"),
        **{text: (outcomes[outcome], "messages") for outcome, text in FAULTS.items()},
        "good clients not served": (unserved, ""),
        "motion that nobody commanded": (moved, "turns"),
        "commands that nobody gave": (unproven, ""),
        "errors in the log": (errors, "lines"),
        "files gained": (files, "files"),
        "tasks gained": (tasks, "tasks"),
    }
    limit, registered = Goal(MOST_GROWTH_MB), "a registered service keeps its own"
    return [
        Figure("fuzz: mutated messages", mutated, "messages", beside),
        Figure("fuzz: rate", rate, "1/s", "making, sending, judging and answering"),
        Figure("fuzz: operations with sound messages", len(reached), "operations", "of the MRS"),
        *(Figure(f"fuzz: {kind.value}", outcomes[kind], "messages", beside) for kind in kinds),
        *(Figure(f"fuzz: {t}", n, unit, beside, Goal(0)) for t, (n, unit) in must_not.items()),
        Figure("fuzz: memory gained", grown_mb, "MB", "since 30% of it", limit),
        Figure("fuzz: connections kept", kept, "connections", registered, Goal(MOST_SERVICES)),
    ]


def _line(result: Result) -> str:
    outcomes, look = result.attack.outcomes, result.after.look
    counts = ", ".join(f"{outcomes[kind]} {kind.name}" for kind in Outcome if outcomes[kind])
    memory = f"{result.before.resident_mb:.1f} then {result.after.resident_mb:.1f} MB"
    errors = "".join(f"\n  {error}" for error in (*look.errors, *result.unproven))
    return f"{result.duration_s:.1f} s, {counts}; {len(look.admitted)} commands; {memory}{errors}"
