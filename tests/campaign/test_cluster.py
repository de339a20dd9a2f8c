"""Runs on real clusters: alike on all of them, each run once, whatever is killed."""

import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import psutil
import pytest
from click.testing import CliRunner
from dask import config as dask_config
from distributed import Client

from sim.campaign.cluster import LOCAL, ClusterError, cluster_at, local_cluster, results
from sim.campaign.commands import campaign as command
from sim.campaign.draws import draw
from sim.campaign.model import Campaign
from sim.campaign.reading import load_campaign
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.session import CampaignSession, Play, open_output
from sim.campaign.worker import Job, JobResult, Software, fingerprint, run_job
from tests.campaign.conftest import Write
from tests.support.certificates import certified
from tests.support.processes import Running

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("executive", "trees", "adapters", "sim", "config")
ADDRESS = r"Scheduler at:\s+(t(?:cp|ls)://127.0.0.1:\d+)"
REGISTERED = "Registered to"


class Watcher:
    """Does something once there are so many runs."""

    def __init__(self, after: int = 0, act: Callable[[], None] = lambda: None) -> None:
        self._after, self._act = after, act

    def expect(self, total: int, done: int, succeeded: int) -> None:
        """Need nothing of that."""

    def on_run(self, run: CampaignRun) -> None:
        self._after -= 1
        if self._after == 0:
            self._act()


def play(campaign: Campaign, out: str, jobs: Play, watcher: Watcher) -> RunTable:
    runs = open_output(Path(out), campaign, Path("mine.yaml"), resume=True)
    CampaignSession(campaign, runs, jobs, watcher).run_missing()
    return runs


def timeless(runs: RunTable) -> list[CampaignRun]:
    """Return runs without how long they took."""
    return [replace(run, seconds=0.0) for run in runs.read()]


def pids(client: Client) -> list[int]:
    return list(client.run(os.getpid).values())


def test_runs_are_alike_without_workers_and_on_some_that_die(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setenv("TMPDIR", str(scratch))
    monkeypatch.setattr(tempfile, "tempdir", None)
    campaign = load_campaign(write(("runs: 12", "runs: 8")))
    processes = psutil.Process().children(recursive=True)
    here = timeless(play(campaign, "here", lambda jobs: map(run_job, jobs), Watcher()))
    with local_cluster(2) as client:
        victim, other = pids(client)
        for pid in (victim, other, os.getpid()):
            sockets = psutil.Process(pid).net_connections()
            assert {each.laddr.ip for each in sockets if each.status == "LISTEN"} == {"127.0.0.1"}
        killed = Watcher(2, lambda: os.kill(victim, signal.SIGKILL))
        two = timeless(play(campaign, "two", partial(results, client, run_job), killed))
    assert two == here
    assert [run.run for run in here] == list(range(8))
    assert {run.passed for run in here} == {True, False}

    assert list(scratch.iterdir()) == []
    left = [child for child in psutil.Process().children(recursive=True) if child not in processes]
    assert [child for child in left if "resource_tracker" not in " ".join(child.cmdline())] == []


def test_a_run_that_never_ends_well_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LOCAL, "distributed.scheduler.allowed-failures", 0)
    with local_cluster(1) as client:
        with pytest.raises(ClusterError, match=r"^0 failed: ZeroDivisionError\("):
            list(results(client, partial(divmod, 1), [0]))
        with pytest.raises(ClusterError, match=r"7 killed each of its workers$"):
            list(results(client, os._exit, [7]))


def test_ctrl_c_waits_until_the_cluster_can_be_closed(
    write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    write()
    happened = []

    @contextmanager
    def started(_: int) -> Iterator[None]:
        os.kill(os.getpid(), signal.SIGINT)
        happened.append("started")
        try:
            yield
        finally:
            happened.append("closed")

    monkeypatch.setattr("sim.campaign.cluster._started", started)
    status, message = rover_campaign("--jobs", "1")
    assert (status, happened) == (130, ["started", "closed"]), message
    assert "Interrupted. 0 runs are saved in out; resume with: rover campaign mine.yaml" in message


@dataclass(frozen=True, slots=True)
class Far:
    """A scheduler in a process of its own."""

    scheduler: Running
    address: str


@contextmanager
def dask(log: Path, *arguments: str, path: Path = ROOT) -> Iterator[Running]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(path))
        script = str(Path(sys.executable).with_name("dask"))
        process = Running(log, script, *arguments, cwd=log.parent)
    try:
        yield process
    finally:
        process.clean_up()


@pytest.fixture
def far(tmp_path: Path) -> Iterator[Far]:
    """Give a scheduler without workers."""
    folder = tmp_path / "far"
    folder.mkdir()
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with dask(folder / "scheduler.log", "scheduler", *options) as scheduler:
        yield Far(scheduler, scheduler.output(ADDRESS))


