"""`compare` replays recordings in parallel and groups them by their first different decision.

`judge` has each that differs judged by its fork, in processes of `sim`, where forks are.
"""

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.util import find_spec
from itertools import chain
from multiprocessing import get_context
from os import cpu_count
from pathlib import Path
from statistics import median
from typing import Any, Final

from adapters.recording.container import RecordingError
from adapters.recording.replay import TEXTS, ReplayDecision, replay
from executive.settings import Settings

FEW: Final = 8
"""Number of recordings below which this process replays them: another takes 0.7 s to start."""
JUDGE: Final = "sim.fork.judge"
"""Module that judges recordings: JSON from its standard input, lines of JSON to its output."""
SAME: Final = "same"
UNKNOWN: Final = "not judged"
MAX_REASONS: Final = 10
"""Maximum number of reasons of verdicts below the table; `--json` has all."""
_HEADER: Final = (
    "| recordings | command | first different decision | recorded | change | forks | example |\n"
    "|---:|---|---|---|---:|---|---|"
)


@dataclass(frozen=True, slots=True)
class Compared:
    """Result of the replay of a recording.

    Attributes:
        decision: the first different decision; None if all are the same.
        error: why the recording cannot be used; empty if it can.
        cut_s: last time that a truncated or damaged recording has; None for a whole one.
        verdict: of its fork: `better`, `worse`, `same` or `not judged`; empty without a fork.
        reason: reason of the verdict.
    """

    path: Path
    decision: ReplayDecision | None = None
    error: str = ""
    cut_s: float | None = None
    verdict: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Group:
    """Recordings with equal first different decisions, without their figures."""

    members: tuple[Compared, ...]

    @property
    def first(self) -> ReplayDecision:
        """The decision of the first member."""
        decision = self.members[0].decision
        assert decision is not None
        return decision

    @property
    def change(self) -> float | None:
        """Median of the relative changes of the velocity; None for other decisions."""
        found = (each.decision.decision for each in self.members if each.decision)
        known = [each.change for each in found if each is not None and each.change is not None]
        return median(known) if known else None


@dataclass(frozen=True, slots=True)
class Regressions:
    """Result for all recordings, in their order."""

    compared: tuple[Compared, ...]

    @property
    def same(self) -> int:
        """Number of recordings that decide the same."""
        return sum(not each.error and each.decision is None for each in self.compared)

    @property
    def unusable(self) -> tuple[Compared, ...]:
        """Files that cannot be used."""
        return tuple(each for each in self.compared if each.error)

    @property
    def groups(self) -> tuple[Group, ...]:
        """Groups of recordings that decide differently, by decreasing size; of texts at the end."""
        found: dict[tuple[str, str, str], list[Compared]] = {}
        for each in self.compared:
            if each.decision is not None:
                found.setdefault(each.decision.group, []).append(each)
        order = sorted(found, key=lambda key: (TEXTS in key, -len(found[key])))
        return tuple(Group(tuple(found[key])) for key in order)

    def markdown(self) -> str:
        """Return a table of the groups, then the files that were not used or not whole."""
        lines = [_HEADER, *map(_row, self.groups), ""] if self.groups else []
        judged = [each for each in self.compared if each.reason and each.verdict != SAME]
        lines += [f"- {each.verdict}: {each.path}: {each.reason}" for each in judged[:MAX_REASONS]]
        lines += [f"- not used: {each.error}" for each in self.unusable]
        lines += [
            f"- {each.path}: truncated or damaged, compared up to {each.cut_s:.1f} s"
            for each in self.compared
            if each.cut_s is not None
        ]
        lines += [""] if lines and lines[-1] else []
        summary = f"{self.same} of {len(self.compared)} recordings decide the same"
        return "\n".join([*lines, summary])

    def document(self) -> dict[str, Any]:
        """Return the result as plain data; paths are not yet text."""
        groups = [
            {
                **dict(zip(("command", "replayed", "recorded"), group.first.group, strict=True)),
                "change": group.change,
                "recordings": [asdict(each) for each in group.members],
            }
            for group in self.groups
        ]
        unusable = [asdict(each) for each in self.unusable]
        total = len(self.compared)
        return {"recordings": total, "same": self.same, "groups": groups, "unusable": unusable}


def compare(paths: Sequence[Path], settings: Settings | None, jobs: int | None) -> Regressions:
    """Replay recordings, each up to its first different decision.

    Args:
        paths: first file of each recording.
        settings: settings to replace those of the runs; None for those recorded.
        jobs: number of processes; None for one on each core.
    """
    play = partial(_compared, settings=settings)
    workers = min(jobs or cpu_count() or 1, len(paths))
    if workers == 1 or len(paths) < FEW:
        return Regressions(tuple(map(play, paths)))
    # Spawned, because a forked process inherits the locks of other threads.
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        return Regressions(tuple(pool.map(play, paths)))


def judge(found: Regressions, asset: str | None, jobs: int | None) -> Regressions:
    """Return the regressions with a verdict on each recording that decides differently.

    Texts and figures are not judged.

    Args:
        found: regressions without verdicts.
        asset: name or file of the settings that replace those of the runs; None if the code has
            changed.
        jobs: number of processes; None for one on each core.
    """
    differ = [each for each in found.compared if each.decision and each.decision.decision]
    if any(find_spec(name) is None for name in ("sim", "mujoco")):
        text = "the simulation is not installed: pip install 'rover-executive[sim]'"
        judged = [replace(each, verdict=UNKNOWN, reason=text) for each in differ]
    else:
        workers = max(1, min(jobs or cpu_count() or 1, len(differ)))
        shares = [differ[number::workers] for number in range(workers)]
        with ThreadPoolExecutor(workers) as pool:
            judged = [*chain(*pool.map(partial(_judged, asset), shares))]
    verdicts = {each.path: each for each in judged}
    return Regressions(tuple(verdicts.get(each.path, each) for each in found.compared))


def _judged(asset: str | None, share: Sequence[Compared]) -> list[Compared]:
    """Return recordings with verdict and reason, by a process of its own."""
    request = json.dumps({"recordings": [str(each.path) for each in share], "settings": asset})
    command = [sys.executable, "-P", "-m", JUDGE]
    ended = subprocess.run(command, input=request, capture_output=True, text=True)
    lines = ended.stderr.strip().splitlines() or [f"exit status {ended.returncode}"]
    answers = {path: answer for path, *answer in map(json.loads, ended.stdout.splitlines())}
    failed = UNKNOWN, f"the fork failed: {lines[-1]}"
    answered = ((each, *answers.get(str(each.path), failed)) for each in share)
    return [replace(each, verdict=verdict, reason=why) for each, verdict, why in answered]


def _compared(path: Path, settings: Settings | None) -> Compared:
    try:
        found = replay(path, settings, to_decision=True)
    except RecordingError as error:
        return Compared(path, error=str(error))
    return Compared(path, found.decision, cut_s=None if found.whole else found.duration_s)


def _row(group: Group) -> str:
    first, change = group.first, group.change
    verdicts = Counter(each.verdict for each in group.members)
    cells = (
        str(len(group.members)),
        *first.group,
        "" if change is None else f"{change:+.1%}",
        ", ".join(f"{number} {name}" for name, number in verdicts.most_common() if name),
        f"{group.members[0].path}, {first.time_s:.2f} s",
    )
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
