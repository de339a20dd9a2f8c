"""Two runs are compared by contacts, then false EXECUTED, then commands that are not EXECUTED."""

from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import MoveForward
from executive.values.geometry import Pose
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from sim.fork.judge import BETTER, SAME, UNKNOWN, WORSE, compare, judge
from sim.fork.model import CommandOutcome, ForkOutcome, ForkRun
from sim.scenario.record import AdmittedRequest, Record, TruePose

GO = Identity("MOE", 1)
START_UTC_S = 1_800_000_000.0


def run(
    stage: Stage,
    reason: str = "",
    contacts: int | None = 0,
    true_m: float = 1.0,
    end_s: float = 3.0,
) -> ForkRun:
    """Return a run of `moveForward 1` that truly drove `true_m`, from 0.5 s on."""
    record = Record(START_UTC_S, Path())
    record.requested.append(AdmittedRequest(GO, MoveForward(1.0)))
    record.poses += [
        TruePose(0.05 * n, Pose(min(true_m, max(0.0, 0.05 * n - 0.5)))) for n in range(100)
    ]
    for sequence, (reached, time_s) in enumerate(((Stage.STARTED, 0.0), (stage, end_s)), 1):
        record.reports.append(
            Report(
                sequence=sequence,
                utc_s=START_UTC_S + time_s,
                kind=ReportKind.COMMAND,
                severity=Severity.INFORMATIONAL,
                text="moveForward",
                identity=GO,
                stage=reached,
                link="direct",
            )
        )
    outcome = CommandOutcome("MOE:1", "moveForward", stage.name, reason, "", end_s, None)
    forked = ForkOutcome(
        at_s=None,
        placing=None,
        seed=None,
        end_s=5.0,
        commands=(outcome,),
        pose=None,
        contacts=contacts,
    )
    return ForkRun(forked, record, ())


GOOD = run(Stage.EXECUTED)
FAILED = run(Stage.FAILED, "OFF_TARGET")
FALSE = run(Stage.EXECUTED, true_m=0.5)
OPEN = run(Stage.STARTED)


@pytest.mark.parametrize(
    ("before", "after", "verdict", "reason"),
    [
        (FAILED, GOOD, BETTER, "all EXECUTED; before: MOE:1 FAILED OFF_TARGET"),
        (GOOD, FAILED, WORSE, "MOE:1 FAILED OFF_TARGET; before: all EXECUTED"),
        (GOOD, GOOD, SAME, ""),
        (OPEN, GOOD, SAME, ""),
        (OPEN, FAILED, SAME, ""),
        (GOOD, OPEN, WORSE, "MOE:1 STARTED; before: all EXECUTED"),
        (GOOD, run(Stage.EXECUTED, end_s=4.0), SAME, ""),
        (
            FAILED,
            run(Stage.FAILED, "DRIVE_DEADLINE"),
            SAME,
            "MOE:1 FAILED DRIVE_DEADLINE; before: MOE:1 FAILED OFF_TARGET",
        ),
    ],
)
def test_runs_are_compared(before: ForkRun, after: ForkRun, verdict: str, reason: str) -> None:
    assert compare(before, after) == (verdict, reason)


def test_a_false_executed_is_worse_than_a_failure() -> None:
    verdict, reason = compare(FAILED, FALSE)
    assert verdict == WORSE
    assert reason.startswith("MOE:1 0.500 m off, of 0.200 m allowed")
    assert compare(FALSE, FAILED)[0] == BETTER


def test_a_contact_is_worse_than_any_end() -> None:
    assert compare(FAILED, run(Stage.EXECUTED, contacts=2)) == (
        WORSE,
        "2 contacts; before: 0 contacts",
    )
    unknown = replace(FAILED, outcome=replace(FAILED.outcome, contacts=None))
    assert compare(unknown, run(Stage.EXECUTED, contacts=2))[0] == BETTER


def test_a_core_that_raises_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.fork.judge.Forkable", lambda _: 1 / 0)
    found = judge(Path("run.mcap"), None)
    assert found == (UNKNOWN, "the fork failed: ZeroDivisionError: division by zero")
