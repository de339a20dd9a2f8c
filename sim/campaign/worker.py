"""`run_job` executes one run of a campaign, in a worker of the cluster or in this process."""

import hashlib
import platform
import shutil
import signal
import tempfile
import time
import traceback
from dataclasses import astuple, dataclass, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from executive.settings import SettingsError
from executive.values.reports import printable
from sim.scenario.changes import Override
from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import RunMetrics, run_once
from sim.scenario.reading import load_scenario
from sim.scenario.run import DATA, run_recorded

OWN_PACKAGES: Final = ("executive", "trees", "adapters", "sim")
ERROR: Final = "error.txt"
"""File of a run that raised an error, with the traceback."""
NO_FIGURES: Final = RunMetrics(None, None, None, 0.0, None, None, None, None, 0, 0, 0, ())
_OF_THIS_MACHINE: Final = (SettingsError, OSError, MemoryError)
"""Errors that may not recur on another machine or later: they are no result of the run."""


@dataclass(frozen=True, slots=True)
class Job:
    """One run to execute.

    Attributes:
        scenario: a path, or the name of one in config/scenarios.
        fingerprint: fingerprint of the scenario and the software at the campaign's start.
    """

    run: int
    scenario: str
    changes: tuple[Override, ...]
    fingerprint: str

    def __str__(self) -> str:
        changes = ", ".join(map(str, self.changes))
        return f"run {self.run}, {self.scenario} with {changes or 'no change'}"


@dataclass(frozen=True, slots=True)
class JobResult:
    """Result of a run.

    Attributes:
        run: its number.
        seed: seed of its sensors' noise.
        passed: whether all expectations of its scenario are met.
        failed_findings: failed expectations as text.
        digest: digest of all events; equal for runs that are identical bit for bit.
        seconds: duration of its execution.
    """

    run: int
    seed: int
    figures: RunMetrics
    passed: bool
    failed_findings: tuple[str, ...]
    digest: str
    seconds: float


@dataclass(frozen=True, slots=True)
class JobFailed:
    """A run that cannot be executed, and the cause."""

    run: int
    reason: str


@dataclass(frozen=True, slots=True)
class RunArtifacts:
    """Files of a repeated run.

    Attributes:
        digest: digest of all events.
        archive: map, timeline, reports, recording, ledger and onboard files, as a zip file.
    """

    run: int
    digest: str
    archive: bytes


def run_job(job: Job) -> JobResult | JobFailed:
    """Execute a run and return its result; one that raises an error has failed."""
    began_s = time.perf_counter()
    try:
        scenario = _scenario(job)
        with tempfile.TemporaryDirectory(prefix="rover-run-", dir=_scratch()) as folder:
            outcome = run_once(job.scenario, scenario, Path(folder))
    except _OF_THIS_MACHINE as error:
        return JobFailed(job.run, _why(error))
    except Exception as error:
        figures, passed, digest = NO_FIGURES, False, _digest(error)
        failed: tuple[str, ...] = (_error_as_finding(error),)
    else:
        figures, passed, digest = outcome.figures, outcome.passed, outcome.digest
        failed = tuple(
            f"{finding.subject}: expected {finding.expected}, observed {finding.observed}"
            for finding in outcome.findings
            if not finding.passed
        )
    seconds = time.perf_counter() - began_s
    return JobResult(job.run, scenario.seed, figures, passed, failed, digest, seconds)


def run_and_archive(job: Job) -> RunArtifacts | JobFailed:
    """Execute a run and return all its files, as `rover scenario --out` writes them.

    One that raises an error has `error.txt`, and the onboard files written before.
    """
    from sim.scenario.pictures import write_run

    try:
        scenario = _scenario(job)
        with tempfile.TemporaryDirectory(prefix="rover-run-", dir=_scratch()) as scratch:
            folder = Path(scratch, "run")
            (folder / DATA).mkdir(parents=True)
            try:
                outcome = run_recorded(job.scenario, scenario, folder)
            except _OF_THIS_MACHINE:
                raise
            except Exception as error:
                digest = _digest(error)
                text = "".join(traceback.format_exception(error))
                (folder / ERROR).write_text(text, encoding="utf-8")
            else:
                digest = outcome.digest
                write_run(folder, scenario, outcome.record)
            archive = shutil.make_archive(str(Path(scratch, "kept")), "zip", folder)
            return RunArtifacts(job.run, digest, Path(archive).read_bytes())
    except _OF_THIS_MACHINE as error:
        return JobFailed(job.run, _why(error))


def _scenario(job: Job) -> Scenario:
    """Return the scenario of a job.

    Raises:
        SettingsError: it cannot be executed here, or differs from the campaign's.
    """
    scenario = load_scenario(job.scenario, RunMode.LOCK_STEP, job.changes)
    # Read after the scenario was loaded: an edit before, during or since is detected.
    if _fingerprint(job.scenario) != job.fingerprint:
        raise SettingsError(
            f"another version of scenario {job.scenario}, of an asset or world that it names, or of"
            f" the software: {software()}"
        )
    return scenario


def _why(error: Exception) -> str:
    text = str(error) if isinstance(error, SettingsError) else repr(error)
    return f"on {platform.node()}: {text}"


def _error_as_finding(error: Exception) -> str:
    """Return an error of a run in the form of a finding: expected and observed."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    text = printable(" ".join(str(error).split()))
    kind = type(error).__name__
    return f"run: expected no {kind}, observed {text} ({Path(frame.filename).name}:{frame.lineno})"


def _digest(error: Exception) -> str:
    return hashlib.sha256(_error_as_finding(error).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Software:
    """Software that determines the bits of a run, together with its scenario.

    Attributes:
        code: digest of its sources.
    """

    rover_executive: str
    code: str
    python: str
    numpy: str
    mujoco: str

    def __str__(self) -> str:
        return (
            f"rover-executive {self.rover_executive} (code {self.code}), Python {self.python},"
            f" NumPy {self.numpy}, MuJoCo {self.mujoco}"
        )

    def differences(self, other: "Software") -> str:
        """Return the differences of another software as text; empty without one."""
        return ", ".join(
            f"{each.name.replace('_', '-')} {getattr(other, each.name)} instead of"
            f" {getattr(self, each.name)}"
            for each in fields(self)
            if getattr(self, each.name) != getattr(other, each.name)
        )


@cache
def software() -> Software:
    """Return the software that executes runs in this process."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for package in OWN_PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in (".py", ".xml", ".yaml", ".json"):
                digest.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    python = ".".join(platform.python_version_tuple()[:2])
    ours = _version("rover-executive")
    code = digest.hexdigest()[:12]
    return Software(ours, code, python, _version("numpy"), _version("mujoco-core"))


@cache
def fingerprint(scenario: str) -> str:
    """Return a digest of a scenario's inputs: all files that it names, and the software.

    It is the digest at the first call of this process, the start of a campaign.

    Raises:
        SettingsError: the scenario does not exist here.
    """
    return _fingerprint(scenario)


def _fingerprint(scenario: str) -> str:
    """Return that digest of the present files."""
    text = repr((load_scenario(scenario), astuple(software())))
    return hashlib.sha256(text.encode()).hexdigest()


def dask_setup(_: object) -> None:
    """Leave Ctrl-C to the campaign; Dask calls this in each worker on this computer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "not installed"


def _scratch() -> str | None:
    """Return the folder of the Dask worker, which is deleted with it; None for /tmp."""
    from distributed import get_worker

    try:
        return str(get_worker().local_directory)
    except ValueError:
        return None
