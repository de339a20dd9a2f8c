"""`compare` replays recordings in parallel and groups them by their first different decision."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context
from os import cpu_count
from pathlib import Path
from statistics import median
from typing import Any, Final

from adapters.recording.container import RecordingError
from adapters.recording.first_decision import FirstDecision
from adapters.recording.replay import replay
from executive.settings import Settings

FEW: Final = 8
"""Number of recordings below which this process replays them: another takes 0.7 s to start."""
_HEADER: Final = (
    "| recordings | command | first different decision | recorded | change | example |\n"
    "|---:|---|---|---|---:|---|"
)


@dataclass(frozen=True, slots=True)
class Compared:
    """Result of the replay of a recording.

    Attributes:
        decision: the first different decision; None if all are the same.
        error: why the recording cannot be used; empty if it can.
        cut_s: last time that a truncated or damaged recording has; None for a whole one.
    """

    path: Path
    decision: FirstDecision | None = None
    error: str = ""
    cut_s: float | None = None


@dataclass(frozen=True, slots=True)
class Group:
    """Recordings with equal first different decisions, without their figures."""

    members: tuple[Compared, ...]

    @property
    def first(self) -> FirstDecision:
        """The decision of the first member."""
        decision = self.members[0].decision
        assert decision is not None
        return decision

    @property
    def change(self) -> float | None:
        """Median of the relative changes of the velocity; None for other decisions."""
        found = [each.decision.change for each in self.members if each.decision]
        known = [each for each in found if each is not None]
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
        """Groups of recordings that decide differently, in order of decreasing size."""
        found: dict[tuple[str, str, str], list[Compared]] = {}
        for each in self.compared:
            if each.decision is not None:
                found.setdefault(each.decision.group, []).append(each)
        return tuple(Group(tuple(each)) for each in sorted(found.values(), key=len, reverse=True))

    @property
    def summary(self) -> str:
        """One line; the last of the output."""
        return f"{self.same} of {len(self.compared)} recordings decide the same"

    def markdown(self) -> str:
        """Return a table of the groups, then the files that were not used or not whole."""
        lines = [_HEADER, *map(_row, self.groups), ""] if self.groups else []
        lines += [f"- not used: {each.error}" for each in self.unusable]
        lines += [
            f"- {each.path}: truncated or damaged, compared up to {each.cut_s:.1f} s"
            for each in self.compared
            if each.cut_s is not None
        ]
        return "\n".join([*lines, *([""] if lines and lines[-1] else []), self.summary])

    def document(self) -> dict[str, Any]:
        """Return the result as plain data for JSON."""
        groups = [
            {
                "command": group.first.command,
                "replayed": group.first.replayed,
                "recorded": group.first.recorded,
                "change": group.change,
                "recordings": [_member(each) for each in group.members],
            }
            for group in self.groups
        ]
        unusable = [{"path": str(each.path), "error": each.error} for each in self.unusable]
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


def _compared(path: Path, settings: Settings | None) -> Compared:
    try:
        found = replay(path, settings, to_decision=True)
    except RecordingError as error:
        return Compared(path, error=str(error))
    return Compared(path, found.decision, cut_s=None if found.whole else found.duration_s)


def _member(compared: Compared) -> dict[str, Any]:
    assert compared.decision is not None
    shown = asdict(compared.decision)
    return {
        "path": str(compared.path),
        **{key: shown[key] for key in ("entry", "time_s", "change")},
    }


def _row(group: Group) -> str:
    first, change = group.first, group.change
    cells = (
        str(len(group.members)),
        first.command,
        first.replayed,
        first.recorded,
        "" if change is None else f"{change:+.1%}",
        f"{group.members[0].path}, {first.time_s:.2f} s",
    )
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
