"""Verdicts, by their meaning."""

import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from rich.console import Console

from sim.campaign.draws import ValueKind, VariedQuantity
from sim.campaign.model import Campaign, Criterion, Quantile, Success, Until
from sim.campaign.progress import show
from sim.campaign.run_filter import RunFilter
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.verdict import (
    FILE,
    CampaignVerdict,
    CriterionResult,
    CriterionStatus,
    clopper_pearson,
    judge,
    quantile,
)
from sim.scenario.outcome import RunMetrics

FIGURES = RunMetrics(
    duration_s=5.0,
    true_error_m=0.05,
    true_error_rad=None,
    distance_m=3.0,
    energy_j=300.0,
    detection_s=None,
    stopping_m=None,
    contacts=None,
    executed=1,
    failed=0,
    false_executed=0,
    reasons=(),
)
RUN = CampaignRun(
    run=0,
    scenario="locomotion",
    seed=1,
    varied={"inject": "none", "world.friction": 0.5},
    figures=FIGURES,
    passed=True,
    failed_findings=(),
    digest="",
    seconds=0.4,
    command="rover scenario locomotion",
)
VARIED = (
    VariedQuantity("inject", ValueKind.TEXT),
    VariedQuantity("world.friction", ValueKind.NUMBER),
)


def judged(folder: Path, hold: Criterion, *runs: CampaignRun) -> CriterionResult:
    data = RunTable(folder, VARIED)
    data.add([replace(run, run=number) for number, run in enumerate(runs)])
    campaign = Campaign(title="", scenarios=("locomotion",), runs=1, criteria=(hold,))
    (found,) = judge(campaign, data).judged
    return found


def seen(*values: float | None, **figures: float | None) -> list[CampaignRun]:
    return [
        replace(RUN, figures=replace(FIGURES, detection_s=value, **figures))  # type: ignore[arg-type]
        for value in values
    ]


def outcomes(held: int, failed: int) -> list[CampaignRun]:
    return [RUN] * held + [replace(RUN, passed=False, failed_findings=("pose",))] * failed


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.floats(0.0, 1.0))
def test_a_quantile_is_not_exceeded_by_its_share(values: list[float], share: float) -> None:
    found = quantile(values, share)
    assert found in values
    assert sum(value <= found for value in values) >= share * len(values) - 1e-6
    assert sum(value < found for value in values) <= share * len(values) + 1e-6


@pytest.mark.parametrize(
    ("held", "failed", "judgement"),
    [
        (299, 0, CriterionStatus.PASSED),
        (298, 0, CriterionStatus.UNDECIDED),
        (472, 1, CriterionStatus.PASSED),
        (471, 1, CriterionStatus.UNDECIDED),
        (90, 10, CriterionStatus.FAILED),
        (97, 3, CriterionStatus.UNDECIDED),
        (0, 1, CriterionStatus.FAILED),
    ],
)
def test_success_is_judged_with_confidence(
    tmp_path: Path, held: int, failed: int, judgement: CriterionStatus
) -> None:
    hold = Success(success=0.99)
    found = judged(tmp_path, hold, *outcomes(held, failed))
    assert found.judgement is judgement
    assert (found.passed, found.runs) == (held, held + failed)
    from scipy.stats import binomtest  # slow to import

    sides = [binomtest(held, held + failed, alternative=side) for side in ("greater", "less")]
    least, maximum = (side.proportion_ci(0.95) for side in sides)
    assert (found.low, found.high) == pytest.approx((least.low, maximum.high))


def test_the_required_number_of_runs_is_reported(tmp_path: Path) -> None:
    found = judged(tmp_path, Success(success=0.99), *outcomes(20, 0))
    assert "299 runs are needed if all meet it" in found.text


@pytest.mark.parametrize(
    ("failed", "judgement"), [(0, CriterionStatus.PASSED), (1, CriterionStatus.FAILED)]
)
def test_a_share_of_one_is_all_of_them(
    tmp_path: Path, failed: int, judgement: CriterionStatus
) -> None:
    assert judged(tmp_path, Success(success=1), *outcomes(3, failed)).judgement is judgement


def test_a_quantile_is_judged_with_confidence(tmp_path: Path) -> None:
    hold = Quantile(quantile=0.9, of="detection_s", below=1.0)
    fast, slow = seen(*[0.3] * 60), seen(1.0)
    assert judged(tmp_path / "1", hold, *fast).judgement is CriterionStatus.PASSED
    assert judged(tmp_path / "2", hold, *fast[:20]).judgement is CriterionStatus.UNDECIDED
    found = judged(tmp_path / "3", hold, *fast[:10], *slow * 10)
    assert (found.judgement, found.figure, found.passed) == (CriterionStatus.FAILED, 1.0, 10)


def test_a_quantile_may_be_bounded_below(tmp_path: Path) -> None:
    hold = Quantile(quantile=0.1, of="detection_s", above=1.0)
    found = judged(tmp_path, hold, *seen(*[2.0] * 60))
    assert found.judgement is CriterionStatus.PASSED
    assert found.required == pytest.approx(0.9)


