"""`HistoryBuilder` makes the `RunHistory` from the items of a recording, from a file or live."""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Final

from executive.commands import Command, request_text
from executive.commands.intake import MAX_SOURCE_LENGTH, SOURCE_PREFIX
from executive.core.recording import (
    CommandDequeued,
    CoreCall,
    CoreCalled,
    Entry,
    Item,
    LedgerBehind,
    ModeChanged,
    ProcessStart,
    ReportSent,
    SubmitAnswered,
    TreeChanged,
    TreeNodeState,
    VelocityCommanded,
)
from executive.faults import Reaction
from executive.history.run_history import (
    DISK_WAIT,
    LeafRun,
    PeakSpeed,
    ReceivedCommand,
    RejectedSubmission,
    RunHistory,
    Situation,
)
from executive.settings import Settings
from executive.values.plan_nodes import DECISIONS
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, Report

KINDS: Final = (
    CommandDequeued,
    SubmitAnswered,
    ReportSent,
    ModeChanged,
    TreeChanged,
    VelocityCommanded,
    LedgerBehind,
)
"""Kinds of items that are used, besides process starts and entries."""
_RUNNING: Final = "RUNNING"
_MIN_DISK_WAIT_S: Final = 0.1
_OF_PLANS: Final = (SOURCE_PREFIX, *DECISIONS)
"""Begins of the messages of plan nodes that are part of the history."""


