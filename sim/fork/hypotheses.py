"""`rank`: the simulated faults that explain a recording with an unknown fault, the best first.

Each declared fault is tried, with each side, from the moment when the recorded odometry departs
from that of a fork without a fault; then the best ones of different kinds with other begins and
figures.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf
from typing import Any, Final

from executive.settings import Settings
from executive.values.geometry import wrap_rad
from sim.fork.model import AddedFault, Change, ForkRun
from sim.rover.faults import (
    Side,
    SimulatedFault,
    bounds,
    declared_faults,
    fault_declaration,
    fault_targets_of,
    format_fault,
    unsupported_reason,
)

APART_M: Final = 0.03
"""Difference of two odometries after which they depart; chosen, above the noise of two runs."""
LEAD_S: Final = 0.2
"""Time from the begin of a fault to that difference; chosen."""
BEGINS_S: Final = (-0.5, -0.2, 0.2)
FACTORS: Final = (-1.0, 0.6, 1.7)
"""Further begins, and factors of figures, of the best ones; chosen."""
REFINED: Final = 3
"""Number of the best kinds that are refined, this often; chosen."""
EXPLAINED: Final = 3.0
"""Maximum score of a hypothesis that explains a recording; chosen."""
DIGITS: Final = 6
"""Decimal digits of begins and figures, so that none is tried again."""
OTHER_STAGE: Final = 4.0
OTHER_REASON: Final = 2.0
"""Scores of another last stage, and of another reason, of a command."""
END_S: Final = 0.5
OFF_M: Final = 0.1
"""Differences of the ends, and of the odometry on average, that score 1."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A fault, and how far a fork with it is from the recording: 0 is equal."""

    fault: AddedFault
    score: float

    def document(self) -> dict[str, Any]:
        """Return it as JSON data."""
        fault, begin_s = format_fault(self.fault.fault), self.fault.begin_s
        return {"fault": fault, "begin_s": begin_s, "score": self.score}

    def __str__(self) -> str:
        ((name, figures),) = format_fault(self.fault.fault).items()
        given = "".join(f", {key} {value}" for key, value in figures.items())
        return f"{name}{given}, from {self.fault.begin_s:.2f} s: score {self.score:.2f}"


def rank(
    recorded: ForkRun,
    unchanged: ForkRun,
    settings: Settings,
    scores: Callable[[Sequence[Change], float], Sequence[float]],
) -> list[Hypothesis]:
    """Return the best hypothesis of each kind of fault, the best first.

    Args:
        recorded: the recording.
        unchanged: its fork without a fault.
        settings: settings of the run; they determine the faults that the rover can have.
        scores: returns the `score` of a fork at a time with each change.
    """
    departs_s = _departs_s(recorded, unchanged)
    begin_s = round(max(0.0, departs_s - LEAD_S), DIGITS)
    # All forks begin before the first fault: a later fork would follow the recording for longer.
    at_s = max(0.0, begin_s + REFINED * min(BEGINS_S))

    def tried(faults: Sequence[AddedFault]) -> list[Hypothesis]:
        found = scores([Change(faults=(each,)) for each in faults], at_s)
        return [Hypothesis(each, score) for each, score in zip(faults, found, strict=True)]

    ranked = tried([AddedFault(each, begin_s) for each in possible_faults(settings)])
    for _ in range(REFINED):
        known = [each.fault for each in ranked]
        best = _best_of_kinds(ranked)[:REFINED]
        others = dict.fromkeys(other for each in best for other in _others(each.fault))
        ranked += tried([e for e in others if e not in known and e.begin_s <= departs_s])
    return _best_of_kinds(ranked)


def _best_of_kinds(tried: Sequence[Hypothesis]) -> list[Hypothesis]:
    best: dict[type[SimulatedFault], Hypothesis] = {}
    for each in sorted(tried, key=lambda each: each.score):
        best.setdefault(type(each.fault.fault), each)
    return [*best.values()]


def possible_faults(settings: Settings) -> Iterator[SimulatedFault]:
    """Yield each fault that the rover of an asset can have, with each side and choice."""
    parts = fault_targets_of(settings)
    for declared in declared_faults():
        if unsupported_reason(declared.kind, parts) is None:
            chosen = {
                each.field: tuple(Side) if each.kind is Side else (False, True)
                for each in declared.parameters
                if each.kind is not float
            }
            for values in product(*chosen.values()):
                yield declared.kind(**dict(zip(chosen, values, strict=True)))


def _others(fault: AddedFault) -> Iterator[AddedFault]:
    """Yield a fault with other begins, then with other figures within their bounds."""
    for later_s in BEGINS_S:
        yield replace(fault, begin_s=round(max(0.0, fault.begin_s + later_s), DIGITS))
    inner: Any = fault.fault
    for each in fault_declaration(type(inner)).parameters:
        for factor in FACTORS if each.kind is float else ():
            value = round(getattr(inner, each.field) * factor, DIGITS)
            low, high = bounds(each)
            if low <= value <= high:
                yield replace(fault, fault=replace(inner, **{each.field: value}))


def score(recorded: ForkRun, forked: ForkRun) -> float:
    """Return how far a fork is from the recording: outcomes, ends and odometry."""
    end_s = max((each.end_s for each in recorded.outcome.commands), default=0.0) + END_S
    apart_m = [each for time_s, each in _differences(recorded, forked) if time_s <= end_s]
    total = sum(apart_m) / max(len(apart_m), 1) / OFF_M
    ends = {each.command: each for each in forked.outcome.commands}
    for each in recorded.outcome.commands:
        end = ends.get(each.command)
        if end is None or end.stage != each.stage:
            total += OTHER_STAGE
        else:
            total += OTHER_REASON * (end.reason != each.reason)
            total += min(abs(end.end_s - each.end_s) / END_S, OTHER_REASON)
    return total


def _departs_s(recorded: ForkRun, unchanged: ForkRun) -> float:
    """Return when two odometries depart, at the latest the end of a command that ends otherwise."""
    kinds = set(unchanged.outcome.kinds)
    ends_s = [each.end_s for each in recorded.outcome.commands if each.kind not in kinds]
    apart = (time_s for time_s, off_m in _differences(recorded, unchanged) if off_m > APART_M)
    return min([*ends_s, next(apart, inf), recorded.outcome.end_s])


def _differences(one: ForkRun, other: ForkRun) -> Iterator[tuple[float, float]]:
    """Yield time and difference of two odometries at equal times; 1 rad counts as 1 m."""
    poses = {round(each.time_s, 3): each.pose for each in other.odometry}
    for each in one.odometry:
        if pose := poses.get(round(each.time_s, 3)):
            off_rad = abs(wrap_rad(pose.heading_rad - each.pose.heading_rad))
            yield each.time_s, pose.point.distance_m(each.pose.point) + off_rad