def test_a_run_without_the_figure_meets_no_bound(tmp_path: Path) -> None:
    hold = Quantile(quantile=0.9, of="detection_s", below=1.0)
    found = judged(tmp_path, hold, *seen(*[0.3] * 30, *[None] * 30))
    assert (found.judgement, found.missing, found.figure) == (CriterionStatus.FAILED, 30, None)
    assert found.text.startswith("no detection_s in 30 runs")


@pytest.mark.parametrize("side", ["below", "above"])
def test_a_figure_that_no_run_has_meets_no_bound(tmp_path: Path, side: str) -> None:
    hold = Quantile(quantile=0.5, of="detection_s", **{side: 1.0})  # type: ignore[arg-type]
    found = judged(tmp_path, hold, *seen(*[None] * 100))
    assert (found.judgement, found.passed, found.runs) == (CriterionStatus.FAILED, 0, 100)
    assert (found.missing, found.figure) == (100, None)


@pytest.mark.parametrize(
    "hold",
    [
        Success(success=0.5, where=RunFilter.parse("inject == odometry_lost")),
        Quantile(quantile=0.5, of="duration_s", below=9.0, where=RunFilter.parse("executed > 7")),
    ],
)
def test_nothing_is_no_pass(tmp_path: Path, hold: Criterion) -> None:
    assert judged(tmp_path, hold, *outcomes(500, 0)).judgement is CriterionStatus.EMPTY


@pytest.mark.parametrize(
    ("where", "runs"),
    [
        ("inject == none", 2),
        ("inject != none", 1),
        ("world.friction < 0.55", 2),
        ("world.friction >= 0.6 and inject == tip", 1),
        ("scenario == locomotion", 3),
        ("scenario == expired", 0),
        ("detection_s < 10", 1),
        ("executed > 0", 3),
        ("world.friction == 0.6", 1),
        ("world.friction == 0.600001", 1),
        ("world.friction == 0.60001", 0),
        ("world.friction != 0.600001", 2),
        ("world.friction <= 28.64789deg", 2),
        ("seed == 1", 3),
        ("executed == 1 and false_executed <= 0", 3),
    ],
)
def test_conditions_choose_runs(tmp_path: Path, where: str, runs: int) -> None:
    tip = replace(seen(0.3)[0], varied={"inject": "tip", "world.friction": 0.6})
    hold = Success(success=0.5, where=RunFilter.parse(where))
    assert judged(tmp_path, hold, RUN, RUN, tip).runs == runs


def test_the_verdict_is_written_as_json(tmp_path: Path) -> None:
    data = RunTable(tmp_path, VARIED)
    data.add([replace(run, run=number) for number, run in enumerate(outcomes(9, 1))])
    holds = (Success(success=0.5), Success(success=0.99))
    campaign = Campaign(title="Ten", scenarios=("locomotion",), runs=10, criteria=holds)
    verdict = judge(campaign, data)
    verdict.write(tmp_path)
    reported = json.loads((tmp_path / FILE).read_text())
    assert (reported["title"], reported["runs"], reported["succeeded"], reported["passed"]) == (
        "Ten",
        10,
        9,
        False,
    )
    assert [each["judgement"] for each in reported["judged"]] == ["passed", "undecided"]
    assert not verdict.passed
    assert CampaignVerdict("", 1, 1, 0.0, 1.0, verdict.judged[:1]).passed


@pytest.mark.parametrize(
    ("requested", "held", "failed", "notes"),
    [
        (8, 8, 0, ()),
        (6, 7, 1, ("all 8 existing runs are judged, more than the 6 requested",)),
        (Until(until=0.5, max=100), 50, 50, ()),
        (
            Until(until=0.1, confidence=0.9, max=100),
            50,
            50,
            ("after 100 runs the interval of the success rate is 0.1728 wide, with confidence 0.9,"
             " and not 0.1",),
        ),
    ],
)  # fmt: skip
def test_an_unmet_criterion_is_noted(
    tmp_path: Path, requested: int | Until, held: int, failed: int, notes: tuple[str, ...]
) -> None:
    data = RunTable(tmp_path, VARIED)
    data.add([replace(run, run=number) for number, run in enumerate(outcomes(held, failed))])
    campaign = Campaign(
        title="", scenarios=("locomotion",), runs=requested, criteria=(Success(success=0.1),)
    )
    verdict = judge(campaign, data)
    verdict.write(tmp_path)
    printed = StringIO()
    show(Console(file=printed, width=200), verdict)
    assert verdict.notes == tuple(json.loads((tmp_path / FILE).read_text())["notes"]) == notes
    assert printed.getvalue().count("Note: ") == len(notes)
    assert all(note in printed.getvalue() for note in notes)


@given(st.integers(1, 300), st.floats(0.5, 0.999), st.floats(0.5, 0.999))
def test_what_holds_has_a_bound_that_does(runs: int, wanted: float, confidence: float) -> None:
    """All of n runs show a share s with confidence c if and only if s**n <= 1 - c."""
    assume(abs(wanted**runs - (1 - confidence)) > 1e-9)
    low = clopper_pearson(runs, runs, 2 * confidence - 1 if confidence > 0.5 else 0.0).low
    assert (low >= wanted) == (wanted**runs <= 1 - confidence)
