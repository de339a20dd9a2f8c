"""Wrong messages by the million against a living provider of the MRS: does anything give way?"""

import multiprocessing
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from multiprocessing.connection import Connection as Pipe
from multiprocessing.process import BaseProcess
from pathlib import Path
from random import Random
from typing import Any, Final

from adapters.mal import Codec, Encoding, MalUri, Operation
from adapters.mrs.fleet.directory_service import MAX_SERVICES
from adapters.mrs.spec import CommandHeader, mrs_specification
from executive.settings import Settings
from tests.stress.findings import Log
from tests.stress.fuzzing import WARM_UP, break_nothing
from tests.stress.mal_attack import Attack, Outcome
from tests.stress.mal_messages import Messages
from tests.stress.mal_target import FILE, Options, Sample, serve
from tests.support.figures import Figure, Goal

START_S: Final = 60.0
SETTLE_S: Final = 5.0
POLL_S: Final = 0.2
GRACE_S: Final = 5.0
MAX_GROWTH_MB: Final = 5.0
PLAN: Final = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
<RotateBy angle="0.5"/><MoveForward distance="0.5"/></Sequence></BehaviorTree></root>"""
TOKENS: Final = (
    *("", "*", "MOE", "MOPS", "jackal", "all", "append", "replace", "POS_X", "BATERY_VOLTAGE"),
    *(FILE, "pictures", "/", "../secret", "x" * 300, "VIDEO ON", "VIDEO OFF"),
    *("BTCPP4", "<root/>", PLAN, "maltcp://127.0.0.1:1/MRS"),
)
"""Texts that mean something to a rover."""
ALLOWED: Final = (Outcome.ERROR, Outcome.CLOSED, Outcome.TAKEN, Outcome.NOT_OWED)
"""What may become of a message."""
Part = tuple[Encoding, bool]
"""A provider: its encoding, and whether its rover cannot move at all, for want of odometry."""
PARTS: Final[tuple[Part, ...]] = tuple(product(Encoding, (True, False)))


@dataclass(frozen=True, slots=True)
class Result:
    """What was found at one provider.

    Attributes:
        duration_s: how long the messages took.
        attack: what became of all that were sent, storms of sound ones included.
        proven: source and number of each command that a sound message asked for.
        reached: service and operation of every message that was sound.
        before, after: the provider after its warm-up, and in the end; nobody is connected.
    """

    duration_s: float
    attack: Attack
    proven: set[tuple[str, int]]
    reached: set[tuple[str, str]]
    before: Sample
    after: Sample

    @property
    def unproven(self) -> frozenset[tuple[str, int]]:
        """The commands that were admitted though no sound message asked for them."""
        return self.after.admitted - self.proven

    def __str__(self) -> str:
        outcomes, poll = self.attack.outcomes, self.after
        counts = ", ".join(f"{outcomes[kind]} {kind.name}" for kind in Outcome if outcomes[kind])
        memory = f"{self.before.resident_mb:.1f} then {poll.resident_mb:.1f} MB"
        errors = "".join(f"\n  {error}" for error in (*poll.errors, *self.unproven))
        return f"{self.duration_s:.1f} s, {counts}; {len(poll.admitted)} commands; {memory}{errors}"


def measure(
    settings: Settings,
    count: int,
    seed: int,
    log: Log,
    prepare: Callable[[], None] = break_nothing,
    parts: Sequence[Part] = PARTS,
) -> list[Figure]:
    """Return how often a promise was broken, and what the providers gained in weight.

    Args:
        settings: of the rovers.
        count: mutated messages in all, shared out evenly.
        seed: of everything random.
        log: called with a line on each provider.
        prepare: called in each provider's process before it starts; tests break it there.
        parts: the providers.
    """
    results = []
    for number, part in enumerate(parts):
        name = f"{part[0].value}, {'held' if part[1] else 'free'}"
        share = count * (number + 1) // len(parts) - count * number // len(parts)
        with _provider(settings, part, prepare) as (process, pipe):
            try:
                results.append(_attacked(pipe, share, seed + number, part[0]))
                log(f"{name}: {results[-1]}")
            except (EOFError, ConnectionError, TimeoutError) as error:
                process.join(GRACE_S)
                log(f"{name}: exit code {process.exitcode}: {error!r}")
    return _figures(results, len(parts))


@contextmanager
def _provider(
    settings: Settings, part: Part, prepare: Callable[[], None]
) -> Iterator[tuple[BaseProcess, Pipe]]:
    forking = multiprocessing.get_context("forkserver")
    forking.set_forkserver_preload([serve.__module__])  # a second of imports, once for all of them
    with tempfile.TemporaryDirectory() as folder:
        pipe, theirs = forking.Pipe()
        options = Options(*part, Path(folder), prepare)
        process = forking.Process(target=serve, args=(options, settings, theirs), daemon=True)
        process.start()
        theirs.close()
        try:
            yield process, pipe
        finally:
            pipe.close()
            process.join(GRACE_S)
            process.kill()


def _attacked(pipe: Pipe, count: int, seed: int, encoding: Encoding) -> Result:
    proven: set[tuple[str, int]] = set()
    reached: set[tuple[str, str]] = set()

    def taken(operation: Operation, values: tuple[Any, ...]) -> None:
        reached.add((operation.service_name, operation.name))
        if values and isinstance(values[0], CommandHeader):
            proven.add((values[0].source, values[0].commandId))

    specification = mrs_specification()
    messages = Messages(specification, encoding, seed, uri := _received(pipe), TOKENS)
    codec, port = Codec(specification, encoding), MalUri.parse(uri).port
    attack = Attack(specification, codec, messages, Random(seed), port, taken)
    warm_up = round(WARM_UP * count)
    began_s = time.perf_counter()
    attack.send(warm_up)
    before = _settled(pipe)
    attack.send(count - warm_up)
    duration_s = time.perf_counter() - began_s
    return Result(duration_s, attack, proven, reached, before, _settled(pipe, before))


def _settled(pipe: Pipe, before: Sample | None = None) -> Sample:
    """The provider when it has noticed that everybody hung up, or after a while.

    It has ended, too, what ran for them: no more is left than before.
    """
    deadline_s = time.monotonic() + SETTLE_S
    while True:
        pipe.send(None)
        poll: Sample = _received(pipe)
        gained = before is not None and (poll.tasks > before.tasks or poll.files > before.files)
        if not (poll.open or gained) or time.monotonic() > deadline_s:
            return poll
        time.sleep(POLL_S)


def _received(pipe: Pipe) -> Any:
    if not pipe.poll(START_S):
        raise TimeoutError(f"nothing heard in {START_S:.0f} s")
    return pipe.recv()


def _figures(results: Sequence[Result], providers: int) -> list[Figure]:
    outcomes = sum((result.attack.outcomes for result in results), Counter())
    beside = f"{outcomes.total()} messages, {providers} providers"
    rate = outcomes.total() / (sum(result.duration_s for result in results) or 1.0)
    reached = set().union(*(result.reached for result in results))

    def summed(value: Callable[[Result], float]) -> float:
        return sum(map(value, results))

    def gained(value: Callable[[Sample], float]) -> float:
        return max((value(each.after) - value(each.before) for each in results), default=0.0)

    must_not: dict[str, tuple[float, str]] = {
        "providers that died or hung": (providers - len(results), "providers"),
        **{each.value: (outcomes[each], "messages") for each in Outcome if each not in ALLOWED},
        "good clients not served": (summed(lambda each: each.attack.unserved), ""),
        "motion that nobody commanded": (summed(lambda each: each.after.moved), "turns"),
        "commands that nobody gave": (summed(lambda each: len(each.unproven)), ""),
        "errors in the log": (summed(lambda each: each.after.error_count), "lines"),
        "files gained": (gained(lambda poll: poll.files), "files"),
        "tasks gained": (gained(lambda poll: poll.tasks), "tasks"),
    }
    mutated, grown_mb = (
        summed(lambda each: each.attack.mutated),
        gained(lambda poll: poll.resident_mb),
    )
    stored = max((result.after.stored for result in results), default=0)
    limit, registered = Goal(MAX_GROWTH_MB), "a registered service keeps its own"
    return [
        Figure("fuzz: mutated messages", mutated, "messages", beside),
        Figure("fuzz: rate", rate, "1/s", "making, sending, judging and answering"),
        Figure("fuzz: operations with sound messages", len(reached), "operations", "of the MRS"),
        *(Figure(f"fuzz: {kind.value}", outcomes[kind], "messages", beside) for kind in ALLOWED),
        *(Figure(f"fuzz: {t}", n, unit, beside, Goal(0)) for t, (n, unit) in must_not.items()),
        Figure("fuzz: memory gained", grown_mb, "MB", "since 30% of it", limit),
        Figure("fuzz: connections kept", stored, "connections", registered, Goal(MAX_SERVICES)),
    ]
