"""`TrialReport`: the outcomes of all runs of a plan together, as text and as a JSON document."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from math import inf
from typing import Any, Final

from executive.plans import PlanRoot, nodes
from executive.values.plan_nodes import NodeStatus
from sim.campaign.verdict import clopper_pearson, quantile
from sim.trial.run import TrialResult

CONFIDENCE: Final = 0.95
_FIGURE: Final = re.compile(r"-?\d+(\.\d+)?")
_FIGURES: Final[tuple[tuple[str, str, Callable[[TrialResult], float | None]], ...]] = (
    ("duration", "s", lambda run: run.duration_s if run.completed else None),
    ("energy", "J", lambda run: run.energy_j if run.completed else None),
    ("clearance", "m", lambda run: run.clearance_m),
)
"""Figures of a run; time and energy of a plan that ended early would be misleading."""


@dataclass(frozen=True, slots=True)
class Share:
    """The interval of the share of completed runs, with a confidence."""

    low: float
    high: float
    confidence: float


@dataclass(frozen=True, slots=True)
class FigureSpread:
    """The 5 %, 50 % and 95 % quantiles of a figure, and the number of runs with it."""

    name: str
    unit: str
    low: float
    median: float
    high: float
    draws: int


@dataclass(frozen=True, slots=True)
class BranchCount:
    """A choice of a node: how often it was chosen, and in how many runs."""

    node: str
    line: int
    kind: str
    choice: str
    count: int
    draws: int


@dataclass(frozen=True, slots=True)
class NodeCounts:
    """A node, the numbers of runs by the result of its last end, and how often it began in all."""

    node: str
    line: int
    kind: str
    success: int
    failure: int
    tries: int


@dataclass(frozen=True, slots=True)
class FailureGroup:
    """Failed runs with reasons that differ in numbers only; the reason is that of the first."""

    status: str
    reason: str
    count: int
    draws: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class WorstRun:
    """The worst run: a failed one, with the least clearance, then of maximum duration.

    Attributes:
        command: command line that repeats it bit for bit, with its map.
        folder: folder of its map, timeline and reports; empty for none.
    """

    draw: int
    completed: bool
    status: str
    reason: str
    clearance_m: float | None
    digest: str
    command: str
    folder: str


@dataclass(frozen=True, slots=True)
class TrialReport:
    """Outcomes of all runs of a plan."""

    plan: str
    begin_utc_s: float
    draws: int
    completed: int
    share: Share
    figures: tuple[FigureSpread, ...]
    branches: tuple[BranchCount, ...]
    nodes: tuple[NodeCounts, ...]
    failures: tuple[FailureGroup, ...]
    worst: WorstRun

    def document(self) -> dict[str, Any]:
        """Return it as JSON data; values are in SI units, named in the keys."""
        return asdict(self)

    def lines(self) -> Iterator[str]:
        """Yield it as text."""
        begin = datetime.fromtimestamp(self.begin_utc_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        share = f"{self.share.low:.3f} .. {self.share.high:.3f}"
        yield (
            f"{self.plan}: {self.completed} of {self.draws} draws completed, begin {begin};"
            f" share {share} with confidence {self.share.confidence:g}"
        )
        for each in self.figures:
            spread = f"{each.low:.4g} .. {each.high:.4g}"
            yield f"  {each.name:<9} {each.median:.4g} {each.unit} (5 .. 95 %: {spread})"
        for branch in self.branches:
            times = f"{branch.count} × in {branch.draws} draws"
            yield f"  line {branch.line}: {branch.node}: {branch.choice}, {times}"
        for group in self.failures:
            which = ", ".join(map(str, group.draws[:5])) + (" …" if group.count > 5 else "")
            yield f"  {group.count} × {group.status}: {group.reason} (draws {which})"
        worst = self.worst
        distance = "" if worst.clearance_m is None else f", clearance {worst.clearance_m:.2f} m"
        yield f"  worst: draw {worst.draw}, {worst.status}{distance}"
        if worst.folder:
            yield f"  its map: {worst.folder}/map.png"
        yield f"  {worst.command}"


def worst_of(runs: Sequence[TrialResult]) -> TrialResult:
    """Return the worst run: failed before completed, least clearance, maximum duration, first."""
    return min(
        runs,
        key=lambda run: (
            run.completed,
            inf if run.clearance_m is None else run.clearance_m,
            -run.duration_s,
            run.draw,
        ),
    )


def report_of(
    plan_id: str, root: PlanRoot, begin_utc_s: float, runs: Sequence[TrialResult], worst: WorstRun
) -> TrialReport:
    """Return the report of runs, at least one."""
    completed = sum(run.completed for run in runs)
    share = clopper_pearson(completed, len(runs), CONFIDENCE)
    return TrialReport(
        plan=plan_id,
        begin_utc_s=begin_utc_s,
        draws=len(runs),
        completed=completed,
        share=Share(share.low, share.high, CONFIDENCE),
        figures=tuple(_spreads(runs)),
        branches=tuple(_branches(root, runs)),
        nodes=tuple(_node_counts(root, runs)),
        failures=tuple(_failures(runs)),
        worst=worst,
    )


def _spreads(runs: Sequence[TrialResult]) -> Iterator[FigureSpread]:
    for name, unit, figure_of in _FIGURES:
        values = [value for run in runs if (value := figure_of(run)) is not None]
        if values:
            low, median, high = (quantile(values, share) for share in (0.05, 0.5, 0.95))
            yield FigureSpread(name, unit, low, median, high, len(values))


def _branches(root: PlanRoot, runs: Sequence[TrialResult]) -> Iterator[BranchCount]:
    counts: Counter[tuple[int, str]] = Counter()
    draws: Counter[tuple[int, str]] = Counter()
    for run in runs:
        for number, choice, count in run.choices:
            counts[number, choice] += count
            draws[number, choice] += 1
    by_number = {each.location.number: each for each in nodes(root)}
    for (number, choice), count in sorted(counts.items()):
        node = by_number[number]
        where = node.location.path, node.location.line, node.kind.name
        yield BranchCount(*where, choice, count, draws[number, choice])


def _node_counts(root: PlanRoot, runs: Sequence[TrialResult]) -> Iterator[NodeCounts]:
    for node in nodes(root):
        path = node.location.path
        found = [each for run in runs for each in run.nodes if each.path == path]
        results = Counter(each.result for each in found)
        counts = results[NodeStatus.SUCCESS], results[NodeStatus.FAILURE]
        tries = sum(each.tries for each in found)
        yield NodeCounts(path, node.location.line, node.kind.name, *counts, tries)


def _failures(runs: Sequence[TrialResult]) -> Iterator[FailureGroup]:
    groups: dict[tuple[str, str], list[TrialResult]] = {}
    for run in runs:
        if not run.completed:
            text = _FIGURE.sub("#", run.reason)
            groups.setdefault((run.status.name, text), []).append(run)
    for (status, _), found in sorted(groups.items(), key=lambda each: -len(each[1])):
        draws = tuple(run.draw for run in found)
        yield FailureGroup(status, found[0].reason, len(found), draws)
