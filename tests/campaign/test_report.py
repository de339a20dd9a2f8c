"""The report of a campaign says what came of it, by itself, in any browser; JUnit says the same."""

import shlex
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from itertools import pairwise
from math import inf, nextafter
from pathlib import Path
from typing import Final

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from junitparser import Failure, JUnitXml, Skipped
from pandas import Series

from sim.campaign.commands import campaign as command
from sim.campaign.draws import quantities
from sim.campaign.model import Campaign
from sim.campaign.reading import load_campaign
from sim.campaign.report import write_campaign_junit, write_report
from sim.campaign.report.charts import BINS, by_number, by_value
from sim.campaign.report.junit import MAX_CASES
from sim.campaign.report.page import MAX_WORST_RUNS, failure_groups, judgement_of, select_runs
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.session import CampaignSession, open_output
from sim.campaign.verdict import CampaignVerdict, CriterionStatus, clopper_pearson, judge
from sim.campaign.worker import run_job
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED, open_page

SHORT: Final = """\
title: A short way
duration: 4
timeline:
  - {at: 0.5, command: {moveForward: {distance: 0.4}}, label: go}
expect:
  - {command: go, ends: EXECUTED, within: 2}
"""
CAMPAIGN: Final = """\
title: Short <b>ways</b> & "quotes"
description: Two scenarios, & a fault in some runs.
scenarios: [brief.yaml, briefer.yaml]
runs: 14
seed: 3
vary:
  seed: {integers: [0, 1000]}
  world.friction: {uniform: [0.45, 0.75]}
  inject:
    choice: [none, wheels_stuck, {low_friction: {factor: {uniform: [0.1, 0.4]}}}]
    weights: [3, 2, 1]
    at: {uniform: [0.5, 1]}
criteria:
  - {success: 0.99}
  - {quantile: 0.5, of: duration_s, below: 100}
  - {quantile: 0.9, of: energy_j, below: 1000, where: inject != none}
"""
STEADY: Final = """\
title: Always alike
scenario: brief.yaml
runs: 40
vary:
  seed: {integers: [0, 1000]}
criteria:
  - {success: 0.9}
"""

AGAIN: Final = "rover campaign mine.yaml --out 'out 1' --resume --runs 1 --saved 3 --scheduler tcp://scheduler:8786"


class Watching:
    """Hears of a campaign, and says nothing."""

    def expect(self, total: int, done: int, succeeded: int) -> None: ...

    def on_run(self, run: CampaignRun) -> None: ...


@dataclass(frozen=True, slots=True)
class Reported:
    """A campaign with its report."""

    folder: Path
    campaign: Campaign
    runs: RunTable
    verdict: CampaignVerdict
    page: str
    junit: JUnitXml


def report(folder: Path, campaign: Campaign, runs: RunTable) -> Reported:
    verdict = judge(campaign, runs)
    page = write_report(folder, campaign, runs, verdict).read_text()
    junit = JUnitXml.fromfile(str(write_campaign_junit(folder, campaign, runs, verdict)))
    return Reported(folder, campaign, runs, verdict, page, junit)


def read(folder: Path, text: str) -> Campaign:
    (folder / "brief.yaml").write_text(SHORT)
    (folder / "briefer.yaml").write_text(SHORT.replace("distance: 0.4", "distance: 0.2"))
    (folder / "mine.yaml").write_text(text)
    return load_campaign("mine.yaml")


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Reported:
    """Give a campaign that was played, with its report."""
    folder = tmp_path_factory.mktemp("campaign")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        campaign = read(folder, CAMPAIGN)
        runs = RunTable(folder, quantities(campaign))
        CampaignSession(campaign, runs, lambda jobs: map(run_job, jobs), Watching()).run_missing()
        return report(folder, campaign, runs)


