"""Plays the runs of a campaign that are missing, then keeps what failed ones leave.

A run costs less than what it would leave; so it is told by its row, until it fails. Failed runs are
played once more, where the others were, and all is kept.
"""

import io
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from itertools import islice
from math import ceil
from pathlib import Path
from shutil import rmtree
from typing import Final, Protocol

from executive.settings import SettingsError
from sim.campaign.draws import Draw, draw, quantities
from sim.campaign.model import Campaign, Until
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.verdict import clopper_pearson
from sim.campaign.worker import Job, JobFailed, JobResult, RunArtifacts, fingerprint
from sim.scenario.reading import SUFFIXES

WRITE_EVERY_S: Final = 10.0
WRITE_EVERY: Final = 1000
"""Runs are written after so many seconds or runs, whichever comes first."""
GROWTH: Final = 1.25
"""By how much a campaign without a fixed number of runs grows at a time, at least."""
FOLDER: Final = "failed"
"""Below the folder of a campaign: a folder for each of its failed runs."""
DIGEST: Final = "digest.txt"
"""In such a folder: the digest of the run that left it."""

Play = Callable[[Iterable[Job]], Iterator[JobResult | JobFailed]]
"""Plays jobs, in whatever order."""


class ProgressListener(Protocol):
    """Who hears how a campaign goes."""

    def expect(self, total: int, done: int, succeeded: int) -> None:
        """Hear how many runs there are to be, and how many there are."""

    def played(self, run: CampaignRun) -> None:
        """Hear of one more run."""


class ArtifactListener(Protocol):
    """Who hears how the keeping of failed runs goes."""

    def keep(self, total: int) -> None:
        """Hear how many failed runs there are to be kept."""

    def kept(self) -> None:
        """Hear that one more is."""


def job_of(drawn: Draw) -> Job:
    """Return what a worker is given to play a run."""
    scenario = drawn.scenario
    if scenario.endswith(SUFFIXES):
        scenario = str(Path(scenario).resolve())  # workers may be started elsewhere
    return Job(drawn.run, scenario, drawn.changes, fingerprint(drawn.scenario))


