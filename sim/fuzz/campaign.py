"""One provider, so many messages: what became of them, and of the provider."""

import multiprocessing
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from random import Random
from typing import Any, Final

import psutil

from adapters.mal.attribute_codec import Encoding
from adapters.mal.codec import Codec
from adapters.mal.connection import MalUri
from adapters.mal.specification import Operation
from adapters.mrs.specification import mrs_specification
from adapters.mrs.types import CommandHeader
from executive.settings import Settings
from sim.fuzz.attack import Attack
from sim.fuzz.judge import Outcome
from sim.fuzz.messages import Messages
from sim.fuzz.target import FILE, Look, Options, serve

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