class Reader(HTMLParser):
    """What a page says, in its order; what it refers to; its elements."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.output: list[str] = []
        self.references: list[str] = []
        self.elements: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        self.references += [
            value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")
        ]

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.output.append(" ".join(data.split()))


def test_the_verdict_is_first_then_each_criterion_with_figure_and_confidence(
    reported: Reported,
) -> None:
    message = Reader(reported.page).output
    assert message.index("The campaign failed.") < message.index("Criteria")
    succeeded = f"{reported.verdict.succeeded} of 14 runs succeed"
    assert any(text.startswith(succeeded) for text in message)
    for judged in reported.verdict.judged:
        index = message.index(judged.criterion)
        assert message[index + 1] == judged.judgement.value
        assert message[index + 3] == f"{judged.passed} of {judged.runs}"
        assert "95 % confidence" in message[index + 4]


def test_what_people_wrote_is_escaped(reported: Reported) -> None:
    assert 'Short <b>ways</b> & "quotes"' in Reader(reported.page).output
    assert "<b>ways" not in reported.page


def test_it_needs_nothing_beside_it(reported: Reported) -> None:
    reader = Reader(reported.page)
    assert "script" not in reader.elements
    assert reader.references
    assert all(each.startswith(("data:", "#")) for each in reader.references)
    assert "url(" not in reported.page.replace("url(#", "")


def test_it_shows_success_against_all_that_varies_and_the_distributions(
    reported: Reported,
) -> None:
    message = Reader(reported.page).output
    for heading in ("scenario", "world.friction", "inject", "inject.at", "duration, s"):
        assert heading in message, heading
    assert "inject.factor of low_friction" in message
    assert "seed" not in message
    assert any(text.endswith("of 14 runs have it.") for text in message), "of inject.at"


def test_failures_are_grouped_and_each_is_counted_once(reported: Reported) -> None:
    groups = failure_groups(reported.runs)
    failed = list(reported.runs.read(failed=True))
    assert sum(group.runs for group in groups) == len(failed) > 1
    assert [group.runs for group in groups] == sorted((g.runs for g in groups), reverse=True)
    message = Reader(reported.page).output
    for group in groups:
        assert {group.expected, group.example.command} <= set(message)


def test_worst_runs_are_shown_with_map_reports_and_the_command_that_repeats_them(
    reported: Reported,
) -> None:
    groups = failure_groups(reported.runs)
    shown = select_runs(reported.runs, groups, MAX_WORST_RUNS)
    assert [run.run for run, _ in shown][: len(groups)] == [g.example.run for g in groups]
    extremes = {why for _, why in shown[len(groups) :]}
    assert "the maximum true error" in extremes
    reader = Reader(reported.page)
    assert reader.elements.count("img") == 2 * len(shown)
    for run, why in shown:
        assert run.command in reader.output
        assert any(why in text for text in reader.output)
        stored = reported.folder / "worst" / f"run-{run.run:06d}"
        assert (stored / "reports.jsonl").is_file()
        assert (stored / "data" / "ledger.sqlite").is_file()
    assert "not identical bit for bit" not in reported.page


def test_at_most_the_requested_runs_are_shown(reported: Reported) -> None:
    assert len(select_runs(reported.runs, failure_groups(reported.runs), 1)) == 1


def test_a_run_that_differs_when_it_is_repeated_is_reported(
    reported: Reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    campaign = read(tmp_path, CAMPAIGN)
    runs = RunTable(tmp_path, quantities(campaign))
    first = next(reported.runs.read())
    runs.add([replace(first, digest="0" * 64)])
    assert "not identical bit for bit" in report(tmp_path, campaign, runs).page


def alike(run: CampaignRun, number: int) -> CampaignRun:
    """Return a run under another number, that succeeded and has hardly a figure."""
    none = dict.fromkeys(("duration_s", "true_error_m", "true_error_rad", "detection_s"))
    figures = replace(run.figures, **none, false_executed=0)  # type: ignore[arg-type]
    return replace(run, run=number, scenario="brief.yaml", passed=True, figures=figures)


def test_empty_sections_are_stated_in_text(
    reported: Reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    campaign = read(tmp_path, STEADY)
    runs = RunTable(tmp_path, quantities(campaign))
    first = replace(next(reported.runs.read()), varied={"seed": 1}, failed_findings=())
    runs.add([alike(first, number) for number in range(40)])
    steady = report(tmp_path, replace(campaign, runs=39), runs)
    message = Reader(steady.page).output
    assert "The campaign passed." in message
    assert any("more than the 39 requested" in text for text in message)
    assert "No run failed." in message
    assert "Nothing varies except the seed." in message
    assert message.count("No run has this figure.") == 7
    assert any(text.startswith("It is ") for text in message), "the distance, alike in all runs"
    assert any(text.startswith("No run failed, and no run has a figure") for text in message)
    assert steady.junit.failures == steady.junit.skipped == 0


def test_a_campaign_is_as_good_as_the_worst_of_what_must_hold(reported: Reported) -> None:
    first = reported.verdict.judged[0]
    for worst, others in (
        (CriterionStatus.PASSED, ()),
        (CriterionStatus.UNDECIDED, (CriterionStatus.PASSED,)),
        (CriterionStatus.FAILED, (CriterionStatus.UNDECIDED, CriterionStatus.PASSED)),
        (CriterionStatus.EMPTY, (CriterionStatus.PASSED, CriterionStatus.FAILED)),
    ):
        judged = tuple(replace(first, judgement=each) for each in (*others, worst))
        assert judgement_of(replace(reported.verdict, judged=judged)) is worst


def test_junit_has_a_case_for_each_scenario_and_hold_and_each_failed_run(
    reported: Reported,
) -> None:
    assert not reported.verdict.passed
    suites = {suite.name: list(suite) for suite in reported.junit}
    assert list(suites) == ["all runs", "brief.yaml", "briefer.yaml"]
    for cases in suites.values():
        assert [case.name for case in cases][:3] == [str(h) for h in reported.campaign.criteria]
    failed = {f"run {run.run}": run for run in reported.runs.read(failed=True)}
    cases = [case for name in ("brief.yaml", "briefer.yaml") for case in suites[name][3:]]
    assert {case.name for case in cases} == set(failed)
    for case in cases:
        (result,) = case.result
        assert isinstance(result, Failure)
        assert failed[case.name].command in (result.message or "")


def test_junit_fails_if_and_only_if_the_campaign_does_and_is_bounded(
    reported: Reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    campaign = read(tmp_path, STEADY.replace("0.9", "0.1"))
    runs = RunTable(tmp_path, quantities(campaign))
    failed = next(reported.runs.read(failed=True))
    failed = replace(failed, scenario="brief.yaml", varied={"seed": 1})
    many = MAX_CASES + 50
    runs.add([replace(failed, run=number, passed=number >= many) for number in range(2 * many)])
    verdict = judge(campaign, runs)
    assert verdict.passed
    junit = JUnitXml.fromfile(str(write_campaign_junit(tmp_path, campaign, runs, verdict)))
    assert junit.failures == junit.errors == 0
    assert junit.skipped == MAX_CASES + 1
    (suite,) = [suite for suite in junit if suite.name == "brief.yaml"]
    *_, last = suite
    assert last.name == "50 more runs"
    assert isinstance(last.result[0], Skipped)


def test_junit_rates_a_scenario_only_by_its_runs(
    reported: Reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twenty runs are too few for 0.9, one hold is about the other scenario, and one fails."""
    monkeypatch.chdir(tmp_path)
    holds = """criteria:
  - {success: 0.9}
  - {success: 0.9, where: scenario == brief.yaml}
  - {quantile: 0.5, of: distance_m, above: 100}
"""
    campaign = read(tmp_path, CAMPAIGN.partition("criteria:")[0] + holds)
    runs = RunTable(tmp_path, quantities(campaign))
    first = alike(next(reported.runs.read()), 0)
    names = ["brief.yaml"] * 29 + ["briefer.yaml"] * 20
    runs.add([replace(first, run=run, scenario=name) for run, name in enumerate(names)])
    verdict = judge(campaign, runs)
    assert [each.judgement.value for each in verdict.judged] == ["passed", "passed", "failed"]
    junit = JUnitXml.fromfile(str(write_campaign_junit(tmp_path, campaign, runs, verdict)))
    found = {
        suite.name: [[type(result) for result in case.result] for case in suite] for suite in junit
    }
    assert found == {
        "all runs": [[], [], [Failure]],
        "brief.yaml": [[], [], [Failure]],
        "briefer.yaml": [[Skipped], [Failure]],
    }


