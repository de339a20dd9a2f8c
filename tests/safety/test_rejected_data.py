"""Data that arrive and cannot be used are reported as that, wherever they are missed."""

from contextlib import closing
from math import inf, nan
from pathlib import Path

import pytest

from adapters.recording import RunFile
from adapters.recording.replay import replay
from executive.commands import MoveForward, TakePicture
from executive.faults import DECLARED
from executive.values.facts import Imu, LaserScan, RejectedData, Source
from executive.values.reasons import Reason
from executive.values.reports import Report, ReportKind, Severity, Stage
from tests.support.kinematic import STEP_S, Bench
from trees import snapshot_of

pytestmark = pytest.mark.alike

NO_ROTATION = "orientation (0.0, 0.0, 0.0, 0.0) is not a rotation"
WHY = f"odometry arrives at 50 Hz and is rejected: {NO_ROTATION}"
ODOMETRY = RejectedData(Source.ODOMETRY, NO_ROTATION, 50.0, 50.0)


def rejecting(bench: Bench, fact: RejectedData, duration_s: float) -> None:
    """Let time pass in which an adapter repeats a rejection each second, as they do."""
    for step in range(round(duration_s / STEP_S)):
        if step % round(1.0 / STEP_S) == 0:
            bench.rover.facts.append(fact)
        bench.step()


def events(bench: Bench, reason: Reason) -> list[Report]:
    reports = bench.received.reports
    return [each for each in reports if each.kind is ReportKind.EVENT and each.reason is reason]


@pytest.mark.parametrize(
    ("fact", "text"),
    [
        (ODOMETRY, WHY),
        (
            RejectedData(Source.ODOMETRY, "pose is NaN", 5.0, 50.0),
            "odometry arrives at 50 Hz, 5 Hz of it rejected: pose is NaN",
        ),
        (
            RejectedData(Source.LASER, "no rays", 0.0),
            "laser scan arrives and is rejected: no rays",
        ),
        (
            RejectedData(Source.VELOCITY, "no subscriber to cmd_vel as Twist"),
            "velocity command is not received: no subscriber to cmd_vel as Twist",
        ),
    ],
)
def test_a_rejection_reads_with_its_rate_and_reason(fact: RejectedData, text: str) -> None:
    assert str(fact) == text


def test_rejected_odometry_is_in_the_refusal_in_why_and_in_the_faults(bench: Bench) -> None:
    bench.odometry = False
    rejecting(bench, ODOMETRY, 2.0)
    refusal = bench.refusal(MoveForward(1.0), 1)
    assert refusal.reason is Reason.NO_ODOMETRY
    assert refusal.text.startswith("no odometry for 2.")
    assert refusal.text.endswith(f"; {WHY}")
    assert bench.executive.why == f"standing: no odometry; {WHY}"
    faults = {each.name: each.refusal.text for each in bench.executive.safety.active}
    assert faults["odometry_rejected"] == WHY
    assert faults["odometry_silent"].endswith(f"; {WHY}")
    assert any(WHY in each.text for each in snapshot_of(bench.executive, 0.0).faults)


@pytest.mark.at_length
def test_a_rejection_is_reported_once_and_once_that_it_is_over(bench: Bench) -> None:
    rejecting(bench, ODOMETRY, 20.0)
    (warning,) = events(bench, Reason.DATA_REJECTED)
    assert (warning.severity, warning.text) == (Severity.WARNING, WHY)
    bench.run(4.0)
    (over,) = events(bench, Reason.FAULT_CLEARED)
    assert over.text == "odometry_rejected cleared"
    bench.execute(MoveForward(0.5), 1)


def test_a_motion_that_odometry_leaves_says_why_it_was_not_used(bench: Bench) -> None:
    bench.drive_on()
    bench.odometry = False
    rejecting(bench, ODOMETRY, 1.0)
    assert bench.last(1).reason is Reason.ODOMETRY_STALE
    assert bench.last(1).text.endswith(f"; {WHY}")


def test_a_base_that_receives_nothing_is_why_it_does_not_go(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    why = "no subscriber to cmd_vel as Twist, the base subscribes as TwistStamped"
    for name in ("advance", "drive"):
        monkeypatch.setattr(bench.rover, name, lambda _: None)
    rejecting(bench, RejectedData(Source.VELOCITY, why), 2.0)
    bench.submit(MoveForward(1.0), 1)
    rejecting(bench, RejectedData(Source.VELOCITY, why), 4.0)
    assert bench.last(1).stage is Stage.FAILED
    assert bench.last(1).text.endswith(f"; velocity command is not received: {why}")
    assert len(events(bench, Reason.DATA_REJECTED)) == 1


def test_a_picture_that_does_not_come_says_which_came_and_was_none(bench: Bench) -> None:
    bench.rover.camera_works = False
    bench.submit(TakePicture(), 1)
    webp = "camera frame of format 'webp' is neither JPEG nor PNG"
    rejecting(bench, RejectedData(Source.CAMERA, webp, 2.0, 2.0), 10.0)
    assert bench.last(1).reason is Reason.CAPTURE_DEADLINE
    assert bench.last(1).text.endswith(f"; camera frame arrives at 2 Hz and is rejected: {webp}")


@pytest.mark.parametrize("source", list(Source))
def test_each_source_has_a_row_and_is_replayed(source: Source, tmp_path: Path) -> None:
    assert f"{source.name.lower()}_rejected" in DECLARED
    with closing(RunFile(tmp_path / "run.mcap")) as tape, Bench(tmp_path, tape=tape) as bench:
        rejecting(bench, RejectedData(source, NO_ROTATION, 50.0, 60.0), 3.0)
        assert len(events(bench, Reason.DATA_REJECTED)) == 1
        bench.rover.facts += [
            LaserScan(1.0, 0.0, 0.1, 0.0, inf, (1.0, nan, inf, -inf)),
            Imu(1.0, nan, nan, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81),
        ]
        bench.submit(MoveForward(0.3), 1)
        bench.finish(1)
    assert replay(tmp_path / "run.mcap").difference is None
