"""Executes the runs of a campaign by Dask: on the cores of this computer, or on a cluster.

Scheduling, retries after a lost worker and transport are Dask's. The scheduler has at most
`IN_FLIGHT` runs at once, so that neither it nor the client grows with the campaign.
"""

import logging
import os
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from multiprocessing import resource_tracker
from typing import Any, Final, TypeVar

import click
import dask
from distributed import Client, KilledWorker, LocalCluster, as_completed

from executive.values.reports import printable
from sim.campaign.worker import Software, software

J = TypeVar("J")
R = TypeVar("R")

IN_FLIGHT: Final = 1000
CONNECT_S: Final = 15.0
LOCAL: Final[dict[str, Any]] = {
    # Each kill of a worker counts against all runs that it had; only a run that kills its worker
    # every time must not be retried forever.
    "distributed.scheduler.allowed-failures": 5,
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    "distributed.admin.tick.limit": "1h",
    # Overhead of a worker. By default Dask would also release memory after each run.
    "distributed.nanny.pre-spawn-environ": {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1},
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.profile.enabled": False,
}


class ClusterError(Exception):
    """The cluster cannot be used, or is lost; the text gives the cause and the remedy."""


@contextmanager
def local_cluster(jobs: int) -> Iterator[Client]:
    """Yield a client of workers on this computer, each a process with one thread.

    All ports are on loopback; no file or process remains.

    Raises:
        KeyboardInterrupt: by Ctrl-C, after the start: a half-started cluster cannot be closed.
    """
    with ExitStack() as stack:
        with _interrupted_later():
            client = stack.enter_context(_started(jobs))
        yield client


@contextmanager
def _started(jobs: int) -> Iterator[Client]:
    with (
        tempfile.TemporaryDirectory(prefix="rover-campaign-") as scratch,
        dask.config.set({**LOCAL, "temporary-directory": scratch}),
        _quiet(),
        LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            local_directory=scratch,
            silence_logs=logging.CRITICAL,
            preload=["sim.campaign.worker"],
            env={"DASK_LOGGING__DISTRIBUTED": "critical"},
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


@contextmanager
def cluster_at(address: str) -> Iterator[Client]:
    """Yield a client of the cluster with a scheduler at an address, tcp:// or tls://.

    Raises:
        ClusterError: no scheduler answers, or a worker's software differs from this process's.
    """
    if not address.startswith(("tcp://", "tls://")):
        raise ClusterError(f"{address!r} is no address of a scheduler, as tcp://HOST:8786")
    with _quiet():
        try:
            client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError, TypeError) as error:
            why = printable(" ".join(str(error).split()))
            raise ClusterError(f"no Dask scheduler answers at {address}: {why}") from error
        with client:
            _check_workers(client)
            yield client


def results(
    client: Client, play: Callable[[J], R], jobs: Iterable[J], in_flight: int = IN_FLIGHT
) -> Iterator[R]:
    """Execute jobs and yield their results, in the order of completion.

    Raises:
        ClusterError: a job failed, or killed each of its workers, or the scheduler is lost.
    """
    waiting = iter(jobs)
    given: dict[Any, J] = {}
    running = as_completed(with_results=True, raise_errors=False, loop=client.loop)

    def submit(maximum: int) -> None:
        chunk = list(islice(waiting, maximum))
        futures = client.map(play, chunk, pure=False) if chunk else []
        given.update((future.key, job) for future, job in zip(futures, chunk, strict=True))
        running.update(futures)

    try:
        submit(in_flight)
        for batch in running.batches():
            for future, result in batch:
                job = given.pop(future.key)
                if future.status != "finished":
                    raise _failure(future, job, result)
                yield result
            submit(len(batch))
    finally:
        running.clear()


def _failure(future: Any, job: object, result: Any) -> Exception:
    """Return the exception for a job without a result."""
    if future.status in ("cancelled", "lost"):
        return ClusterError("the scheduler is lost")
    error = result[1] if isinstance(result, tuple) else result
    if isinstance(error, KilledWorker):
        return ClusterError(f"{job} killed each of its workers")
    return ClusterError(f"{job} failed: {error!r}")


def _check_workers(client: Client) -> None:
    """Check that all workers have the software of this process; each job checks later ones.

    Raises:
        ClusterError: one has none, or another version.
    """
    ours = software()
    found = client.run(software, on_error="return")
    if not found:
        click.echo("no worker connected yet; waiting for one", err=True)
    for worker, theirs in found.items():
        if not isinstance(theirs, Software):
            raise ClusterError(
                f"worker {worker} cannot play runs ({theirs!r}): it needs {ours}, with the extras"
                " sim and campaign"
            )
        if ours.differences(theirs):
            raise ClusterError(f"worker {worker} has {ours.differences(theirs)}")


@contextmanager
def _interrupted_later() -> Iterator[None]:
    """Hold Ctrl-C back, also from processes and threads that are started inside."""
    received: list[int] = []
    resource_tracker.ensure_running()  # it would pass the signal on to them
    before = signal.signal(signal.SIGINT, lambda number, _: received.append(number))
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        signal.signal(signal.SIGINT, before)
        if received:
            raise KeyboardInterrupt


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the log of Dask on the terminal, which reports each lost worker."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client", "asyncio")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))
