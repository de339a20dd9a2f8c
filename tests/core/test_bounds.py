"""What is exactly at a bound, and what is just beyond it."""

from dataclasses import replace
from math import pi
from pathlib import Path

import pytest

from executive.commands import ActivatePlan, DeleteFile, DriveFor, FollowPath, SubmitPlan
from executive.commands.lifecycle import Accepted
from executive.obstacles.zones import KnownRock, Zones
from executive.plans.builder import MAX_NODES
from executive.settings import load_settings
from executive.values.geometry import STANDING, Velocity
from executive.values.reasons import Reason
from executive.values.reports import PlanStatus, Stage
from tests.support.kinematic import Bench, KinematicRover, ignoring
from tests.support.plans import PlanBench, plan

STEP = '<setTravelSpeed speed="0.5" deadline_s="9"/>'


def test_a_plan_has_a_bounded_number_of_nodes(tmp_path: Path) -> None:
    maximum, more = (f"<Sequence>{STEP * (MAX_NODES - 2 + each)}</Sequence>" for each in (0, 1))
    with PlanBench(tmp_path) as bench:
        assert isinstance(bench.request(SubmitPlan(plan(maximum))), Accepted)
        refused = bench.plan_refusal(SubmitPlan(plan(more, "larger")))
        assert refused.reason is Reason.PLAN_TOO_LARGE


def test_a_path_without_waypoints_is_invalid(bench: Bench) -> None:
    assert bench.refusal(FollowPath(()), 1).argument == 1


def test_a_plan_into_a_rock_is_predicted_to_it_and_fails_there(tmp_path: Path) -> None:
    jackal = load_settings("jackal")
    settings = replace(jackal, zones=Zones(rocks=(KnownRock("boulder", 3.0, 0.0, 0.3),)))
    ahead = '<moveForward distance="1" deadline_s="60"/>'
    with PlanBench(tmp_path, settings) as bench:
        bench.request(SubmitPlan(plan(f"<Sequence>{ahead * 3}</Sequence>")))
        bench.request(ActivatePlan("survey"))
        assert bench.until(PlanStatus.COMPLETED, PlanStatus.FAILED) is PlanStatus.FAILED


class Restless(KinematicRover):
    """Creeps on when it is to stand."""

    def drive(self, velocity: Velocity) -> None:
        super().drive(Velocity(0.06, 0.0) if velocity == STANDING else velocity)


@pytest.mark.at_length
def test_a_velocity_that_does_not_end_fails_once_its_time_is_up(tmp_path: Path) -> None:
    settings = ignoring("off_command", "steady_off_command", "uncommanded_travel")
    with Bench(tmp_path, settings, rover=Restless()) as bench:
        bench.submit(DriveFor(0.2, 0.0, 1.0), 1)
        assert bench.finish(1) is Stage.FAILED


def test_a_turn_of_more_than_a_round_is_driven_past_a_rock(tmp_path: Path) -> None:
    rocks = (KnownRock("boulder", 0.0, 2.0, 0.3),)
    settings = replace(load_settings("jackal"), zones=Zones(rocks=rocks))
    with Bench(tmp_path, settings) as bench:
        refused = bench.refusal(DriveFor(0.5, 0.5, 5 * pi), 1)
        assert refused.reason is Reason.PATH_BLOCKED


def test_an_absent_or_unnamed_plan_is_refused(bench: Bench) -> None:
    assert bench.refusal(DeleteFile("nowhere/picture.jpg"), 1).reason is Reason.NO_SUCH_FILE
    for number, (body, line) in enumerate(
        (
            (f'<Sequence name="a/b">{STEP}</Sequence>', 3),
            (f'<Timeout msec="86400001">{STEP}</Timeout>', 3),
        ),
        2,
    ):
        refused = bench.refusal(SubmitPlan(plan(body)), number)
        assert refused.reason is Reason.PLAN_BAD_ARGUMENT
        assert f"line {line}" in refused.text


@pytest.mark.at_length
def test_a_plan_is_predicted_with_the_speed_that_it_sets(tmp_path: Path) -> None:
    with PlanBench(tmp_path) as bench:
        ahead = '<moveForward distance="2" deadline_s="60"/>'
        slow = '<setTravelSpeed speed="0.2" deadline_s="9"/>'
        bench.begin(f"<Sequence>{slow}{ahead}</Sequence>")
        assert bench.until(PlanStatus.COMPLETED) is PlanStatus.COMPLETED
        predicted = [
            figure.value
            for report in bench.received.reports
            for figure in report.figures
            if figure.name == "predicted duration" and report.identity is None
        ]
        assert predicted == [pytest.approx(10.2, abs=0.5)] * len(predicted)
        assert predicted
