"""Of mutants of the core's rules, how many are noticed by replaying recordings of it?

scenarios, tests of the core ──▶ recordings ──▶ traced: which lines does each reach?
                                     │                     │
copy of the checkout, one change ────┴─ replays of those that reach it, up to a difference
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import yaml

from adapters.recording import SUFFIX, RunFile
from executive.settings import SettingsError, names_in
from sim.campaign.draws import draw
from sim.campaign.reading import campaign_folder, load_campaign
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode, Scenario
from sim.scenario.reading import load_scenario, scenario_folder
from tests.benchmarks.mutant_replays import Traced
from tests.benchmarks.mutation import PACKAGES, Mutant, MutantKind, probes, sample, uses
from tests.stress.findings import Log
from tests.suite import CHECKOUT, MEASURED, environment
from tests.support.figures import Figure, Goal

NOTICED: Final = Goal(80, at_least=True)
COPIED: Final = (*PACKAGES, "adapters", "config", "tests/benchmarks")
EQUIVALENT: Final = Path(__file__).with_name("equivalent-mutants.yaml")
PATIENCE: Final = 4.0
"""Times what the traced replays took, and this many seconds more: what takes longer hangs."""
STARTS_S: Final = 20.0
RUNS: Final = 8
"""Of each campaign, that are recorded; so many numbers apart, as grids go by the number."""
APART: Final = 23


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutant.

    Attributes:
        reached: how many recordings reach what is changed.
        noticed: by which recording, and how; empty where by none.
    """

    mutant: Mutant
    reached: int
    noticed: str


def measure(number: int, seed: int, folder: Path | None, log: Log) -> list[Figure]:
    """Return how many of so many mutants are noticed, and tell of those that are not.

    Args:
        number: how many mutants.
        seed: of which.
        folder: of recordings, which are made where it is empty; None for a temporary one.
        log: called with a line on how it goes on, and with some on each that is not noticed.

    Raises:
        ChildProcessError: the tests of the core fail, or replays of the unchanged core.
    """
    with tempfile.TemporaryDirectory(prefix="rover-mutants-") as scratch:
        recordings = folder or Path(scratch, "recordings")
        recordings.mkdir(exist_ok=True)
        if not any(recordings.glob(f"*{SUFFIX}")):
            record_all(recordings, log)
        tree = _copied(Path(scratch, "checkout"))
        log("tracing which lines each recording reaches, and which bounds ...")
        imported, *traced = traces(tree, sorted(recordings.glob(f"*{SUFFIX}")))
        traced.sort(key=lambda each: each.took_s)
        usable = [each for each in traced if not each.difference]
        log(f"{len(usable)} of {len(traced)} recordings are replayed equally; the control ...")
        control = bool(_difference(tree, usable))
        drawn = sample(CHECKOUT, number, seed)
        known = known_equivalents()
        tried = [each for each in drawn if key_of(each) not in known]
        verdicts = [_judge(tree, each, imported, usable, log) for each in tried]
    return _figures(verdicts, len(drawn) - len(tried), len(usable), len(traced), control, seed)


