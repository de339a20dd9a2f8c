"""`RecordedMoments`: tree, mode, position and commands at any time of a recorded run."""

from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from adapters.recording.container import RecordingError
from adapters.recording.run_file import RunReader
from adapters.recording.timed_items import read_timed
from executive.commands.intake import SOURCE_PREFIX
from executive.core.recording import (
    CoreCall,
    CoreCalled,
    FactObserved,
    ModeChanged,
    ProcessStart,
    ReportSent,
    TreeChanged,
    TreeNodeState,
)
from executive.settings import Settings
from executive.values.facts import Odometry
from executive.values.geometry import Pose
from executive.values.reports import Report, ReportKind
from trees import NodeKind, NodeStatus, TreeNodeSnapshot, TreeSnapshot, preview

_GUARDS: Final = {NodeKind.CONDITION, NodeKind.TAKE}
"""Nodes whose message only names the command of their branch."""


class RecordedTree:
    """Behaviour tree of one start of an executive, updated by its recorded changes."""

    def __init__(self, settings: Settings) -> None:
        self._static = preview(settings)
        self._paths = {node.path for node in self._static}
        self._guards = {node.path for node in self._static if node.kind in _GUARDS}
        self._states: dict[str, TreeNodeState] = {}
        self._nodes: tuple[TreeNodeSnapshot, ...] | None = None

    def put(self, change: TreeChanged) -> tuple[str, ...]:
        """Apply a change; return the paths of nodes that differ in more than their message.

        These are new nodes, nodes with another status, and nodes that name another command: guards,
        and the leaves of a plan.
        """
        self._nodes = None
        others = []
        for each in change.nodes:
            before = self._states.get(each.path)
            names_command = each.path in self._guards or each.message.startswith(SOURCE_PREFIX)
            if before is None or before.status != each.status or names_command:
                others.append(each.path)
            self._states[each.path] = each
        for lost in change.removed:
            self._states.pop(lost, None)
        return tuple(others)

    def nodes(self) -> tuple[TreeNodeSnapshot, ...]:
        """Return the present nodes; those of a plan are first below the root."""
        if self._nodes is None:
            self._nodes = self._drawn()
        return self._nodes

    def _drawn(self) -> tuple[TreeNodeSnapshot, ...]:
        planned = tuple(
            TreeNodeSnapshot(
                state.path,
                state.path.rpartition("/")[2],
                1 + state.path.count("/"),
                NodeKind.PLANNED,
                NodeStatus[state.status],
                state.message,
            )
            for state in self._states.values()
            if state.path not in self._paths
        )
        others = tuple(_with(node, self._states.get(node.path)) for node in self._static)
        return (*others[:1], *planned, *others[1:])


def _with(node: TreeNodeSnapshot, state: TreeNodeState | None) -> TreeNodeSnapshot:
    if state is None:
        return node
    return replace(node, status=NodeStatus[state.status], message=state.message)


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

        for timed in read_timed(RunReader(path), {Odometry, ModeChanged, TreeChanged, ReportSent}):
            if isinstance(timed.item, ProcessStart | CoreCalled | FactObserved):
                end()
            match timed.item:
                case ProcessStart(settings=settings):
                    self.asset, tree = settings.asset, RecordedTree(settings)
                    ticks = 0
                case CoreCalled(call=CoreCall.TICK):
                    current = timed.time_s, timed.utc_s
                    ticks += 1
                case FactObserved(fact=Odometry() as odometry):
                    pose = odometry.pose
                case TreeChanged() if tree is not None:
                    changed = dict.fromkeys(tree.put(timed.item), timed.time_s)
                    since_s = {**since_s, **changed} if changed else since_s
                case ModeChanged():
                    mode = timed.item.mode.name
                    why = f"{timed.item.why} (as of {timed.time_s:.2f} s)"
                case ReportSent(report=report):
                    new.append(report)
                    if report.kind is ReportKind.COMMAND:
                        commands[str(report.identity)] = report
                        lasts = tuple(commands.values())
                case _:
                    pass
        end()
        if not self.moments:
            raise RecordingError(f"{path}: contains no tick")
