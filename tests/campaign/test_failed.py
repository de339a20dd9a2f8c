"""What failed runs leave is kept, once, and is that of the run."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from shutil import copytree

import pytest

from adapters.recording.replay import replay
from executive.settings import SettingsError
from sim.campaign.draws import draw
from sim.campaign.model import Campaign
from sim.campaign.reading import load_campaign
from sim.campaign.report import write_report
from sim.campaign.runs import RunTable
from sim.campaign.session import (
    DIGEST,
    FOLDER,
    CampaignSession,
    job_of,
    open_output,
    save_failed_runs,
)
from sim.campaign.verdict import judge
from sim.campaign.worker import Job, JobFailed, JobResult, RunArtifacts, run_and_archive, run_job
from sim.scenario.model import Scenario
from sim.scenario.outcome import ScenarioResult, run_once
from sim.scenario.run import run_recorded
from tests.campaign.conftest import Write
from tests.campaign.test_session import Watcher

OUT = Path("out")
Play = Callable[[str, Scenario, Path], ScenarioResult]


class Keeper:
    def __init__(self) -> None:
        self.total = self.done = 0

    def begin_saving(self, total: int) -> None:
        self.total = total

    def on_saved(self) -> None:
        self.done += 1


@pytest.fixture
def campaign(write: Write) -> Campaign:
    return load_campaign(write(("[3, 1]", "[0, 1]"), ("runs: 12", "runs: 2")))


@pytest.fixture
def runs(campaign: Campaign) -> RunTable:
    found = open_output(OUT, campaign, Path("mine.yaml"), resume=False)
    CampaignSession(campaign, found, lambda jobs: map(played, jobs), Watcher()).run_missing()
    return found


def played(job: Job) -> JobResult | JobFailed:
    """Play a run once for all tests: the scenario of each is the same file in its folder."""
    return _played(replace(job, scenario=Path(job.scenario).name))


@cache
def _played(job: Job) -> JobResult | JobFailed:
    return run_job(job)


def here(jobs: Iterable[Job]) -> Iterator[RunArtifacts | JobFailed]:
    return map(run_and_archive, jobs)


def test_artifacts_of_failed_runs_are_stored_once(campaign: Campaign, runs: RunTable) -> None:
    failed = [run.run for run in runs.read(failed=True)]
    assert len(failed) == 2
    first = Keeper()
    assert save_failed_runs(campaign, runs, here, OUT, 1, first) == []
    assert (first.total, first.done) == (1, 1)
    stored = OUT / FOLDER / f"run-{failed[0]:06d}"
    left = {"map.png", "timeline.png", "reports.jsonl", "run.mcap", "plot.png"}
    assert left <= {path.name for path in stored.iterdir()}
    assert replay(stored / "run.mcap").difference is None
    assert any("ledger" in path.name for path in stored.rglob("*"))
    again = Keeper()
    save_failed_runs(campaign, runs, here, OUT, 100, again)
    assert again.total == 1


def test_the_report_shows_stored_runs_and_plays_only_the_missing_ones(
    campaign: Campaign, runs: RunTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    played, results = [], dict[str, ScenarioResult]()
    first = OUT / "first"

    def count(name: str, scenario: Scenario, stored: Path) -> ScenarioResult:
        """Play a run, or give the files that it had before."""
        played.append(stored.name)
        if stored.name in results:
            copytree(first / stored.name, stored, dirs_exist_ok=True)
        else:
            results[stored.name] = run_recorded(name, scenario, stored)
            copytree(stored, first / stored.name)
        return results[stored.name]

    monkeypatch.setattr("sim.campaign.report.page.run_recorded", count)
    write_report(OUT, campaign, runs, judge(campaign, runs))
    shown = sorted(played)
    repeated = (OUT / "report.html").read_text()
    save_failed_runs(campaign, runs, here, OUT, 1, Keeper())
    (stored,) = (OUT / FOLDER).iterdir()
    assert stored.name in shown
    for reported, again in (
        (runs_digest(runs, stored.name), [name for name in shown if name != stored.name]),
        ("other", shown),
    ):
        (stored / DIGEST).write_text(reported)
        played.clear()
        page = write_report(OUT, campaign, runs, judge(campaign, runs)).read_text()
        assert sorted(played) == again
        assert page == repeated


def runs_digest(runs: RunTable, folder: str) -> str:
    return next(run.digest for run in runs.read() if folder.endswith(f"-{run.run:06d}"))


def test_a_run_that_is_not_alike_is_named(campaign: Campaign, runs: RunTable) -> None:
    def other(jobs: Iterable[Job]) -> Iterator[RunArtifacts | JobFailed]:
        for job in jobs:
            found = run_and_archive(job)
            assert isinstance(found, RunArtifacts)
            yield replace(found, digest="other")

    failed = [run.run for run in runs.read(failed=True)]
    assert save_failed_runs(campaign, runs, other, OUT, 1, Keeper()) == failed[:1]


def test_a_run_that_raises_an_error_has_failed_and_the_others_continue(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(play: Play) -> Play:
        def once(name: str, scenario: Scenario, folder: Path) -> ScenarioResult:
            if scenario.seed == seed:
                raise ZeroDivisionError("by\nnothing")
            return play(name, scenario, folder)

        return once

    seed = int(draw(campaign, 1).changes[-2].value)
    monkeypatch.setattr("sim.campaign.worker.run_once", broken(run_once))
    for module in ("sim.campaign.worker", "sim.campaign.report.page"):
        monkeypatch.setattr(f"{module}.run_recorded", broken(run_recorded))
    found = open_output(OUT, campaign, Path("mine.yaml"), resume=False)
    CampaignSession(campaign, found, lambda jobs: map(run_job, jobs), Watcher()).run_missing()
    assert found.numbers() == [0, 1]
    broke = list(found.read())[1]
    assert not broke.passed
    assert broke.failed_findings[0].startswith(
        "run: expected no ZeroDivisionError, observed by nothing"
    )
    assert save_failed_runs(campaign, found, here, OUT, 100, Keeper()) == []
    stored = OUT / FOLDER / "run-000001" / "error.txt"
    assert stored.read_text().endswith("ZeroDivisionError: by\nnothing\n")
    page = write_report(OUT, campaign, found, judge(campaign, found)).read_text()
    assert "It ended with ZeroDivisionError(" in page


def test_an_error_of_the_machine_is_no_failed_run(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> ScenarioResult:
        raise OSError(28, "No space left on device")

    for function in ("run_once", "run_recorded"):
        monkeypatch.setattr(f"sim.campaign.worker.{function}", full)
    job = job_of(draw(campaign, 0))
    for reported in (run_job(job), run_and_archive(job)):
        assert isinstance(reported, JobFailed)
        assert "No space left on device" in reported.reason


def test_a_run_that_cannot_be_repeated_is_one_error(campaign: Campaign, runs: RunTable) -> None:
    def refuse(jobs: Iterable[Job]) -> Iterator[RunArtifacts | JobFailed]:
        return (JobFailed(job.run, "no such world") for job in jobs)

    with pytest.raises(SettingsError, match="cannot be repeated: no such world"):
        save_failed_runs(campaign, runs, refuse, OUT, 1, Keeper())