class CampaignSession:
    """One campaign and its data set.

    Args:
        campaign: what is played.
        runs: where it is written, with what is there already.
        play: plays jobs.
        watcher: hears how it goes.
        clock: seconds from anywhere, for how often runs are written.
    """

    def __init__(
        self,
        campaign: Campaign,
        runs: RunTable,
        play: Play,
        watcher: ProgressListener,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._campaign, self._runs = campaign, runs
        self._play, self._watcher, self._clock = play, watcher, clock
        runs.numbers()  # refuses a run that is there twice
        self._holds: dict[int, bool] = runs.frame("holds")["holds"].to_dict()

    def to_the_end(self) -> None:
        """Play all runs that are missing.

        Raises:
            SettingsError: a run cannot be played with what was drawn for it.
        """
        wanted = self._campaign.runs
        if isinstance(wanted, int):
            self._play_up_to(wanted)
            return
        total = self._whole(wanted.at_least, wanted)
        self._play_up_to(total)
        while (total := self._next(wanted, total)) > 0:
            self._play_up_to(total)

    def _next(self, until: Until, total: int) -> int:
        """Return up to how many runs to go on; 0 if it is known well enough.

        It depends on how the runs before end, and on nothing else: a campaign has the same runs
        wherever and however often it was interrupted.
        """
        kept = sum(self._holds[run] for run in range(total))
        interval = clopper_pearson(kept, total, until.confidence)
        following = self._whole(ceil(total * GROWTH), until)
        known = interval.high - interval.low <= until.until
        return 0 if known or following <= total else following

    def _whole(self, total: int, until: Until) -> int:
        """Return a number of runs, up to the most, that has all combinations as often."""
        each = self._campaign.combinations
        return min(ceil(total / each), until.most // each) * each

    def _play_up_to(self, total: int) -> None:
        missing = [run for run in range(total) if run not in self._holds]
        done = [self._holds[run] for run in range(total) if run in self._holds]
        self._watcher.expect(total, len(done), sum(done))
        given: dict[int, Draw] = {}
        fresh: list[CampaignRun] = []
        written_s = self._clock()
        try:
            for result in self._play(self._jobs(missing, given)):
                run = self._run(result, given.pop(result.run))
                fresh.append(run)
                self._holds[run.run] = run.holds
                self._watcher.played(run)
                now_s = self._clock()
                if len(fresh) >= WRITE_EVERY or now_s - written_s >= WRITE_EVERY_S:
                    self._write(fresh)
                    written_s = now_s
        finally:
            self._write(fresh)

    def _jobs(self, missing: Iterable[int], given: dict[int, Draw]) -> Iterator[Job]:
        for number in missing:
            given[number] = draw(self._campaign, number)
            yield job_of(given[number])

    def _run(self, result: JobResult | JobFailed, drawn: Draw) -> CampaignRun:
        if isinstance(result, JobFailed):
            raise SettingsError(
                f"run {result.run} ({drawn.command}) cannot be played: {result.why}"
            )
        names = [each.name for each in quantities(self._campaign)]
        return CampaignRun(
            **{each.name: getattr(result, each.name) for each in fields(JobResult)},
            scenario=drawn.scenario,
            varied=dict(zip(names, drawn.values, strict=True)),
            command=drawn.command,
        )

    def _write(self, fresh: list[CampaignRun]) -> None:
        """Write what is not written yet; where that fails, or Ctrl-C cuts it short, it stays."""
        self._runs.add(fresh)
        fresh.clear()


def keep_failed(
    campaign: Campaign,
    runs: RunTable,
    play: Callable[[Iterable[Job]], Iterator[RunArtifacts | JobFailed]],
    folder: Path,
    most: int,
    watcher: ArtifactListener,
) -> list[int]:
    """Keep what failed runs leave, of those that are not kept yet.

    Args:
        campaign: that they are of.
        runs: all of it.
        play: plays jobs, in whatever order.
        folder: of the campaign.
        most: how many are kept, the first.
        watcher: hears how it goes.

    Returns:
        The runs that were not alike bit for bit when they were played once more.

    Raises:
        SettingsError: a run cannot be played any more, or not be written.
    """
    digests = {run.run: run.digest for run in islice(runs.read(failed=True), most)}
    missing = [run for run in digests if not folder_of(folder, run).exists()]
    watcher.keep(len(missing))
    unlike = []
    for result in play(job_of(draw(campaign, run)) for run in missing):
        if isinstance(result, JobFailed):
            raise SettingsError(f"run {result.run} cannot be played once more: {result.why}")
        if result.digest != digests[result.run]:
            unlike.append(result.run)
        _unpack(result, folder_of(folder, result.run))
        watcher.kept()
    return sorted(unlike)


def folder_of(folder: Path, run: int) -> Path:
    """Return where a failed run is kept, below the folder of its campaign."""
    return folder / FOLDER / f"run-{run:06d}"


def is_kept(folder: Path, run: CampaignRun) -> bool:
    """Return whether what a failed run left is kept, alike bit for bit."""
    digest = folder_of(folder, run.run) / DIGEST
    return digest.exists() and digest.read_text(encoding="utf-8") == run.digest


def _unpack(kept: RunArtifacts, place: Path) -> None:
    """Write what a run left into a folder, which is there as a whole or not at all."""
    unfinished = place.with_suffix(".unfinished")
    rmtree(unfinished, ignore_errors=True)
    try:
        with zipfile.ZipFile(io.BytesIO(kept.archive)) as files:
            files.extractall(unfinished)
        (unfinished / DIGEST).write_text(kept.digest, encoding="utf-8")
        unfinished.rename(place)
    except OSError as error:
        raise SettingsError(f"{place}: cannot be written ({error.strerror})") from error
