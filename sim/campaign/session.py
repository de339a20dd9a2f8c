"""`CampaignSession` executes the missing runs of a campaign, then saves the files of failed ones.

The files of a run cost more than the run itself, so at first only its row is stored. Failed runs
are repeated on the same cluster, and all their files are saved. `open_output` creates the output
folder, or checks that the campaign in it can be resumed.
"""

import io
import json
import shutil
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from itertools import islice
from math import ceil
from pathlib import Path
from shutil import rmtree
from typing import Final, Protocol

from adapters.process import StartError, exclusive
from executive.settings import SettingsError
from sim.campaign.draws import Draw, draw, quantities
from sim.campaign.model import Campaign, Until
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.verdict import clopper_pearson
from sim.campaign.worker import (
    Job,
    JobFailed,
    JobResult,
    RunArtifacts,
    Software,
    fingerprint,
    software,
)
from sim.scenario.reading import SUFFIXES

WRITE_EVERY_S: Final = 10.0
WRITE_EVERY: Final = 1000
"""Runs are written after this time or number of runs, at the earlier of the two."""
GROWTH: Final = 1.25
"""Minimum growth factor of a campaign without a fixed number of runs."""
FOLDER: Final = "failed"
"""Subfolder of a campaign with a folder for each saved failed run."""
DIGEST: Final = "digest.txt"
"""File in such a folder with the digest of its run."""

Play = Callable[[Iterable[Job]], Iterator[JobResult | JobFailed]]
"""Executes jobs, in any order."""


class ProgressListener(Protocol):
    """Receives the progress of a campaign."""

    def expect(self, total: int, done: int, succeeded: int) -> None:
        """Called with the planned number of runs, and the existing ones."""

    def on_run(self, run: CampaignRun) -> None:
        """Called with each further run."""


class ArtifactListener(Protocol):
    """Receives the progress of saving failed runs."""

    def begin_saving(self, total: int) -> None:
        """Called with the number of failed runs to save."""

    def on_saved(self) -> None:
        """Called for each saved one."""


def job_of(drawn: Draw) -> Job:
    """Return the job of a run for a worker."""
    scenario = drawn.scenario
    if scenario.endswith(SUFFIXES):
        scenario = str(Path(scenario).resolve())  # workers may be started in another folder
    return Job(drawn.run, scenario, drawn.changes, fingerprint(drawn.scenario))


