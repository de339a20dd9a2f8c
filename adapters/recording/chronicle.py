"""A recording as what explanations are made from."""

from pathlib import Path
from typing import Final

from adapters.explanation import (
    Asked,
    Chronicle,
    Declined,
    Fastest,
    LeafRun,
    Situation,
    request_text,
)
from adapters.recording.timed import Timed, read_timed
from executive.fault_declaration import Then
from executive.reasons import Reason
from executive.recording import (
    Answered,
    Called,
    Drove,
    Life,
    ModeChanged,
    NodeState,
    Observed,
    Reported,
    Served,
    TreeChanged,
)
from executive.reports import Identity, Report
from trees import NodeKind, NodeStatus, preview

_KINDS: Final = (Served, Answered, Reported, ModeChanged, TreeChanged, Drove)
_LEAVES: Final = {NodeKind.LEAF}


def read_chronicle(path: Path, until_s: float | None = None) -> tuple[Chronicle, float]:
    """Return what a recording knows, and when it began, seconds since 1970-01-01 UTC.

    Args:
        path: of the recording.
        until_s: leave out what came later, in seconds since its beginning.

    Raises:
        RecordingError: the file cannot be used as a recording, or holds no run.
    """
    reader = _Reader()
    began_utc_s: float | None = None
    for each in read_timed(path, _KINDS):
        if until_s is not None and each.time_s > until_s + 1e-6:
            break
        if began_utc_s is None:
            began_utc_s = each.utc_s - each.time_s
        reader.take(each)
    assert began_utc_s is not None
    return reader.chronicle(), began_utc_s


class _Reader:
    def __init__(self) -> None:
        self._until_utc_s = 0.0
        self._allowed_mps = 0.0
        self._slowing: frozenset[Reason] = frozenset()
        self._leaf_paths: set[str] = set()
        self._asked: list[Asked] = []
        self._declined: list[Declined] = []
        self._reports: list[Report] = []
        self._known: set[int] = set()
        self._situations: list[Situation] = []
        self._leaves: list[LeafRun] = []
        self._running: dict[str, LeafRun] = {}
        self._fastest: dict[Identity, float] = {}

    def take(self, timed: Timed) -> None:
        utc_s = timed.utc_s
        self._until_utc_s = max(self._until_utc_s, utc_s)
        match timed.item:
            case Life(settings=settings):
                self._end_leaves(utc_s)
                self._allowed_mps = settings.drive.travel_speed_mps
                self._slowing = frozenset(
                    declared.reason
                    for declared, row in settings.faults
                    if row.then is Then.SLOW_DOWN
                )
                self._leaf_paths = {each.path for each in preview(settings) if each.kind in _LEAVES}
            case Served(command=command):
                self._asked.append(
                    Asked(
                        command.identity,
                        request_text(command.request),
                        command.name,
                        command.link,
                        utc_s,
                        command.arrival,
                        command.created_utc_s,
                        command.lifetime_s,
                    )
                )
            case Answered(identity=identity, refusal=refusal):
                if refusal is not None:
                    self._declined.append(Declined(identity, utc_s, refusal))
            case Reported(report=report):
                if report.sequence not in self._known:
                    self._known.add(report.sequence)
                    self._reports.append(report)
            case ModeChanged(mode=mode, active=active, why=why):
                self._situations.append(Situation(utc_s, mode, active, why))
            case TreeChanged(nodes=nodes, gone=gone):
                for node in nodes:
                    if node.path in self._leaf_paths:
                        self._follow(node, utc_s)
                for path in gone:
                    self._end_leaf(path, utc_s)
            case Drove(velocity=velocity):
                active = self._situations[-1].active if self._situations else None
                if active is not None:
                    before = self._fastest.get(active, 0.0)
                    self._fastest[active] = max(before, abs(velocity.travel_mps))
            case Called() | Observed():
                pass
            case _:
                pass

    def chronicle(self) -> Chronicle:
        lived = {each.identity for each in self._reports if each.identity is not None}
        rejected = {
            (each.identity, each.text) for each in self._reports if each.identity is not None
        }
        return Chronicle(
            until_utc_s=self._until_utc_s,
            reports=tuple(self._reports),
            asked=tuple(self._asked),
            declined=tuple(
                each
                for each in self._declined
                if each.identity not in lived or (each.identity, each.refusal.text) not in rejected
            ),
            situations=tuple(self._situations),
            leaves=tuple(
                sorted([*self._leaves, *self._running.values()], key=lambda e: e.began_utc_s)
            ),
            fastest=tuple(
                Fastest(identity, speed_mps, self._allowed_mps)
                for identity, speed_mps in self._fastest.items()
            ),
            slowing=self._slowing,
        )

    def _follow(self, node: NodeState, utc_s: float) -> None:
        run = self._running.get(node.path)
        if NodeStatus[node.status] is NodeStatus.RUNNING:
            began_s = utc_s if run is None else run.began_utc_s
            self._running[node.path] = LeafRun(node.path, began_s, None, node.message)
        else:
            self._end_leaf(node.path, utc_s)

    def _end_leaf(self, path: str, utc_s: float) -> None:
        run = self._running.pop(path, None)
        if run is not None:
            self._leaves.append(LeafRun(path, run.began_utc_s, utc_s, run.message))

    def _end_leaves(self, utc_s: float) -> None:
        for path in list(self._running):
            self._end_leaf(path, utc_s)
