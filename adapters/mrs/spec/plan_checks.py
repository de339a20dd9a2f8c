"""Converts checks of plans to the wire: findings, verdicts, summaries of simulated runs."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from adapters.mrs.spec import types
from adapters.mrs.spec.types import PlanCheckLevel, PlanVerdict
from executive.values.reasons import Refusal

if TYPE_CHECKING:
    from executive.plans import Finding

CHECK_LIMIT_S: Final = {
    PlanCheckLevel.CHECK: 120.0,
    PlanCheckLevel.PROVE: 120.0,
    PlanCheckLevel.TRY: 600.0,
}
"""Maximum time of a check aboard, s; chosen, not measured."""
DRAWS: Final = 30
"""Number of runs of `TRY` by default."""
MAX_DRAWS: Final = 1000
MAX_LISTED: Final = 1000
"""Maximum number of findings and of limits in a result."""


def refused_check(refusal: Refusal) -> types.PlanCheck:
    """Return the result for a plan that the asset refuses."""
    code, text = refusal.reason.value, refusal.text
    return types.PlanCheck(
        verdict=PlanVerdict.REFUSED, limits=(), findings=(), code=code, refusal=text
    )


def wire_check(
    verdict: PlanVerdict,
    findings: "Sequence[Finding]" = (),
    limits: Sequence[str] = (),
    **more: Any,
) -> types.PlanCheck:
    """Return a result; with warnings or errors its verdict is `FAULTS`.

    Args:
        verdict: verdict without them.
        findings: its findings.
        limits: parts that were not explored exactly.
        more: the other fields.
    """
    is_faulty = any(each.level.name != types.FindingLevel.NOTE.name for each in findings)
    return types.PlanCheck(
        verdict=PlanVerdict.FAULTS if is_faulty else verdict,
        limits=tuple(limits[:MAX_LISTED]),
        findings=tuple(map(_finding, findings[:MAX_LISTED])),
        **more,
    )


def _finding(finding: "Finding") -> types.PlanFinding:
    level = types.FindingLevel[finding.level.name]
    return types.PlanFinding(level=level, line=finding.line, node=finding.node, text=finding.text)


def trial_of(found: Mapping[str, Any]) -> types.PlanTrial:
    """Return the summary of simulated runs, given as the JSON of `rover plan try`."""
    share, worst = found["share"], found.get("worst")
    return types.PlanTrial(
        draws=found["draws"],
        successes=found["completed"],
        successLow=share["low"],
        successHigh=share["high"],
        figures=tuple(
            types.TrialFigure(**{name: each[name] for name in _FIGURE}) for each in found["figures"]
        ),
        branches=tuple(
            types.TrialBranch(
                node=each["node"],
                line=each["line"],
                choice=str(each["choice"]),
                draws=each["draws"],
            )
            for each in found["branches"]
        ),
        worst=None if worst is None else _worst(worst),
    )


_FIGURE: Final = ("name", "unit", "low", "median", "high", "draws")


def _worst(worst: Mapping[str, Any]) -> str:
    end = "completed" if worst["completed"] else worst["reason"]
    least_m = worst["clearance_m"]
    return f"draw {worst['draw']}: {end}" + ("" if least_m is None else f", {least_m:.2f} m")
