"""Predictions that accompany commands: told with their life, and compared at its end."""

from dataclasses import replace
from math import pi
from pathlib import Path

import pytest

from executive.commands import (
    ActivatePlan,
    DriveFor,
    MoveForward,
    MoveTo,
    RotateBy,
    Stop,
    SubmitPlan,
    SuspendPlan,
    Waypoint,
)
from executive.commands import ResumePlan as GoOn
from executive.goals import Context
from executive.obstacles.zones import KnownRock, Zones
from executive.settings import load_settings
from executive.values.geometry import STANDING
from executive.values.reasons import PREDICTED, Reason
from executive.values.reports import Identity, Report, ReportKind, Stage
from tests.support.kinematic import ALL_STAGES, STEP_S, Bench, KinematicRover
from tests.support.plans import AHEAD, BACK, plan
from trees import RoverTree

pytestmark = pytest.mark.alike

ROUND = MoveTo(Waypoint(3.0, 2.0, pi / 2))


def predictions(bench: Bench) -> list[Report]:
    return [
        r for r in bench.received.reports if r.kind is ReportKind.EVENT and "predicted:" in r.text
    ]


def figures(report: Report) -> dict[str, float]:
    return {each.name: each.value for each in report.figures}


def be_woken(bench: Bench) -> None:
    """Have the executive served as often as it asks for it, as a process does between ticks."""
    woken = [True]
    bench.executive.wake = lambda: woken.append(True)
    while woken:
        woken.clear()
        bench.executive.serve_inbox()


@pytest.mark.at_length
def test_a_motion_is_reported_with_its_prediction_and_then_with_its_result(bench: Bench) -> None:
    bench.execute(ROUND, 1)
    (reported,) = predictions(bench)
    assert (reported.identity, reported.stage, reported.link) == (
        Identity("MOE", 1),
        None,
        "direct",
    )
    assert reported.text.startswith("MOE:1 moveTo predicted: 6.5 s, 3.7 m, 353 J, end (3.00, 2.")
    assert bench.stages(1) == ALL_STAGES
    predicted, became = figures(reported), figures(bench.last(1))
    assert {name: became[name] for name in predicted} == predicted
    for name in ("duration", "length", "x", "y", "heading"):
        assert became[name] == pytest.approx(predicted[PREDICTED + name], rel=0.05, abs=0.03), name
    assert len(became) == len(bench.last(1).figures)


@pytest.mark.at_length
def test_it_arrives_early_in_the_motion_and_does_not_delay_the_answer(
    bench: Bench,
) -> None:
    bench.submit(MoveTo(Waypoint(20.0, 0.0)), 1)
    assert predictions(bench) == []
    while not predictions(bench):
        bench.step()
    bench.finish(1)
    took_s = figures(bench.last(1))["duration"]
    (reported,), began = predictions(bench), bench.received.reports[0]
    assert reported.utc_s - began.utc_s < 0.6 * took_s


def test_where_it_is_woken_a_prediction_is_there_before_the_next_tick(bench: Bench) -> None:
    bench.submit(ROUND, 1)
    be_woken(bench)
    assert len(predictions(bench)) == 1
    assert bench.stages(1) == ALL_STAGES[:3]


def test_a_slice_is_two_ticks_of_the_copy(tmp_path: Path) -> None:
    ticked = []

    class Counting(RoverTree):
        def tick(self) -> None:
            ticked.append(self)
            super().tick()

    with Bench(tmp_path, build_tree=Counting) as bench:
        bench.submit(ROUND, 1)
        bench.step()  # starts the motion, in place of a tick
        for _ in range(20):
            ticked.clear()
            bench.step()
            assert len([tree for tree in ticked if tree is not bench.executive.tree]) == 2


def test_motions_that_wait_are_predicted_from_where_those_before_lead(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 1)
    bench.submit(MoveForward(1.0), 2)
    while len(predictions(bench)) < 2:
        bench.step()
    assert bench.stages(2) == ALL_STAGES[:2]
    assert figures(predictions(bench)[1])["predicted x"] == pytest.approx(3.0, abs=0.05)