def record_all(folder: Path, log: Log) -> None:
    """Record scenarios in lock step, some runs of each campaign, and the tests of the core.

    Raises:
        ChildProcessError: a test fails.
    """
    log("recording the scenarios and some runs of each campaign ...")
    for name, scenario in (*_scenarios(), *_runs_of_campaigns()):
        with (
            closing(RunFile(folder / f"{name}{SUFFIX}")) as tape,
            tempfile.TemporaryDirectory() as data,
        ):
            run_in_lock_step(scenario, Path(data), tape)
    log("recording the tests of the core ...")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    chosen = ["-m", "not ros and not at_length", "--hypothesis-seed=0", *MEASURED]
    done = subprocess.run(
        [*command, *chosen, "--recordings", str(folder.resolve())],
        cwd=CHECKOUT,
        env=environment(),
        check=False,
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        raise ChildProcessError(f"the tests of the core fail:\n{done.stdout[-2000:]}")


def _scenarios() -> Iterator[tuple[str, Scenario]]:
    for name in names_in(scenario_folder()):
        with suppress(SettingsError):  # of those that are for real processes alone
            yield f"scenario-{name}", load_scenario(name, RunMode.LOCK_STEP)


def _runs_of_campaigns() -> Iterator[tuple[str, Scenario]]:
    for name in names_in(campaign_folder()):
        campaign = load_campaign(name)
        for run in range(RUNS):
            drawn = draw(campaign, run * APART)
            scenario = load_scenario(drawn.scenario, RunMode.LOCK_STEP, drawn.changes)
            yield f"campaign-{name}-{run}", scenario


def _copied(tree: Path) -> Path:
    """Return a copy of what replays need, which begins as fast as the checkout does."""
    for name in COPIED:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(CHECKOUT / name, tree / name, ignore=ignored)
    # By the hash of the source: a mutant may be as long as the original, and as old.
    mode = ("--invalidation-mode", "checked-hash")
    subprocess.run([sys.executable, "-m", "compileall", "-q", *mode, str(tree)], check=True)
    return tree


def _run(tree: Path, paths: Sequence[str], *what: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-B", "-m", "tests.benchmarks.mutant_replays", *what],
        cwd=tree,
        env=os.environ | {"PYTHONPATH": str(tree), "ROVER_CONFIG": str(tree / "config")},
        input="\n".join(paths),
        check=False,
        capture_output=True,
        text=True,
    )


def traces(tree: Path, paths: Sequence[Path]) -> list[Traced]:
    """Return what is reached when the core is imported, and then by each recording.

    Raises:
        ChildProcessError: that cannot be found out.
    """
    probed = probes(CHECKOUT)
    for path, (source, _) in probed.items():
        (tree / path).write_bytes(source)
    done = _run(tree, [str(path.resolve()) for path in paths], "trace")
    for path in probed:
        shutil.copyfile(CHECKOUT / path, tree / path)
    if done.returncode != 0:
        raise ChildProcessError(f"the recordings cannot be traced:\n{done.stderr[-2000:]}")
    unknown = [location for _, left_out in probed.values() for location in left_out]
    found = (Traced(**json.loads(line)) for line in done.stdout.splitlines())
    return [replace(each, met=[*each.met, *unknown]) for each in found]


def _difference(tree: Path, recordings: Sequence[Traced]) -> str:
    """Return what replays find of a difference, in words; empty if nothing."""
    limit_s = STARTS_S + PATIENCE * sum(each.took_s for each in recordings)
    done = _run(tree, [each.path for each in recordings], "check", f"{limit_s:.0f}")
    if done.returncode == -signal.SIGXCPU:
        return "it does not come to an end"
    if done.returncode != 0:
        return done.stderr.strip().rpartition("\n")[2] or f"ends with {done.returncode}"
    return done.stdout.strip()


def _judge(
    tree: Path, mutant: Mutant, imported: Traced, recordings: Sequence[Traced], log: Log
) -> Verdict:
    """Have the recordings replayed that reach what a mutant changes; the fastest first."""
    locations = _locations(mutant)
    if locations is None or _reaches(imported, locations):
        reaching = list(recordings)
    else:
        reaching = [each for each in recordings if _reaches(each, locations)]
    if mutant.probe:
        reaching = [each for each in reaching if mutant.location in each.met]
    source = (CHECKOUT / mutant.path).read_bytes()
    noticed = ""
    if reaching:
        location = tree / mutant.path
        location.write_bytes(mutant.applied(source))
        try:
            noticed = _difference(tree, reaching)
        finally:
            location.write_bytes(source)
    if not noticed:
        how = f"reached by {len(reaching)} recordings" if reaching else "not reached"
        log("\n    ".join([f"not noticed, {how}: {mutant}", *_diff(mutant)]))
    return Verdict(mutant, len(reaching), noticed)


def _reaches(traced: Traced, locations: Mapping[str, Collection[int]]) -> bool:
    return any(
        not set(lines).isdisjoint(traced.lines.get(path, ())) for path, lines in locations.items()
    )


def _locations(mutant: Mutant) -> dict[str, set[int]] | None:
    """Return the lines that lead through what a mutant changes; None for all."""
    if mutant.within:
        return {mutant.path: set(range(mutant.first, mutant.last + 1))}
    return uses(CHECKOUT, mutant.constant) if mutant.constant else None


def _diff(mutant: Mutant) -> list[str]:
    return mutant.diff((CHECKOUT / mutant.path).read_bytes())


def key_of(mutant: Mutant) -> tuple[str, ...]:
    """Return what it is known by, though lines move: the function, and the lines that change."""
    return (mutant.path, mutant.scope, *_diff(mutant))


def known_equivalents() -> set[tuple[str, ...]]:
    """Return the keys of what is known to decide the same."""
    raw = yaml.safe_load(EQUIVALENT.read_text(encoding="utf-8"))
    return {(each["path"], each["scope"], *each["diff"]) for each in raw}


def _figures(
    verdicts: Sequence[Verdict],
    equivalent: int,
    usable: int,
    recordings: int,
    control: bool,
    seed: int,
) -> list[Figure]:
    noticed = [each for each in verdicts if each.noticed]
    reached = [each for each in verdicts if each.reached]
    beside = f"{len(verdicts)} mutants, seed {seed}, {usable} recordings"
    share = 100 * len(noticed) / max(len(verdicts), 1)
    of_kinds = Counter(each.mutant.kind for each in verdicts)
    noticed_of = Counter(each.mutant.kind for each in noticed)
    return [
        Figure("mutants: noticed", share, "%", beside, NOTICED),
        *(
            Figure(f"mutants: {kind.value}", noticed_of[kind], "noticed", f"of {of_kinds[kind]}")
            for kind in MutantKind
        ),
        Figure("mutants: reached by a recording", len(reached), "mutants", beside),
        Figure("mutants: equivalent, set aside", equivalent, "mutants", EQUIVALENT.name),
        Figure("mutants: recordings of no use", recordings - usable, "", f"of {recordings}"),
        Figure("mutants: no change, noticed", control, "", beside, Goal(0)),
    ]