def test_figures_that_differ_by_the_last_bit_are_alike(
    reported: Reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    campaign = read(tmp_path, CAMPAIGN)
    runs = RunTable(tmp_path, quantities(campaign))
    first = next(reported.runs.read(failed=False))
    near = replace(first.figures, energy_j=nextafter(first.figures.energy_j or 1.0, inf))
    friction = nextafter(float(first.varied["world.friction"] or 0), 1)
    varied = {**first.varied, "world.friction": friction}
    runs.add([first, replace(first, run=1, figures=near, varied=varied)])
    assert f"It is {near.energy_j:.4g} in each run" in report(tmp_path, campaign, runs).page


@pytest.mark.parametrize(
    ("trouble", "status", "message"),
    [
        (KeyboardInterrupt(), 130, "1 runs are saved in out 1; resume with: " + AGAIN),
        (OSError(28, "No space left on device"), 2, "cannot be written (No space left on device)"),
    ],
)
def test_a_report_that_is_cut_short_costs_no_run(
    reported: Reported,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    trouble: BaseException,
    status: int,
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    campaign = read(tmp_path, CAMPAIGN)
    runs = open_output(Path("out 1"), campaign, Path("mine.yaml"), resume=False)
    runs.add([next(reported.runs.read())])

    def interrupted(*_: object) -> Path:
        raise trouble

    monkeypatch.setattr("sim.campaign.report.write_report", interrupted)
    monkeypatch.setattr("sim.campaign.commands._cluster", lambda *_: nullcontext())
    monkeypatch.setattr("sim.campaign.cluster.results", lambda *_: iter(()))
    done = CliRunner().invoke(command, shlex.split(AGAIN)[2:])
    assert (done.exit_code, message in done.output) == (status, True), done.output
    assert Path("out 1/verdict.json").is_file()
    assert runs.numbers() == [0]


@given(
    st.lists(
        st.tuples(st.none() | st.floats(-1e6, 1e6), st.booleans()), min_size=1, max_size=80
    ).filter(lambda runs: any(value is not None for value, _ in runs))
)
def test_each_run_with_a_number_is_in_one_bin(runs: list[tuple[float | None, bool]]) -> None:
    shares = by_number(Series([value for value, _ in runs]), Series([held for _, held in runs]))
    known = [(value, held) for value, held in runs if value is not None]
    assert sum(share.runs for share in shares) == len(known)
    assert sum(share.passed for share in shares) == sum(held for _, held in known)
    assert len(shares) <= max(BINS, 12)
    for before, after in pairwise(shares):
        assert before.low <= before.high <= after.low
    for share in shares:
        assert share.interval == clopper_pearson(share.passed, share.runs)


def test_values_are_ordered_by_their_share_the_least_first() -> None:
    holds = Series([True, True, False, False, False])
    shares = by_value(Series(["b", "a", None, "a", "c"]), holds)
    assert [(each.name, each.passed, each.runs) for each in shares] == [
        ("c", 0, 1),
        ("a", 1, 2),
        ("b", 1, 1),
    ]


@pytest.fixture
def browser() -> None:
    """Skip a test where there is no browser; CI has one."""
    if BROWSER is None:
        assert not REQUIRED, "CI needs chromium from apt"
        pytest.skip("needs chromium from apt")


@pytest.mark.usefixtures("browser")
def test_a_browser_opens_it_without_a_network(reported: Reported, tmp_path: Path) -> None:
    page, picture = reported.folder / "report.html", ARTIFACTS / "campaign-report.png"
    opened = open_page(page, tmp_path, (1200, 6000), picture)
    assert opened.console == []
    assert opened.requests == []
    assert picture.stat().st_size > 50_000


@pytest.mark.usefixtures("browser")
def test_nothing_sticks_out_on_a_phone(reported: Reported, tmp_path: Path) -> None:
    measured = reported.page.replace("default-src 'none'", "script-src 'unsafe-inline'").replace(
        "</body>",
        "<script>document.title = `${document.documentElement.scrollWidth} ${innerWidth}`</script>",
    )
    (tmp_path / "phone.html").write_text(measured)
    picture = ARTIFACTS / "campaign-report-phone.png"
    opened = open_page(tmp_path / "phone.html", tmp_path, (420, 6000), picture)
    title = opened.document.partition("<title>")[2].partition("</title>")[0]
    across, window = map(int, title.split())
    assert across <= window <= 520


@pytest.mark.usefixtures("browser")
def test_a_failing_page_or_missing_resource_would_be_detected(tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text('<img src="http://example.org/x.png"><script>missing()</script>')
    opened = open_page(page, tmp_path, (400, 400), tmp_path / "bad.png")
    assert any("missing is not defined" in line for line in opened.console)
    assert "http://example.org/x.png" in opened.requests