def test_a_cluster_is_reached_by_tls(write: Write, tmp_path: Path) -> None:
    write()
    keys = certified(tmp_path, "rover")["rover"]
    tls = {
        "distributed.comm.tls.ca-file": str(keys.authorities),
        **{
            f"distributed.comm.tls.{role}.{part}": str(path)
            for role in ("scheduler", "worker", "client")
            for part, path in (("cert", keys.certificate), ("key", keys.key))
        },
    }
    folder = tmp_path / "far"
    folder.mkdir()
    options = ("--protocol", "tls", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with pytest.MonkeyPatch.context() as patch, dask_config.set(tls):
        for key, value in tls.items():
            patch.setenv("DASK_" + key.replace(".", "__").replace("-", "_").upper(), value)
        with dask(folder / "scheduler.log", "scheduler", *options) as scheduler:
            far = Far(scheduler, scheduler.output(ADDRESS))
            assert far.address.startswith("tls://")
            with worker(far, "first"):
                status, message = rover_campaign(
                    "--scheduler", far.address, "--runs", "2", "--saved", "0"
                )
    assert status == 0, message
    assert RunTable(Path("out"), ()).numbers() == [0, 1]


@contextmanager
def worker(far: Far, name: str, path: Path = ROOT) -> Iterator[Running]:
    """Add a worker, a process of its own, to a scheduler."""
    log = far.scheduler.log.with_name(f"{name}.log")
    options = ("--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard", "--no-nanny")
    with dask(log, "worker", far.address, *options, path=path) as process:
        process.output(REGISTERED)
        yield process


def rover_campaign(*arguments: str) -> tuple[int, str]:
    """Run the command; the page of its report, which costs more than the runs, is not drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.campaign.report.write_report", lambda folder, *_: folder / "report.html")
        done = CliRunner().invoke(command, ["mine.yaml", "--out", "out", *arguments])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.output
    return done.exit_code, done.output


@pytest.mark.slow
def test_another_machine_plays_as_this_one_does(write: Write, far: Far) -> None:
    # No run fails: none is drawn.
    campaign = load_campaign(write(("[3, 1]", "[1, 0]"), ("runs: 12", "runs: 4")))
    with worker(far, "first"):
        status, message = rover_campaign("--scheduler", far.address)
        assert (status, "4 of 4" in message or "4/4" in message) == (0, True), message
        runs = RunTable(Path("out"), ())
        assert runs.numbers() == list(range(4))
        given = draw(campaign, 3)
        here = run_job(Job(3, given.scenario, given.changes, fingerprint(given.scenario)))
        assert isinstance(here, JobResult)
        assert runs.frame("digest")["digest"][3] == here.digest

        # The scheduler is lost in the middle; the rest is played here.
        far_again = ["--scheduler", far.address, "--runs", "400", "--resume"]
        with pytest.MonkeyPatch.context() as patch:
            lose = Watcher(5, lambda: far.scheduler.send(signal.SIGKILL))
            patch.setattr(
                "sim.campaign.progress.ProgressBar.on_run", lambda _, run: lose.on_run(run)
            )
            status, message = rover_campaign(*far_again)
    assert status == 2
    assert "Error: the scheduler is lost" in message
    assert "resume with: rover campaign mine.yaml --out out --resume --runs 400" in message
    stored = len(runs.numbers())
    assert 4 + 5 <= stored < 400
    status, message = rover_campaign("--jobs", "1", "--runs", str(stored + 4), "--resume")
    assert status == 0, message
    assert sorted(runs.numbers()) == sorted(set(runs.numbers()))
    assert len(runs.numbers()) == stored + 4


def test_a_missing_worker_is_reported_and_one_of_other_software_refused(
    write: Write, far: Far, tmp_path: Path
) -> None:
    load_campaign(write())
    other = tmp_path / "other"
    for package in PACKAGES:
        shutil.copytree(
            ROOT / package, other / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    with (other / "trees" / "__init__.py").open("a") as changed:
        changed.write("# another version\n")
    with pytest.MonkeyPatch.context() as patch:

        def interrupt(*_: object) -> None:
            raise KeyboardInterrupt

        patch.setattr(CampaignSession, "run_missing", interrupt)
        status, message = rover_campaign("--scheduler", far.address)
        assert status == 130
        assert "no worker connected yet; waiting for one" in message
    with worker(far, "other", other):
        status, message = rover_campaign("--scheduler", far.address, "--resume")
        assert status == 2
        assert "Error: worker tcp://127.0.0.1:" in message
        assert " has code " in message
        assert "0 runs are saved in out" in message
        with worker(far, "ours"), pytest.raises(ClusterError, match="has code"):
            cluster_at(far.address).__enter__()


def test_a_worker_that_joins_later_with_another_scenario_is_refused(write: Write) -> None:
    campaign = load_campaign(write())
    reported = run_job(Job(0, campaign.scenarios[0], (), "another"))
    assert not isinstance(reported, JobResult)
    assert "another version of scenario short.yaml" in reported.reason


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("tcp://127.0.0.1:1", "no Dask scheduler answers at tcp://127.0.0.1:1"),
        ("127.0.0.1:8786", "'127.0.0.1:8786' is no address of a scheduler, as tcp://HOST:8786"),
        ("tls://127.0.0.1:1", "no Dask scheduler answers at tls://127.0.0.1:1"),
    ],
)
def test_an_absent_scheduler_is_one_error(
    write: Write, monkeypatch: pytest.MonkeyPatch, address: str, message: str
) -> None:
    write()
    monkeypatch.setattr("sim.campaign.cluster.CONNECT_S", 0.5)
    status, reported = rover_campaign("--scheduler", address)
    assert (status, message in reported) == (2, True), reported


def test_software_fingerprint_names_the_difference() -> None:
    ours = Software("0.1.0", "abc", "3.11", "2.4.6", "4.0.1")
    assert ours.differences(ours) == ""
    other = replace(ours, code="abd", mujoco="4.0.2")
    assert ours.differences(other) == "code abd instead of abc, mujoco 4.0.2 instead of 4.0.1"
