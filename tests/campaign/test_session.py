"""Every run once, in the data set, whatever interrupts a campaign."""

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from executive.settings import SettingsError
from sim.campaign.draws import quantities
from sim.campaign.model import Campaign, Until
from sim.campaign.reading import campaign_path, load_campaign
from sim.campaign.runs import FOLDER, CampaignRun, RunTable
from sim.campaign.session import FILE, CampaignSession, Play, open_output, sole_writer
from sim.campaign.worker import Job, JobFailed, JobResult, fingerprint, run_job
from tests.campaign.conftest import Write
from tests.campaign.test_verdict import FIGURES


class Player:
    """Plays no physics: every third run fails; Ctrl-C comes after so many."""

    def __init__(self, maximum: int = 10**9) -> None:
        self.played: list[int] = []
        self._maximum = maximum

    def __call__(self, jobs: Iterable[Job]) -> Iterator[JobResult | JobFailed]:
        waiting = list(jobs)
        for job in sorted(waiting, key=lambda job: job.run * 7 % 11):  # in whatever order
            if len(self.played) == self._maximum:
                raise KeyboardInterrupt
            self.played.append(job.run)
            yield JobResult(job.run, 1, FIGURES, job.run % 3 > 0, (), f"digest {job.run}", 0.4)


class Watcher:
    def __init__(self) -> None:
        self.reported: list[tuple[int, int, int]] = []
        self.runs: list[CampaignRun] = []

    def expect(self, total: int, done: int, succeeded: int) -> None:
        self.reported.append((total, done, succeeded))

    def on_run(self, run: CampaignRun) -> None:
        self.runs.append(run)


@pytest.fixture
def campaign(write: Write) -> Campaign:
    fingerprint.cache_clear()  # as in a process of its own
    return load_campaign(write())


def play(campaign: Campaign, player: Play, *, resume: bool = False) -> tuple[RunTable, Watcher]:
    runs = open_output(Path("out"), campaign, campaign_path("mine.yaml"), resume=resume)
    watcher = Watcher()
    CampaignSession(campaign, runs, player, watcher).run_missing()
    return runs, watcher


def test_runs_are_read_as_they_were_written(campaign: Campaign) -> None:
    runs, watcher = play(campaign, Player())
    assert list(runs.read()) == sorted(watcher.runs, key=lambda run: run.run)
    assert list(runs.read(failed=True)) == [run for run in runs.read() if not run.passed]
    first = next(iter(runs.read()))
    assert set(first.varied) == {each.name for each in quantities(campaign)}
    assert first.command.startswith(f"rover scenario {Path('short.yaml').resolve()} --set ")


def test_an_interrupted_campaign_continues_and_has_every_run_once(campaign: Campaign) -> None:
    first = Player(maximum=5)
    with pytest.raises(KeyboardInterrupt):
        play(campaign, first)
    second = Player()
    runs, watcher = play(campaign, second, resume=True)
    assert sorted(first.played + second.played) == list(range(12))
    assert runs.numbers() == list(range(12))
    assert watcher.reported == [(12, 5, sum(run % 3 > 0 for run in first.played))]


def test_a_part_that_was_not_finished_is_none(campaign: Campaign) -> None:
    runs, _ = play(campaign, Player())
    (Path("out") / FOLDER / "00000099-000009.parquet.unfinished").write_bytes(b"PAR1")
    again, _ = play(campaign, Player(maximum=0), resume=True)
    assert again.numbers() == runs.numbers()
    assert list((Path("out") / FOLDER).glob("*.unfinished")) == []


def test_more_runs_continue_with_the_existing_ones(campaign: Campaign) -> None:
    play(campaign, Player())
    more = Player()
    runs, _ = play(replace(campaign, runs=20), more, resume=True)
    assert sorted(more.played) == list(range(12, 20))
    assert runs.numbers() == list(range(20))


def test_runs_continue_until_enough_is_known(campaign: Campaign) -> None:
    until = replace(campaign, runs=Until(until=0.15, min=20, max=10_000))
    straight, _ = play(until, Player())
    total = len(straight.numbers())
    assert 140 < total < 250  # 0.15 wide at a rate of 2/3: 4 * 1.96**2 * 2/9 / 0.15**2 = 152
    for cut in (7, 33, 120):
        folder = Path("out")
        folder.rename(f"before-{cut}")
        with pytest.raises(KeyboardInterrupt):
            play(until, Player(maximum=cut))
        again, _ = play(until, Player(), resume=True)
        assert again.numbers() == list(range(total))


def test_runs_end_at_their_maximum(campaign: Campaign) -> None:
    runs, _ = play(replace(campaign, runs=Until(until=0.001, min=10, max=37)), Player())
    assert runs.numbers() == list(range(37))


def test_combinations_are_played_as_often(write: Write) -> None:
    grid = ("{choice: [0.2, 0.4]}", "{grid: [0.1, 0.2, 0.3, 0.35, 0.4, 0.45, 0.5]}")
    campaign = load_campaign(write(grid))
    until = Until(until=0.3, min=10, max=10_000)
    runs, _ = play(replace(campaign, runs=until), Player())
    assert len(runs.numbers()) % 7 == 0
    assert 20 < len(runs.numbers()) < 100
    Path("out").rename("before")
    runs, _ = play(replace(campaign, runs=replace(until, until=0.001, max=37)), Player())
    assert len(runs.numbers()) == 35


