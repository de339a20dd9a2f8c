"""A recording as moments: tree, mode, position and commands at any time of a run."""

from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

from adapters.recording.container import RecordingError
from adapters.recording.run_file import RunReader
from adapters.recording.timed_items import read_timed
from adapters.recording.tree import RecordedTree
from executive.core.recording import (
    Call,
    Called,
    Life,
    ModeChanged,
    Observed,
    Reported,
    TreeChanged,
)
from executive.values.facts import Odometry
from executive.values.geometry import Pose
from executive.values.reports import Report, ReportKind
from trees import TreeSnapshot


@dataclass(frozen=True, slots=True)
class Moment:
    """A tick of a run.

    Attributes:
        time_s: time since the beginning of the recording.
        snapshot: the tree, and the reason of the latest mode change.
        since_s: time of the latest change of each node, by its path.
        pose: pose by odometry; None before the first.
        commands: the latest report of each command, in order of arrival.
        reports: reports of this tick.
    """

    time_s: float
    snapshot: TreeSnapshot
    since_s: dict[str, float]
    pose: Pose | None
    commands: tuple[Report, ...]
    reports: tuple[Report, ...]


class RecordedMoments:
    """All moments of a recording.

    Attributes:
        asset: name of the recorded rover.

    Raises:
        RecordingError: the file cannot be used as a recording, or contains no tick.
    """

    def __init__(self, path: Path) -> None:
        self.asset = ""
        self.moments: list[Moment] = []
        self._read(path)
        self._times_s = [each.time_s for each in self.moments]

    def index_at(self, time_s: float) -> int:
        """Return the index of the last moment at or before a time; 0 before the first."""
        return max(0, bisect_right(self._times_s, time_s + 1e-6) - 1)

    def index_of(self, name: str) -> int | None:
        """Return the first moment that reports a reason, or the last report of `SOURCE:NUMBER`."""
        found = None
        for index, moment in enumerate(self.moments):
            for report in moment.reports:
                if report.reason is not None and report.reason.name == name:
                    return index
                if report.kind is ReportKind.COMMAND and str(report.identity) == name:
                    found = index
        return found

    def next_event(self, index: int, step: int) -> int:
        """Return the next (step 1) or previous (-1) moment with reports; without one, `index`."""
        at = index + step
        while 0 <= at < len(self.moments):
            if self.moments[at].reports:
                return at
            at += step
        return index

    def _read(self, path: Path) -> None:
        tree: RecordedTree | None = None
        since_s: dict[str, float] = {}
        mode, why, pose, ticks = "", "", None, 0
        commands: dict[str, Report] = {}
        lasts: tuple[Report, ...] = ()
        new: list[Report] = []
        current: tuple[float, float] | None = None

        def end() -> None:
            nonlocal current, new
            if current is not None:
                nodes = () if tree is None else tree.nodes()
                snapshot = TreeSnapshot(ticks, current[1], mode, why, nodes)
                self.moments.append(Moment(current[0], snapshot, since_s, pose, lasts, tuple(new)))
                new = []
            current = None

        for timed in read_timed(RunReader(path), {Odometry, ModeChanged, TreeChanged, Reported}):
            if isinstance(timed.item, Life | Called | Observed):
                end()
            match timed.item:
                case Life(settings=settings):
                    self.asset, tree = settings.asset, RecordedTree(settings)
                    ticks = 0
                case Called(call=Call.TICK):
                    current = timed.time_s, timed.utc_s
                    ticks += 1
                case Observed(fact=Odometry() as odometry):
                    pose = odometry.pose
                case TreeChanged() if tree is not None:
                    changed = dict.fromkeys(tree.put(timed.item), timed.time_s)
                    since_s = {**since_s, **changed} if changed else since_s
                case ModeChanged():
                    mode = timed.item.mode.name
                    why = f"{timed.item.why} (as of {timed.time_s:.2f} s)"
                case Reported(report=report):
                    new.append(report)
                    if report.kind is ReportKind.COMMAND:
                        commands[str(report.identity)] = report
                        lasts = tuple(commands.values())
                case _:
                    pass
        end()
        if not self.moments:
            raise RecordingError(f"{path}: contains no tick")
