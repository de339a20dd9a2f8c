"""A small campaign whose workers are killed; and each fault is noticed."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache

import pytest

from sim.campaign.worker import Job, JobResult, run_job
from tests.stress import campaign_kills


def judged(seed: int = 3) -> dict[str, float]:
    reported: list[str] = []
    figures = campaign_kills.measure(1, seed, reported.append, "expired")
    return {figure.name.partition(": ")[2]: figure.value for figure in figures}


@cache
def played(job: Job) -> JobResult:
    """Play a run, once for all tests: these are about what becomes of it."""
    result = run_job(job)
    assert isinstance(result, JobResult)
    return result


@pytest.mark.slow
def test_every_run_is_present_once_after_any_kill() -> None:
    found = judged()
    assert found.pop("kills") == 1
    assert found.pop("runs") == campaign_kills.RUNS_PER_KILL
    assert set(found.values()) == {0}


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (lambda runs: runs[1:], campaign_kills.Fault.MISSING),
        (lambda runs: [replace(runs[0], digest="other"), *runs[1:]], campaign_kills.Fault.OTHER),
    ],
)
def test_each_fault_is_noticed(
    monkeypatch: pytest.MonkeyPatch,
    spoil: Callable[[list[JobResult]], list[JobResult]],
    fault: campaign_kills.Fault,
) -> None:
    spoils = iter([spoil, list])

    class NoClient:
        def __enter__(self) -> None:
            return None

        def __exit__(self, *_: object) -> None:
            return None

    def here(_: object, __: object, jobs: Iterable[Job]) -> Iterator[JobResult]:
        yield from next(spoils)([played(job) for job in jobs])

    monkeypatch.setattr(campaign_kills.Killer, "on_run", lambda *_: None)
    monkeypatch.setattr(campaign_kills, "local_cluster", lambda _: NoClient())
    monkeypatch.setattr(campaign_kills, "results", here)
    found = judged()
    assert found[fault.value] == 1