def test_a_failure_reports_the_result_of_the_motion(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    be_woken(bench)
    bench.run(2.0)
    bench.odometry = False
    assert bench.finish(1) is Stage.FAILED
    last = bench.last(1)
    assert last.reason is Reason.ODOMETRY_STALE
    assert figures(last)["length"] == pytest.approx(1.5, abs=0.1)
    assert figures(last)["predicted length"] == pytest.approx(5.0, abs=0.05)


def test_nothing_is_predicted_for_an_ended_motion(bench: Bench) -> None:
    bench.submit(ROUND, 1)
    bench.submit(MoveForward(1.0), 2)
    bench.step()
    bench.submit(Stop(), 3)
    bench.run(3.0)
    assert bench.stages(1)[-1] is bench.stages(2)[-1] is Stage.CANCELLED
    assert predictions(bench) == []
    assert bench.stages(3)[-1] is Stage.EXECUTED


@pytest.mark.at_length
def test_a_repeat_gets_the_last_report_again(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(9.0, 0.0)), 1)
    while not predictions(bench):
        bench.step()
    bench.submit(MoveTo(Waypoint(9.0, 0.0)), 1)
    assert bench.received.reports[-1].stage is Stage.STARTED


def test_after_a_crash_nothing_is_left_of_a_prediction(bench: Bench) -> None:
    bench.submit(ROUND, 1)
    bench.step()
    bench.crash()
    bench.run(1.0)
    assert bench.last(1).reason is Reason.INTERRUPTED
    assert bench.last(1).figures == ()
    assert predictions(bench) == []


@pytest.mark.at_length
@pytest.mark.parametrize("options", [{"report_progress": False}, {"link": "plan"}])
def test_a_client_without_progress_gets_no_prediction(
    bench: Bench, options: dict[str, object]
) -> None:
    if "link" in options:
        bench.submit(SubmitPlan(plan(AHEAD)), 1)
        bench.submit(ActivatePlan("survey"), 2)
    else:
        bench.submit(MoveForward(4.0), 1, **options)
    bench.run(8.0)
    assert [report for report in predictions(bench) if report.identity is not None] == []


def test_velocities_of_a_joystick_are_not_predicted(bench: Bench) -> None:
    bench.replace(DriveFor(0.3, 0.0, 2.0), 1)
    bench.finish(1)
    bench.submit(DriveFor(0.3, 0.0, 2.0), 2)
    bench.finish(2)
    assert [reported.identity for reported in predictions(bench)] == [Identity("MOE", 2)]
    assert figures(bench.last(1))["length"] == pytest.approx(0.6, abs=0.05)


@pytest.mark.at_length
def test_a_plan_is_reported_with_its_prediction_and_its_result(bench: Bench) -> None:
    bench.submit(SubmitPlan(plan(f"<Sequence>{AHEAD}{BACK}</Sequence>")), 1)
    bench.submit(ActivatePlan("survey"), 2)
    bench.run(30.0)
    (reported,) = predictions(bench)
    assert reported.text.startswith("plan survey predicted: ")
    ended = next(r for r in bench.received.reports if "plan survey COMPLETED" in r.text)
    became = figures(ended)
    assert became["length"] == pytest.approx(became["predicted length"], abs=0.1)
    assert became["duration"] == pytest.approx(became["predicted duration"], rel=0.05, abs=0.3)


SLOWLY = '<setTravelSpeed speed="0.4" deadline_s="5"/><setRotateSpeed speed="0.5" deadline_s="5"/>'
TURN = '<rotateBy angle="2.0" deadline_s="60"/>'


