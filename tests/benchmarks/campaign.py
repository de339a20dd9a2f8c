"""What it costs to have Dask play the runs of a campaign, and what 100,000 runs leave in memory."""

import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final

import psutil

from sim.campaign.cluster import local_cluster, results
from sim.campaign.draws import draw
from sim.campaign.model import Campaign, Integers, Interval, Success, Uniform, Variation
from sim.campaign.reading import campaign_path
from sim.campaign.runs import CampaignRun
from sim.campaign.session import CampaignSession, open_output
from sim.campaign.worker import Job, JobFailed, JobResult, fingerprint, run_job
from sim.scenario.outcome import RunMetrics
from tests.support.figures import Figure, Goal

SCENARIO: Final = "motion_goal"
ROUNDS: Final = 3
WORKERS: Final = 2
DECILES: Final = 10
MIB: Final = 2**20
_NOTHING: Final = RunMetrics(
    duration_s=1.0,
    true_error_m=0.0,
    true_error_rad=0.0,
    distance_m=1.0,
    energy_j=1.0,
    detection_s=None,
    stopping_m=None,
    contacts=None,
    executed=1,
    failed=0,
    false_executed=0,
    reasons=(),
)


def measure(runs: int, trivial: int, log: Callable[[str], None]) -> list[Figure]:
    """Return throughput beside that of a pool of processes, and the cost of many runs."""
    return [*_throughput(runs, log), *_many(trivial, log)]


def _campaign(runs: int) -> Campaign:
    return Campaign(
        title="benchmark",
        scenarios=(SCENARIO,),
        runs=runs,
        vary=(
            Variation(key="seed", distribution=Integers((0, 1_000_000))),
            Variation(key="world.friction", distribution=Uniform(Interval(0.45, 0.75))),
        ),
        criteria=(Success(success=0.5),),
    )


def _throughput(runs: int, log: Callable[[str], None]) -> Iterator[Figure]:
    """Play the same runs by Dask and by a pool, in turn."""
    campaign, mark = _campaign(runs), fingerprint(SCENARIO)
    jobs = [Job(run, SCENARIO, draw(campaign, run).changes, mark) for run in range(runs)]
    warm = jobs[: 2 * WORKERS]
    pools: list[float] = []
    ones: list[float] = []
    twos: list[float] = []
    digests: set[str] = set()

    def rate(played: Iterator[JobResult | JobFailed], to: list[float]) -> None:
        began_s = time.perf_counter()
        message = sorted(played, key=lambda result: result.run)
        to.append(runs / (time.perf_counter() - began_s))
        found = [result.digest for result in message if isinstance(result, JobResult)]
        assert len(found) == runs, f"{len(found)} of {runs} runs were played"
        digests.add(repr(found))

    with (
        local_cluster(1) as one,
        local_cluster(WORKERS) as two,
        multiprocessing.get_context("spawn").Pool(WORKERS) as pool,
    ):
        list(results(one, run_job, warm))
        list(results(two, run_job, warm))
        list(pool.imap_unordered(run_job, warm))
        for number in range(1, ROUNDS + 1):
            log(f"campaign: {runs} runs by a pool, by {WORKERS} workers and by one,"
                 f" {number} of {ROUNDS} ...")  # fmt: skip
            rate(pool.imap_unordered(run_job, jobs), pools)
            rate(results(two, run_job, jobs), twos)
            rate(results(one, run_job, jobs), ones)
    over = f"{runs} runs of {SCENARIO}, {ROUNDS} times in turn"
    beside = median(two / pool for two, pool in zip(twos, pools, strict=True))
    scaling = median(two / one for two, one in zip(twos, ones, strict=True))
    yield Figure("campaign, two workers", median(twos), "runs/s", over)
    yield Figure("campaign, Dask over a pool", beside, "ratio", over, Goal(0.9, at_least=True))
    yield Figure("campaign, two workers over one", scaling, "ratio", over, Goal(1.8, at_least=True))
    yield Figure("campaign, different results", len(digests) - 1, "", over, Goal(0.0))


def play_nothing(job: Job) -> JobResult:
    """Play a run that takes no time."""
    return JobResult(job.run, 0, _NOTHING, True, (), f"{job.run:064x}", 0.0)


class _Clocked:
    """Keeps when each tenth of the runs was done, and the greatest memory."""

    def __init__(self, total: int) -> None:
        self._every = total // DECILES
        self._process = psutil.Process()
        self._done = 0
        self.times_s = [time.perf_counter()]
        self.max_octets = 0

    def expect(self, total: int, done: int, succeeded: int) -> None:
        """Begin."""
        self.times_s = [time.perf_counter()]

    def on_run(self, run: CampaignRun) -> None:
        """Count one more."""
        self._done += 1
        if self._done % 500 == 0:
            self.max_octets = max(self.max_octets, self._process.memory_info().rss)
        if self._done % self._every == 0:
            self.times_s.append(time.perf_counter())


def _many(runs: int, log: Callable[[str], None]) -> Iterator[Figure]:
    """Play runs that take no time, whole: drawn, given to workers, written."""
    log(f"campaign: {runs} runs of no duration ...")
    clocked = _Clocked(runs)
    with tempfile.TemporaryDirectory() as folder, local_cluster(WORKERS) as client:
        campaign = _campaign(runs)
        data = open_output(Path(folder), campaign, campaign_path("normal"), resume=True)
        CampaignSession(
            campaign, data, partial(results, client, play_nothing), clocked
        ).run_missing()
        written = len(set(data.numbers()))
    took_s = [after - before for before, after in pairwise(clocked.times_s)]
    over = f"{runs} runs that take no time, scheduler and client in one process"
    yield Figure("campaign, runs of no duration", runs / sum(took_s), "runs/s", over)
    yield Figure(
        "campaign, scheduler and client", clocked.max_octets / MIB, "MiB", over, Goal(500.0)
    )
    yield Figure(
        "campaign, rate of the last tenth over the first",
        took_s[0] / took_s[-1],
        "ratio",
        over,
        Goal(0.9, at_least=True),
    )
    yield Figure("campaign, runs in the data set", written, "runs", over, Goal(runs, at_least=True))