class HistoryBuilder:
    """A tape that can return the history of the run at any time.

    Args:
        leaf_paths: returns the leaves of an asset's behaviour tree; other nodes are ignored,
            except those of plans.
        maximum: maximum number of items of each kind, the newest; None for all.
    """

    def __init__(
        self, leaf_paths: Callable[[Settings], frozenset[str]], maximum: int | None = None
    ) -> None:
        self._paths_of, self._max_items = leaf_paths, maximum
        self._utc_s = 0.0
        self._ended_utc_s: float | None = None
        self._absences: deque[tuple[float, float]] = deque(maxlen=maximum)
        self._allowed_mps = 0.0
        self._slowing: frozenset[Reason] = frozenset()
        self._leaf_paths: frozenset[str] = frozenset()
        self._active: Identity | None = None
        self._reports: dict[int, Report] = {}
        self._received: deque[ReceivedCommand] = deque(maxlen=maximum)
        self._declined: deque[RejectedSubmission] = deque(maxlen=maximum)
        self._situations: deque[Situation] = deque(maxlen=maximum)
        self._leaves: deque[LeafRun] = deque(maxlen=maximum)
        self._running: dict[str, LeafRun] = {}
        self._shown: dict[str, tuple[str, bool]] = {}
        self._behind_since_utc_s: float | None = None
        self._behind = False
        self._fastest: dict[Identity, float] = {}

    def restore(self, reports: Iterable[Report]) -> None:
        """Add the reports of process starts before this one, from the ledger."""
        for each in reports:
            self._add_report(each)

    def put(self, item: Item) -> None:
        """Process the next item."""
        if isinstance(item, Entry):
            if self._ended_utc_s is not None:
                self._absences.append((self._ended_utc_s, item.utc_s))
                self._ended_utc_s = None
            self._utc_s = item.utc_s
        match item:
            case VelocityCommanded(velocity=velocity):
                self._note_speed(abs(velocity.travel_mps))
            case TreeChanged(nodes=nodes, removed=removed):
                for node in nodes:
                    if node.path in self._leaf_paths:
                        self._follow(node)
                    elif node.path.startswith(SOURCE_PREFIX):
                        self._follow_plan(node)
                for path in removed:
                    self._end_leaf(path)
                    self._shown.pop(path, None)
            case ModeChanged() as now:
                self._active = now.active
                self._situations.append(
                    Situation(self._utc_s, now.mode, now.active, now.why, now.fault, now.cause)
                )
            case ReportSent(report=report):
                self._add_report(self._with_disk_wait(report))
            case LedgerBehind():
                self._behind = True
                if self._behind_since_utc_s is None:
                    self._behind_since_utc_s = self._utc_s
            case CoreCalled(call=CoreCall.SERVE | CoreCall.TICK):  # each polls the ledger
                if not self._behind:
                    self._behind_since_utc_s = None
                self._behind = False
            case CommandDequeued(command=command):
                self._received.append(_received(command, self._utc_s))
            case SubmitAnswered(identity=identity, refusal=Refusal() as refusal):
                self._declined.append(RejectedSubmission(_bounded(identity), self._utc_s, refusal))
            case CoreCalled(call=CoreCall.START):
                for path in list(self._running):
                    self._end_leaf(path)
            case ProcessStart(settings=settings):
                self._ended_utc_s = self._utc_s or None
                self._begin(settings)
            case _:
                pass

    def history(self) -> RunHistory:
        """Return the history up to now."""
        reports = tuple(self._reports[each] for each in sorted(self._reports))
        identities = {each.identity for each in reports}
        known = {(each.identity, each.reason) for each in reports}
        return RunHistory(
            until_utc_s=self._utc_s,
            reports=reports,
            received=tuple(self._received),
            declined=tuple(
                each
                for each in self._declined
                if each.identity not in identities
                or (each.identity, each.refusal.reason) not in known
            ),
            situations=tuple(self._situations),
            leaves=tuple(
                sorted([*self._leaves, *self._running.values()], key=lambda e: e.began_utc_s)
            ),
            fastest=tuple(
                PeakSpeed(identity, speed_mps, self._allowed_mps)
                for identity, speed_mps in self._fastest.items()
            ),
            slowing=self._slowing,
            absences=tuple(self._absences),
        )

    def _begin(self, settings: Settings) -> None:
        self._allowed_mps = settings.drive.travel_speed_mps
        self._slowing = frozenset(
            declared.reason
            for declared, row in settings.faults
            if row.reaction is Reaction.SLOW_DOWN
        )
        self._leaf_paths = self._paths_of(settings)

    def _add_report(self, report: Report) -> None:
        self._reports.setdefault(report.sequence, report)
        self._trim(self._reports)

    def _with_disk_wait(self, report: Report) -> Report:
        """Add the figure of a report's wait for its commit; a repeated report did not wait."""
        since_s, waited_s = self._behind_since_utc_s, self._utc_s - report.utc_s
        if since_s is None or report.utc_s < since_s or waited_s < _MIN_DISK_WAIT_S:
            return report
        return replace(report, figures=(*report.figures, Figure(DISK_WAIT, waited_s, "s")))

    def _note_speed(self, travel_mps: float) -> None:
        if self._active is not None and travel_mps >= self._fastest.get(self._active, 0.0):
            self._fastest[self._active] = travel_mps
            self._trim(self._fastest)

    def _trim(self, retained: dict[Any, Any]) -> None:
        if self._max_items is not None and len(retained) > self._max_items:
            del retained[next(iter(retained))]

    def _follow(self, node: TreeNodeState) -> None:
        if node.status != _RUNNING:
            self._end_leaf(node.path)
            return
        run = self._running.get(node.path)
        began_s = self._utc_s if run is None else run.began_utc_s
        self._running[node.path] = LeafRun(node.path, began_s, None, node.message)

    def _follow_plan(self, node: TreeNodeState) -> None:
        """Note the commands of a plan's node, and its decisions, each while it is in force."""
        shown = node.message if node.message.startswith(_OF_PLANS) else ""
        runs, (before, ran) = node.status == _RUNNING, self._shown.get(node.path, ("", False))
        self._shown[node.path] = shown, runs
        if shown != before or (runs and not ran):
            self._end_leaf(node.path)
            if shown:
                self._running[node.path] = LeafRun(node.path, self._utc_s, None, shown)
        if not runs:
            self._end_leaf(node.path)

    def _end_leaf(self, path: str) -> None:
        run = self._running.pop(path, None)
        if run is not None:
            self._leaves.append(LeafRun(path, run.began_utc_s, self._utc_s, run.message))


def _bounded(identity: Identity) -> Identity:
    """Return an identity with its source truncated, which a stop's may need."""
    return Identity(identity.source[:MAX_SOURCE_LENGTH], identity.command_id)


def _received(command: Command, utc_s: float) -> ReceivedCommand:
    return ReceivedCommand(
        _bounded(command.identity),
        request_text(command.request),
        command.name,
        command.link,
        utc_s,
        command.preemption,
        command.created_utc_s,
        command.lifetime_s,
    )
