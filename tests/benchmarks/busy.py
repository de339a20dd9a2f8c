"""Motions of a simulated rover in real time beside busy loops, with raised priority and without."""

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from math import pi
from typing import Final

from adapters.mrs.ground import CommandOutcome, MrsClient
from executive.commands import Request
from executive.commands.catalogue import MoveForward, Resume, RotateBy
from tests.support.figures import Figure
from tests.support.ground import call_ground, carry_out, until_located
from tests.support.processes import LISTENS
from tests.support.victims import workplace

ROUND: Final[Sequence[Request]] = (MoveForward(0.6), RotateBy(pi / 2))
LOOP: Final = "while True: pass"
BELOW: Final = 1
"""Nice value that the processes leave as it is: one that was set outside."""
RESUMES: Final = 100


def measure(loops: int, motions: int, log: Callable[[str], None]) -> list[Figure]:
    """Drive without busy loops and beside them.

    Raises:
        ChildError: a process ended by itself.
    """
    figures = []
    for priority in (True, False):
        if not priority:
            os.nice(BELOW - os.nice(0))
        for number in (0, loops):
            ends, resumes = _drive(number, motions, log)
            name = f"{number} loops, {'raised priority' if priority else 'equal priority'}"
            reasons = ", ".join(f"{each} {count}" for each, count in sorted(ends.items()))
            beside = f"{reasons}; resumes refused in a row: {resumes}; {os.cpu_count()} cores"
            figures.append(Figure(f"EXECUTED with {name}", ends["EXECUTED"], "motions", beside))
            log(f"{name}: {beside}, load {os.getloadavg()[0]:.1f}")
    return figures


@contextmanager
def _busy(loops: int) -> Iterator[None]:
    children = [subprocess.Popen([sys.executable, "-c", LOOP]) for _ in range(loops)]
    try:
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()


def _drive(loops: int, motions: int, log: Callable[[str], None]) -> tuple[Counter[str], int]:
    """Return the number of each end, and the maximum number of resumes refused in a row."""
    ends, refusals = Counter[str](), 0
    with workplace() as workspace:
        workspace.start("simulation", "sim.ros.process", "--world", "flat", "--camera", "off")
        data = workspace.folder / "data"
        executive = workspace.start(
            "executive", "adapters.onboard.process", "--port", 0, "--data", data
        )
        uri = executive.wait(LISTENS)[1]
        until_located(uri)
        with _busy(loops):
            for index in range(motions):
                (outcome,) = carry_out(uri, ROUND[index % len(ROUND)])
                ends[_end(outcome)] += 1
                if not outcome.executed:
                    log(f"  {outcome.refusal or outcome.reports[-1].text}")
                    refusals = max(refusals, call_ground(uri, _resume))
                workspace.check()
    return ends, refusals


def _end(outcome: CommandOutcome) -> str:
    reason = outcome.reports[-1].reason if outcome.reports else None
    return "EXECUTED" if outcome.executed else "refused" if reason is None else reason.name


async def _resume(client: MrsClient) -> int:
    """Resume; return how often it was refused."""
    for refused in range(RESUMES):
        with suppress(TimeoutError):
            if (await client.run(client.command(Resume()))).executed:
                return refused
    return RESUMES
