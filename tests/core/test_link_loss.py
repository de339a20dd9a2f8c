"""What the rover does when nothing is heard of the ground: in stages, by mode, and told."""

from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import Command, DriveFor, Mode, MoveForward, Resume, SetTravelSpeed
from executive.commands.catalogue import ActivatePlan, SubmitPlan
from executive.reasons import Reason
from executive.reports import Identity, Stage
from executive.settings import LinkLoss, load_settings
from executive.settings_files import SettingsError, structure
from tests.support.kinematic import Bench
from tests.support.plans import plan

JACKAL = load_settings("jackal")
STAGES = [{"after_s": 2, "then": "hold"}, {"after_s": 10, "then": "stop"}]


def bench_with(folder: Path, **stages: object) -> Bench:
    loss = structure(stages, LinkLoss, "jackal.yaml")
    return Bench(folder, replace(JACKAL, link_loss=loss))


def told(bench: Bench) -> list[str]:
    reports = bench.heard.reports
    return [r.text for r in reports if r.reason is Reason.LINK_LOST and r.identity is None]


def test_by_default_it_goes_on(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(20.0), 1)
        assert bench.finish(1) is Stage.EXECUTED
        assert told(bench) == []


def test_motion_is_held_at_the_end_of_the_step_and_goes_on_when_the_ground_is_heard(
    tmp_path: Path,
) -> None:
    with bench_with(tmp_path, motion=STAGES[:1]) as bench:
        for number in (1, 2):
            bench.submit(MoveForward(3.0), number)
        assert bench.finish(1) is Stage.EXECUTED
        bench.run(20.0)
        assert bench.stages(2)[-1] is Stage.ACCEPTED
        assert told(bench) == [
            "nothing was heard from the ground for 2.0 s: the rover holds at the end of the step"
        ]
        bench.executive.ground.hear()
        assert bench.finish(2) is Stage.EXECUTED
        assert any(r.text == "the ground is heard again" for r in bench.heard.reports)


def test_teleoperation_is_stopped_until_resumed(tmp_path: Path) -> None:
    with bench_with(tmp_path, teleop=[{"after_s": 1, "then": "stop"}], motion=STAGES) as bench:
        bench.submit(DriveFor(0.5, 0.0, 30.0), 1)
        bench.run(0.9)
        bench.executive.ground.hear()
        bench.run(0.9)
        assert bench.executive.mode is Mode.TELEOP
        bench.run(0.3)
        assert bench.executive.mode.name == "STOPPED"
        assert (bench.stages(1)[-1], bench.last(1).reason) == (Stage.FAILED, Reason.LINK_LOST)
        assert "nothing was heard from the ground" in bench.executive.why
        bench.submit(Resume(), 2)
        bench.execute(MoveForward(0.2), 3)


def test_a_later_stage_follows_an_earlier_one(tmp_path: Path) -> None:
    with bench_with(tmp_path, motion=STAGES) as bench:
        bench.submit(MoveForward(15.0), 1)
        bench.run(11.0)
        assert len(told(bench)) == 2
        assert bench.executive.mode is Mode.STOPPED
        assert bench.last(1).reason is Reason.LINK_LOST


def test_a_plan_is_suspended_between_two_steps(tmp_path: Path) -> None:
    legs = '<moveForward distance="3" deadline_s="60"/>' * 3
    with bench_with(tmp_path, plan=STAGES[:1]) as bench:
        bench.submit(SubmitPlan(plan(f"<Sequence>{legs}</Sequence>")), 1)
        bench.submit(ActivatePlan("survey"), 2)
        bench.run(30.0)
        assert bench.executive.mode is Mode.PAUSED
        assert 2.9 < bench.rover.pose.x_m < 3.1
        assert bench.heard.plans[-1].done == 1


def test_stages_that_are_out_of_order_are_refused() -> None:
    with pytest.raises(SettingsError, match="the earliest comes first"):
        structure({"motion": STAGES[::-1]}, LinkLoss, "jackal.yaml")
    with pytest.raises(SettingsError, match="'wait' is none of go_on, hold, stop"):
        structure({"plan": [{"after_s": 1, "then": "wait"}]}, LinkLoss, "jackal.yaml")


@pytest.mark.parametrize(("link", "signs"), [("ros", 0), ("direct", 1), ("relay", 1)])
def test_only_what_comes_by_a_link_with_the_ground_is_a_sign_of_it(
    tmp_path: Path, link: str, signs: int
) -> None:
    with bench_with(tmp_path, motion=[{"after_s": 2, "then": "go_on"}]) as bench:
        bench.submit(MoveForward(10.0), 1)
        bench.run(1.5)
        assert bench.executive.ground.silent_s > 1.4
        bench.send(Command(Identity("someone", 1), SetTravelSpeed(0.5), link))
        bench.run(1.0)
        assert len(told(bench)) == 1 - signs