def test_runs_are_written_as_they_complete(campaign: Campaign) -> None:
    runs = open_output(Path("out"), campaign, campaign_path("mine.yaml"), resume=False)
    times_s = iter(range(0, 1000, 3))
    watcher = Watcher()
    CampaignSession(campaign, runs, Player(), watcher, lambda: float(next(times_s))).run_missing()
    assert len(runs.parts) == 3
    assert runs.numbers() == list(range(12))


def test_a_non_empty_folder_is_not_written_to(campaign: Campaign) -> None:
    play(campaign, Player())
    with pytest.raises(SettingsError, match="out is not empty: --resume continues it"):
        play(campaign, Player())
    Path("out", FILE).unlink()
    for resume in (False, True):
        with pytest.raises(SettingsError, match="out is not empty: it has no campaign"):
            play(campaign, Player(), resume=resume)


@pytest.mark.parametrize("interrupted", [False, True])
def test_runs_that_could_not_be_written_are_retried(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, interrupted: bool
) -> None:
    fsync, rename = os.fsync, Path.rename
    times = iter(range(100))

    def full(file: int) -> None:
        if next(times) == 0 and not interrupted:
            raise OSError(28, "No space left on device")
        fsync(file)

    def rename_and_stop(path: Path, target: Path) -> None:
        rename(path, target)
        if next(times) == 1 and interrupted:
            raise KeyboardInterrupt

    monkeypatch.setattr("sim.campaign.session.WRITE_EVERY", 5)
    monkeypatch.setattr("os.fsync", full)
    monkeypatch.setattr(Path, "rename", rename_and_stop)
    error = KeyboardInterrupt if interrupted else SettingsError
    with pytest.raises(error):
        play(campaign, Player())
    more = Player()
    runs, _ = play(campaign, more, resume=True)
    assert runs.numbers() == list(range(12))
    assert len(more.played) == 7


def test_a_full_disk_is_one_error(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(SettingsError, match=r"out/runs: runs cannot be written \(No space left"):
        play(campaign, Player())


def test_a_folder_has_one_writer(campaign: Campaign) -> None:
    folder = Path("out")
    with sole_writer(folder):
        play(campaign, Player())
        with pytest.raises(SettingsError, match="another campaign writes in out"):
            sole_writer(folder).__enter__()
    with sole_writer(folder):
        play(campaign, Player(maximum=0), resume=True)
    Path("other").mkdir()
    Path("other", "file").touch()
    with sole_writer(Path("other")), pytest.raises(SettingsError, match="it has no campaign"):
        open_output(Path("other"), campaign, campaign_path("mine.yaml"), resume=True)
    assert [each.name for each in Path("other").iterdir()] == ["file"]


def test_a_run_that_is_there_twice_is_refused(campaign: Campaign) -> None:
    runs, _ = play(campaign, Player())
    runs.add(list(runs.read())[3:5])  # as another process did
    with pytest.raises(SettingsError, match="run 3 is duplicate; begin in a new --out"):
        play(campaign, Player(), resume=True)


@pytest.mark.parametrize(
    ("file", "old", "new", "why"),
    [
        ("mine.yaml", "seed: 3", "seed: 4", "the varied quantities have changed"),
        ("mine.yaml", "[0.45, 0.75]", "[0.45, 0.7]", "the varied quantities have changed"),
        ("short.yaml", "distance: 0.4", "distance: 0.3", "a scenario has changed"),
        ("out/campaign.json", '"code": "', '"code": "f', "the software has changed: code"),
        ("out/campaign.json", "{", "", "campaign.json is not a campaign's file"),
    ],
)
def test_another_campaign_does_not_continue(
    campaign: Campaign, file: str, old: str, new: str, why: str
) -> None:
    play(campaign, Player())
    text = Path(file).read_text()
    assert old in text
    Path(file).write_text(text.replace(old, new, 1))
    fingerprint.cache_clear()  # as in another process
    with pytest.raises(SettingsError, match=why):
        play(load_campaign("mine.yaml"), Player(), resume=True)


def test_a_scenario_edited_during_the_campaign_is_not_mixed_in(campaign: Campaign) -> None:
    text = Path("short.yaml").read_text()

    def edit(jobs: Iterable[Job]) -> Iterator[JobResult | JobFailed]:
        for job in jobs:
            yield run_job(job)
            Path("short.yaml").write_text(text.replace("duration: 4", "duration: 5"))

    with pytest.raises(SettingsError, match=r"run 1 .* another version of scenario "):
        play(campaign, edit)
    assert RunTable(Path("out"), quantities(campaign)).numbers() == [0]
    Path("short.yaml").write_text(text)
    play(campaign, lambda jobs: map(run_job, list(jobs)[:1]), resume=True)


def test_a_change_of_what_must_hold_is_none(campaign: Campaign) -> None:
    play(campaign, Player())
    other = Path("mine.yaml").read_text().replace("success: 0.2", "success: 0.9")
    Path("mine.yaml").write_text(other)
    play(load_campaign("mine.yaml"), Player(maximum=0), resume=True)


def test_a_run_that_cannot_be_played_ends_the_campaign(campaign: Campaign) -> None:
    def refuse(jobs: Iterable[Job]) -> Iterator[JobResult | JobFailed]:
        for job in jobs:
            yield JobFailed(job.run, "on there: no such world")

    runs = open_output(Path("out"), campaign, campaign_path("mine.yaml"), resume=False)
    with pytest.raises(SettingsError, match=r"run 0 \(rover scenario .*: on there: no such world"):
        CampaignSession(campaign, runs, refuse, Watcher()).run_missing()
