"""`junit.xml` of a campaign: a case for each scenario and criterion, and for failed runs.

The file has a failure if and only if the campaign failed: a failed part of a campaign that
passed is skipped, with its message.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Final

from sim.campaign.model import Campaign
from sim.campaign.run_filter import RunFilter, Term
from sim.campaign.runs import RunTable
from sim.campaign.verdict import CampaignVerdict, CriterionResult, CriterionStatus, judge
from sim.scenario.junit import CaseStatus, JunitCase, JunitSuite, write_junit

NAME: Final = "junit.xml"
MAX_CASES: Final = 100
"""Maximum number of failed runs of a scenario that become cases; the others are counted."""


def write_campaign_junit(
    folder: Path, campaign: Campaign, runs: RunTable, verdict: CampaignVerdict
) -> Path:
    """Write `junit.xml` and return its path.

    Raises:
        SettingsError: the data set cannot be read.
    """
    trouble = CaseStatus.SKIPPED if verdict.passed else CaseStatus.FAILURE
    suites = [
        JunitSuite("all runs", [_case(each, each.criterion, trouble) for each in verdict.judged])
    ]
    suites += [_suite(campaign, each, runs, verdict, trouble) for each in campaign.scenarios]
    path = folder / NAME
    with path.open("wb") as file:
        write_junit(file, campaign.title, suites)
    return path


def _suite(
    campaign: Campaign, scenario: str, runs: RunTable, verdict: CampaignVerdict, trouble: CaseStatus
) -> JunitSuite:
    """Return the cases of one scenario: the criteria over its runs alone, and failed runs.

    A criterion that matches none of its runs has no case. One that its runs are too few to decide
    is skipped if all runs decide it.
    """
    term = Term("scenario", "==", scenario, scenario)
    took_s = float(runs.frame("seconds", where=RunFilter((term,)))["seconds"].sum())
    if not took_s:
        return JunitSuite(scenario, [])
    here = tuple(
        replace(each, where=RunFilter((term, *each.where.terms))) for each in campaign.criteria
    )
    judged = judge(replace(campaign, criteria=here), runs).judged
    cases = []
    for each, overall in zip(judged, verdict.judged, strict=True):
        undecided = (
            each.judgement is CriterionStatus.UNDECIDED and each.judgement != overall.judgement
        )
        if each.judgement is not CriterionStatus.EMPTY:
            cases.append(
                _case(each, overall.criterion, CaseStatus.SKIPPED if undecided else trouble)
            )
    return JunitSuite(scenario, [*cases, *_failed(runs, RunFilter((term,)), trouble)], took_s)


def _case(judged: CriterionResult, name: str, trouble: CaseStatus) -> JunitCase:
    passed = judged.judgement is CriterionStatus.PASSED
    return JunitCase(name, f"{judged.judgement.value}: {judged.text}", None if passed else trouble)


def _failed(runs: RunTable, here: RunFilter, trouble: CaseStatus) -> Iterator[JunitCase]:
    failed = runs.read(here, failed=True)
    for run in islice(failed, MAX_CASES):
        findings = "; ".join(run.failed_findings)
        yield JunitCase(f"run {run.run}", f"{findings}; repeat it by: {run.command}", trouble)
    more = sum(1 for _ in failed)
    if more:
        yield JunitCase(f"{more} more runs", "failed; all are in the data set", trouble)