@pytest.mark.at_length
@pytest.mark.parametrize(
    "body",
    [
        f"<Sequence>{SLOWLY}{AHEAD}{TURN}</Sequence>",
        f'<Sequence><Timeout msec="20000">{AHEAD}</Timeout>{TURN}</Sequence>',
        f'<Sequence>{TURN}<takePicture deadline_s="9"/>{TURN}{AHEAD}</Sequence>',
        f'<Repeat num_cycles="2"><Sequence>{AHEAD}{BACK}</Sequence></Repeat>',
        f"<Fallback>{AHEAD}{BACK}</Fallback>",
    ],
)
def test_a_plan_takes_its_predicted_time_for_any_steps(bench: Bench, body: str) -> None:
    bench.submit(SubmitPlan(plan(body)), 1)
    bench.submit(ActivatePlan("survey"), 2)
    bench.run(45.0)
    ended = next(r for r in bench.received.reports if "plan survey COMPLETED" in r.text)
    became = figures(ended)
    assert became["length"] == pytest.approx(became["predicted length"], abs=0.15)
    assert became["duration"] == pytest.approx(became["predicted duration"], rel=0.05, abs=0.4)


@pytest.mark.at_length
@pytest.mark.parametrize(
    "body",
    [
        AHEAD.replace("60", "2"),
        f'<Timeout msec="3000">{AHEAD}</Timeout>',
        f"<Sequence>{AHEAD}{AHEAD}</Sequence>",
        f"<Sequence>{TURN}{AHEAD.replace('4', '99')}{AHEAD.replace('4', '99')}</Sequence>",
    ],
)
def test_of_a_plan_that_would_not_do_nothing_is_predicted(tmp_path: Path, body: str) -> None:
    rock = KnownRock("boulder", 6.0, 0.0, 0.5)
    settings = replace(load_settings("jackal"), zones=Zones(rocks=(rock,)))
    with Bench(tmp_path, settings) as bench:
        bench.submit(SubmitPlan(plan(body)), 1)
        bench.submit(ActivatePlan("survey"), 2)
        bench.run(1.5)
        assert predictions(bench) == []
        assert bench.rover.sent[-1] != STANDING


@pytest.mark.at_length
def test_a_plan_that_was_suspended_is_not_compared(bench: Bench) -> None:
    bench.submit(SubmitPlan(plan(f"<Sequence>{AHEAD}{BACK}</Sequence>")), 1)
    bench.submit(ActivatePlan("survey"), 2)
    bench.run(6.0)
    bench.submit(SuspendPlan("survey"), 3)
    bench.run(1.0)
    bench.submit(GoOn("survey"), 4)
    bench.run(30.0)
    ended = next(r for r in bench.received.reports if "plan survey COMPLETED" in r.text)
    assert ended.figures == ()
    assert "plan survey SUSPENDED" in "".join(r.text for r in bench.received.reports)


def test_an_asset_without_previews_reports_the_results_of_its_motions(tmp_path: Path) -> None:
    mocup = load_settings("mocup")
    with Bench(
        tmp_path, replace(load_settings("jackal"), prediction=mocup.prediction, battery=None)
    ) as bench:
        bench.execute(RotateBy(1.0), 1)
        assert "predicted energy" not in figures(bench.last(1))


def test_an_exception_of_a_preview_is_contained(tmp_path: Path) -> None:
    class Broken(RoverTree):
        def __init__(self, context: Context) -> None:
            super().__init__(context)
            self._copy = context.clock is not bench_clock[0]

        def tick(self) -> None:
            if self._copy:
                raise RuntimeError("broken")
            super().tick()

    bench_clock: list[object] = [None]

    def build(context: Context) -> RoverTree:
        bench_clock[0] = bench_clock[0] or context.clock
        return Broken(context)

    with Bench(tmp_path, build_tree=build, rover=KinematicRover()) as bench:
        bench.execute(MoveForward(1.0), 1)
        assert predictions(bench) == []
        assert figures(bench.last(1))["length"] == pytest.approx(1.0, abs=2 * STEP_S)


@pytest.mark.at_length
def test_repeats_are_bit_identical(tmp_path: Path) -> None:
    def reported(folder: Path) -> list[Report]:
        folder.mkdir()
        with Bench(folder) as bench:
            bench.submit(ROUND, 1)
            bench.submit(RotateBy(1.0), 2)
            bench.run(12.0)
            return [replace(report, utc_s=0.0) for report in bench.received.reports]

    assert reported(tmp_path / "a") == reported(tmp_path / "b")
