"""kill -9 of a campaign's workers: every run is in the data set once, and as without kills."""

import os
import signal
import time
from collections import Counter
from contextlib import suppress
from enum import Enum, unique
from functools import partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Final

import psutil
from distributed import Client

from sim.campaign.cluster import local_cluster, results
from sim.campaign.draws import quantities
from sim.campaign.model import Campaign, Integers, Success, Variation
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.session import CampaignSession
from sim.campaign.worker import run_job
from tests.stress.findings import Findings, Log
from tests.support.figures import Figure, Goal

WORKERS: Final = 2
RUNS_PER_KILL: Final = 5
POLL_S: Final = 0.05
MAX_DURATION_S: Final = 0.5
"""At most between what calls for a kill and the kill."""


@unique
class Fault(Enum):
    """What must not be."""

    MISSING = "runs that are missing"
    DOUBLED = "runs that are there twice"
    OTHER = "runs that are other than without kills"


class Killer:
    """Kills a worker now and then, while runs come."""

    def __init__(self, kills: int, random: Random) -> None:
        self._left, self._random = kills, random
        self._until = self._next()
        self.kills = 0

    def expect(self, total: int, done: int, succeeded: int) -> None:
        """Need nothing of that."""

    def on_run(self, run: CampaignRun) -> None:
        """Kill a worker soon, if it is time."""
        self._until -= 1
        if self._until == 0 and self._left:
            self._left -= 1
            self._until = self._next()
            self._kill()

    def _next(self) -> int:
        return self._random.randint(1, RUNS_PER_KILL - 1)

    def _kill(self) -> None:
        """Kill one of the workers, which go on meanwhile, after a moment."""
        time.sleep(self._random.uniform(0.0, MAX_DURATION_S))
        while not (workers := _workers()):  # all of them start again
            time.sleep(POLL_S)
        os.kill(self._random.choice(workers), signal.SIGKILL)
        self.kills += 1


def _workers() -> list[int]:
    found = []
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child.pid)
    return found


def measure(kills: int, seed: int, log: Log, scenario: str = "to_a_goal") -> list[Figure]:
    """Return how often a promise was broken."""
    campaign = Campaign(
        title="kills",
        scenarios=(scenario,),
        runs=RUNS_PER_KILL * kills,
        vary=(Variation(key="seed", distribution=Integers((0, 1_000_000))),),
        criteria=(Success(success=0.5),),
    )
    killer = Killer(kills, Random(seed))
    spared = Killer(0, Random(seed))
    found = Findings(log)
    with TemporaryDirectory() as folder:
        with local_cluster(WORKERS) as client:
            disturbed = _play(client, campaign, Path(folder, "disturbed"), killer)
            calm = _play(client, campaign, Path(folder, "calm"), spared)
        counts = Counter(disturbed.numbers())
        digests = dict(zip(calm.numbers(), calm.frame("digest")["digest"], strict=True))
        for run in calm.numbers():
            if counts[run] != 1:
                found.add(Fault.DOUBLED if counts[run] else Fault.MISSING, run)
        for run, digest in zip(
            disturbed.numbers(), disturbed.frame("digest")["digest"], strict=True
        ):
            if digests[run] != digest:
                found.add(Fault.OTHER, run)
    over = f"{killer.kills} kills, seed {seed}"
    return [
        Figure("campaign kills: kills", killer.kills, "", over, Goal(kills, at_least=True)),
        Figure("campaign kills: runs", len(counts), "runs", over),
        *found.figures("campaign kills", Fault, over),
    ]


def _play(client: Client, campaign: Campaign, folder: Path, killer: Killer) -> RunTable:
    runs = RunTable(folder, quantities(campaign))
    CampaignSession(campaign, runs, partial(results, client, run_job), killer).run_missing()
    return runs