class CampaignSession:
    """One campaign and its data set.

    Args:
        runs: its data set, with the existing runs.
        play: executes jobs.
        clock: monotonic seconds, for the interval of writing.
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
        runs.numbers()  # refuses a duplicate run
        self._passed: dict[int, bool] = runs.frame("passed")["passed"].to_dict()

    def run_missing(self) -> None:
        """Execute all missing runs.

        Raises:
            SettingsError: a run cannot be executed with its drawn values.
        """
        wanted = self._campaign.runs
        if isinstance(wanted, int):
            self._play_up_to(wanted)
            return
        total = self._balanced_total(wanted.min, wanted)
        self._play_up_to(total)
        while (total := self._next_total(wanted, total)) > 0:
            self._play_up_to(total)

    def _next_total(self, until: Until, total: int) -> int:
        """Return the next total number of runs; 0 if the rate is known well enough.

        It depends only on the results of the earlier runs: a campaign has the same runs on any host
        and after any interruption.
        """
        succeeded = sum(self._passed[run] for run in range(total))
        interval = clopper_pearson(succeeded, total, until.confidence)
        following = self._balanced_total(ceil(total * GROWTH), until)
        known = interval.high - interval.low <= until.until
        return 0 if known or following <= total else following

    def _balanced_total(self, total: int, until: Until) -> int:
        """Return a number of runs, up to the maximum, with equal numbers of all combinations."""
        each = self._campaign.combinations
        return min(ceil(total / each), until.max // each) * each

    def _play_up_to(self, total: int) -> None:
        missing = [run for run in range(total) if run not in self._passed]
        done = [self._passed[run] for run in range(total) if run in self._passed]
        self._watcher.expect(total, len(done), sum(done))
        given: dict[int, Draw] = {}
        fresh: list[CampaignRun] = []
        written_s = self._clock()
        try:
            for result in self._play(self._jobs(missing, given)):
                run = self._run(result, given.pop(result.run))
                fresh.append(run)
                self._passed[run.run] = run.passed
                self._watcher.on_run(run)
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
                f"run {result.run} ({drawn.command}) cannot be executed: {result.reason}"
            )
        names = [each.name for each in quantities(self._campaign)]
        return CampaignRun(
            **{each.name: getattr(result, each.name) for each in fields(JobResult)},
            scenario=drawn.scenario,
            varied=dict(zip(names, drawn.values, strict=True)),
            command=drawn.command,
        )

    def _write(self, fresh: list[CampaignRun]) -> None:
        """Write the new runs; they stay listed if that fails or is interrupted by Ctrl-C."""
        self._runs.add(fresh)
        fresh.clear()


def save_failed_runs(
    campaign: Campaign,
    runs: RunTable,
    play: Callable[[Iterable[Job]], Iterator[RunArtifacts | JobFailed]],
    folder: Path,
    maximum: int,
    watcher: ArtifactListener,
) -> list[int]:
    """Save the files of failed runs that are not saved yet.

    Args:
        campaign: campaign of the runs.
        runs: its complete data set.
        play: executes jobs, in any order.
        folder: folder of the campaign.
        maximum: maximum number of saved runs, the first ones.
        watcher: receives the progress.

    Returns:
        The runs with a repetition that was not identical bit for bit.

    Raises:
        SettingsError: a run cannot be repeated, or not be written.
    """
    digests = {run.run: run.digest for run in islice(runs.read(failed=True), maximum)}
    missing = [run for run in digests if not folder_of(folder, run).exists()]
    watcher.begin_saving(len(missing))
    unlike = []
    for result in play(job_of(draw(campaign, run)) for run in missing):
        if isinstance(result, JobFailed):
            raise SettingsError(f"run {result.run} cannot be repeated: {result.reason}")
        if result.digest != digests[result.run]:
            unlike.append(result.run)
        _unpack(result, folder_of(folder, result.run))
        watcher.on_saved()
    return sorted(unlike)


def folder_of(folder: Path, run: int) -> Path:
    """Return the folder of a saved failed run, below the folder of its campaign."""
    return folder / FOLDER / f"run-{run:06d}"


def is_saved(folder: Path, run: CampaignRun) -> bool:
    """Return whether the files of a failed run are saved, identical bit for bit."""
    digest = folder_of(folder, run.run) / DIGEST
    return digest.exists() and digest.read_text(encoding="utf-8") == run.digest


def _unpack(artifacts: RunArtifacts, path: Path) -> None:
    """Write the files of a run into a folder, atomically."""
    unfinished = path.with_suffix(".unfinished")
    rmtree(unfinished, ignore_errors=True)
    try:
        with zipfile.ZipFile(io.BytesIO(artifacts.archive)) as files:
            files.extractall(unfinished)
        (unfinished / DIGEST).write_text(artifacts.digest, encoding="utf-8")
        unfinished.rename(path)
    except OSError as error:
        raise SettingsError(f"{path}: cannot be written ({error.strerror})") from error


FILE: Final = "campaign.json"
COPY: Final = "campaign.yaml"
LOCK: Final = "lock"


@dataclass(frozen=True, slots=True)
class CampaignFingerprint:
    """Inputs that determine the bits of all runs.

    Attributes:
        drawn: digest of its scenarios' names, its seed and its varied quantities.
        scenarios: digest of the scenarios' contents.
        software: software that began the campaign.
    """

    title: str
    drawn: str
    scenarios: str
    software: Software

    @classmethod
    def of(cls, campaign: Campaign) -> "CampaignFingerprint":
        """Return the fingerprint of a campaign with the present files and software."""
        drawn = repr((campaign.scenarios, campaign.seed, campaign.vary))
        prints = "".join(map(fingerprint, campaign.scenarios))
        return cls(campaign.title, _digest(drawn), _digest(prints), software())

    def mismatch(self, other: "CampaignFingerprint") -> str:
        """Return why another campaign's runs do not fit this one's; empty if they do."""
        if self.software != other.software:
            return f"the software has changed: {self.software.differences(other.software)}"
        if self.drawn != other.drawn:
            return "the scenarios, the seed or the varied quantities have changed"
        if self.scenarios != other.scenarios:
            return "a scenario has changed, or an asset or a world that it names"
        return ""


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Lock a folder against other campaigns; it is created if missing.

    A folder with other content is not changed: `open_output` refuses it.

    Raises:
        SettingsError: another campaign writes to it, or it cannot be written.
    """
    with ExitStack() as held:
        if (folder / FILE).is_file() or _usable(folder):
            try:
                held.enter_context(exclusive(folder, LOCK))
            except StartError as error:
                if isinstance(error.__cause__, BlockingIOError):
                    raise SettingsError(
                        f"another campaign writes in {folder}: wait for it, or choose another --out"
                    ) from error
                raise SettingsError(f"{folder}: cannot be written ({error.__cause__})") from error
        yield


def open_output(folder: Path, campaign: Campaign, file: Path, *, resume: bool) -> RunTable:
    """Return the data set in the folder of a campaign, a new one or one to resume.

    The writer must hold `sole_writer`.

    Args:
        folder: new or empty, unless the campaign is resumed.
        campaign: content of its file.
        file: the file, which is copied.
        resume: whether existing runs are reused.

    Raises:
        SettingsError: the folder cannot be used; the text gives the cause and the remedy.
    """
    identity = CampaignFingerprint.of(campaign)
    begun = (folder / FILE).is_file()
    if resume and begun:
        obstacle = _read(folder / FILE).mismatch(identity)
        if obstacle:
            raise SettingsError(f"{folder} cannot be resumed: {obstacle}; choose another --out")
    elif not _usable(folder):
        remedy = "--resume continues it" if begun else "it has no campaign"
        raise SettingsError(f"{folder} is not empty: {remedy}, or choose another --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not begun:
            shutil.copyfile(file, folder / COPY)
            text = json.dumps(asdict(identity), indent=1, ensure_ascii=False) + "\n"
            (folder / FILE).write_text(text, encoding="utf-8")
        return RunTable(folder, quantities(campaign))
    except OSError as error:
        raise SettingsError(f"{folder}: cannot be written ({error.strerror})") from error


def _usable(folder: Path) -> bool:
    """Return whether a folder is new or empty."""
    if not folder.is_dir():
        return not folder.exists()
    return all(each.name == LOCK for each in folder.iterdir())


def _read(path: Path) -> CampaignFingerprint:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return CampaignFingerprint(**{**content, "software": Software(**content["software"])})
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise SettingsError(f"{path} is not a campaign's file ({error})") from error


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()
