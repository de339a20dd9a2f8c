from collections.abc import Iterator
from pathlib import Path

import pytest

from executive.admission import Refused
from executive.commands import MoveForward, Resume, SetCameraAngles, SetTravelSpeed, Stop
from executive.facts import Odometry
from executive.geometry import STANDING, Pose
from executive.modes import Mode
from executive.plans.definition import PlanStatus
from executive.plans.requests import (
    AbortPlan,
    ActivatePlan,
    RemovePlan,
    ResumePlan,
    SubmitPlan,
    SuspendPlan,
)
from executive.reasons import Reason
from executive.reports import Kind, Stage
from tests.support.kinematic import WHOLE_LIFE
from tests.support.plans import PlanBench, plan

COMPLETED, FAILED, SUSPENDED = PlanStatus.COMPLETED, PlanStatus.FAILED, PlanStatus.SUSPENDED
AHEAD = '<moveForward distance="4" deadline_s="60"/>'
BACK = '<moveForward distance="-1" deadline_s="60"/>'
TOO_LATE = '<moveForward distance="50" deadline_s="1"/>'


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    bench = PlanBench(tmp_path)
    yield bench
    bench.executive.ledger.abandon()


def outcome(bench: PlanBench, body: str, others: str = "") -> PlanStatus:
    bench.go(plan(body, others=others))
    return bench.until(COMPLETED, FAILED)


def ends(bench: PlanBench) -> list[Stage]:
    return [stages[-1] for _, stages in bench.commanded()]


def test_a_sequence_commands_its_leaves_one_after_the_other(bench: PlanBench) -> None:
    turn, look = '<rotateBy angle="1.5" deadline_s="30"/>', '<takePicture deadline_s="9"/>'
    body = f"<Sequence>{BACK}{turn}{look}</Sequence>"
    assert outcome(bench, body) is COMPLETED
    assert [stages for _, stages in bench.commanded()] == [WHOLE_LIFE] * 3
    assert bench.rover.pose.x_m == pytest.approx(-1.0, abs=0.1)
    told = [(u.status, u.node.rpartition("/")[2], u.done, u.total) for u in bench.heard.plans]
    assert told == [
        (PlanStatus.SUBMITTED, "", 0, 3),
        (PlanStatus.ACTIVATED, "", 0, 3),
        (PlanStatus.EXECUTING, "", 0, 3),
        (PlanStatus.EXECUTING, "moveForward", 0, 3),
        (PlanStatus.EXECUTING, "rotateBy", 1, 3),
        (PlanStatus.EXECUTING, "takePicture", 2, 3),
        (COMPLETED, "takePicture", 3, 3),
    ]


def test_a_leaf_past_its_deadline_is_cancelled_and_a_fallback_goes_on(bench: PlanBench) -> None:
    assert outcome(bench, f"<Fallback>{TOO_LATE}{BACK}</Fallback>") is COMPLETED
    assert ends(bench) == [Stage.CANCELLED, Stage.EXECUTED]
    late = next(r for r in bench.of() if r.stage is Stage.CANCELLED)
    assert late.reason is Reason.PLAN_DEADLINE
    assert [f.value for f in late.figures] == [1.0]


def test_a_plan_that_fails_says_where_and_the_rover_stands(bench: PlanBench) -> None:
    assert outcome(bench, f"<Sequence>{TOO_LATE}{BACK}</Sequence>") is FAILED
    assert "plan:survey/Sequence/moveForward: CANCELLED" in bench.status().text
    event = [r for r in bench.heard.reports if r.kind is Kind.EVENT][-1]
    assert (event.reason, event.text[:18]) == (Reason.PLAN_FAILED, "plan survey FAILED")
    bench.run(2.0)
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.IDLE


def test_a_leaf_that_is_refused_fails(bench: PlanBench) -> None:
    body = f'<Fallback><delete path="nothing.jpg" deadline_s="5"/>{BACK}</Fallback>'
    assert outcome(bench, body) is COMPLETED
    assert ends(bench) == [Stage.REJECTED, Stage.EXECUTED]


def test_repeat_retry_and_inverter_run_their_child_as_often_as_they_say(bench: PlanBench) -> None:
    assert outcome(bench, f'<Repeat num_cycles="3">{BACK}</Repeat>') is COMPLETED
    assert ends(bench) == [Stage.EXECUTED] * 3
    assert (bench.status().done, bench.status().total) == (1, 1)
    bench.ask(RemovePlan("survey"))
    late = f'<RetryUntilSuccessful num_attempts="2">{TOO_LATE}</RetryUntilSuccessful>'
    assert outcome(bench, f"<Inverter>{late}</Inverter>") is COMPLETED
    assert ends(bench)[3:] == [Stage.CANCELLED] * 2


def test_a_timeout_cancels_what_is_below_it(bench: PlanBench) -> None:
    slow = f'<Sequence><moveForward distance="50"/>{AHEAD}</Sequence>'
    body = f'<Fallback><Timeout msec="1500">{slow}</Timeout>{BACK}</Fallback>'
    assert outcome(bench, body) is COMPLETED
    assert ends(bench) == [Stage.CANCELLED, Stage.EXECUTED]


@pytest.mark.parametrize(
    ("thresholds", "status", "stages"),
    [
        ("", COMPLETED, [Stage.EXECUTED, Stage.EXECUTED]),
        ('success_count="1"', COMPLETED, [Stage.CANCELLED, Stage.EXECUTED]),
    ],
)
def test_a_parallel_ends_when_enough_have(
    bench: PlanBench, thresholds: str, status: PlanStatus, stages: list[Stage]
) -> None:
    look = '<setAngles pan="0.5" deadline_s="20"/>'
    assert outcome(bench, f"<Parallel {thresholds}>{AHEAD}{look}</Parallel>") is status
    assert ends(bench) == stages


def test_a_parallel_fails_when_enough_have_failed(bench: PlanBench) -> None:
    late = TOO_LATE.replace("moveForward", 'moveForward name="late"')
    assert outcome(bench, f'<Parallel failure_count="1">{late}{AHEAD}</Parallel>') is FAILED
    assert ends(bench) == [Stage.CANCELLED, Stage.CANCELLED]


def test_a_subtree_sees_what_it_is_given(bench: PlanBench) -> None:
    leg = '<BehaviorTree ID="Leg"><moveForward distance="{far}" deadline_s="{=}"/></BehaviorTree>'
    body = (
        '<Sequence><SubTree ID="Leg" far="{way}" deadline_s="60"/>'
        '<SubTree ID="Leg" name="home" far="-2" deadline_s="60"/></Sequence>'
    )
    bench.go(plan(body, others=leg, way="2"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert bench.rover.pose.x_m == pytest.approx(0.0, abs=0.2)
    assert bench.status().node == "plan:survey/Sequence/home/moveForward"


def test_while_a_plan_executes_nobody_else_moves_the_rover(bench: PlanBench) -> None:
    bench.go(plan(AHEAD))
    bench.run(1.0)
    assert bench.executive.mode is Mode.PLAN
    assert "plan:survey:1 MoveForward" in bench.executive.why
    answer = bench.submit(MoveForward(1.0), 1)
    assert isinstance(answer, Refused)
    assert answer.refusal.reason is Reason.WRONG_MODE
    assert "suspend the plan" in answer.refusal.text
    bench.submit(SetCameraAngles(0.3, 0.0), 2)
    bench.submit(SetTravelSpeed(0.5), 3)
    assert bench.finish(2) is bench.finish(3) is Stage.EXECUTED
    assert bench.until(COMPLETED, FAILED) is COMPLETED


def test_suspended_the_rover_stands_and_resumed_the_leaf_is_asked_again(bench: PlanBench) -> None:
    bench.go(plan(f"<Sequence>{BACK}{AHEAD}</Sequence>"))
    bench.run(4.0)
    bench.ask(SuspendPlan("survey"))
    bench.run(2.0)
    assert bench.rover.velocity == STANDING
    assert ends(bench) == [Stage.EXECUTED, Stage.CANCELLED]
    assert bench.executive.mode is Mode.PAUSED
    assert "resumePlan" in bench.executive.why
    bench.submit(MoveForward(0.5), 1)
    assert bench.executive.mode.name == "MOVING"
    assert bench.finish(1) is Stage.EXECUTED
    bench.ask(ResumePlan("survey"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert ends(bench) == [Stage.EXECUTED, Stage.CANCELLED, Stage.EXECUTED]
    assert [number for number, _ in bench.commanded()] == [1, 2, 3]


def test_a_stop_suspends_and_resume_alone_does_not_go_on(bench: PlanBench) -> None:
    bench.go(plan(f"<Fallback>{AHEAD}{BACK}</Fallback>"))
    bench.run(1.0)
    bench.submit(Stop(), 1)
    assert bench.rover.velocity == STANDING
    assert bench.status().status is SUSPENDED
    refused = bench.ask(ResumePlan("survey"))
    assert isinstance(refused, Refused)
    assert refused.refusal.reason is Reason.WRONG_MODE
    bench.submit(Resume(), 2)
    bench.run(5.0)
    assert bench.rover.velocity == STANDING
    assert ends(bench) == [Stage.CANCELLED]
    bench.ask(ResumePlan("survey"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert ends(bench) == [Stage.CANCELLED, Stage.EXECUTED]


def test_a_hazard_suspends(bench: PlanBench) -> None:
    bench.go(plan(f"<Fallback>{AHEAD}{BACK}</Fallback>"))
    bench.run(1.0)
    bench.executive.observe(Odometry(bench.clock.now_s(), Pose(x_m=9.0), STANDING))
    bench.executive.tick()
    assert bench.executive.mode is Mode.SAFE
    assert bench.status().status is SUSPENDED
    assert ends(bench) == [Stage.CANCELLED]
    assert {r.reason for r in bench.of() if r.stage is Stage.CANCELLED} == {Reason.ODOMETRY_JUMPED}


def test_aborted_it_is_over(bench: PlanBench) -> None:
    bench.go(plan(AHEAD))
    bench.run(1.0)
    bench.ask(AbortPlan("survey"))
    assert bench.status().status is PlanStatus.ABORTED
    assert ends(bench) == [Stage.CANCELLED]
    answer = bench.ask(ResumePlan("survey"))
    assert isinstance(answer, Refused)
    assert answer.refusal.reason is Reason.PLAN_STATUS
    bench.ask(RemovePlan("survey"))
    assert not bench.executive.planner.updates()


def test_one_plan_has_the_rover(bench: PlanBench) -> None:
    bench.go(plan(AHEAD))
    bench.ask(SubmitPlan(plan(BACK, "second")))
    bench.run(0.5)
    for request, reason in (
        (ActivatePlan("second"), Reason.PLAN_ACTIVE),
        (ActivatePlan("third"), Reason.NO_SUCH_PLAN),
        (SubmitPlan(plan(BACK, "second")), Reason.PLAN_EXISTS),
        (RemovePlan("survey"), Reason.PLAN_STATUS),
    ):
        answer = bench.ask(request)
        assert isinstance(answer, Refused)
        assert answer.refusal.reason is reason
    bench.ask(SuspendPlan("survey"))
    bench.ask(ActivatePlan("second"))
    assert bench.until(COMPLETED, plan_id="second") is COMPLETED
    bench.ask(ResumePlan("survey"))
    assert bench.until(COMPLETED) is COMPLETED


def test_after_a_restart_it_is_suspended_and_goes_on_where_it_was(bench: PlanBench) -> None:
    bench.go(plan(f"<Sequence>{BACK}{AHEAD}</Sequence>"))
    bench.run(4.0)
    bench.crash()
    bench.step()
    assert bench.status().status is SUSPENDED
    assert bench.status().done == 1
    assert any("SUSPENDED: the executive was restarted" in r.text for r in bench.heard.reports)
    bench.run(1.0)
    assert bench.rover.velocity == STANDING
    bench.ask(ResumePlan("survey"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert ends(bench) == [Stage.EXECUTED, Stage.FAILED, Stage.EXECUTED]


def test_what_ended_while_nobody_looked_is_not_done_again(bench: PlanBench) -> None:
    """The command ended in the tick of the crash; its plan had not seen it yet."""
    bench.go(plan(f"<Sequence>{BACK}{AHEAD}</Sequence>"))
    while not ends(bench) or ends(bench)[0] is not Stage.EXECUTED:
        bench.step()
    bench.crash()
    bench.run(0.1)
    bench.ask(ResumePlan("survey"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert ends(bench) == [Stage.EXECUTED] * 2


@pytest.mark.parametrize(
    "first",
    [
        '<Inverter><Timeout msec="1500"><moveForward distance="50"/></Timeout></Inverter>',
        '<Parallel success_count="1"><moveForward distance="50" deadline_s="60"/>'
        '<setAngles pan="0.5" deadline_s="9"/></Parallel>',
    ],
)
def test_what_the_plan_went_on_without_is_not_asked_again(bench: PlanBench, first: str) -> None:
    bench.go(plan(f"<Sequence>{first}{AHEAD}</Sequence>"))
    while "moveForward" not in bench.status().node.partition("Sequence/")[2].split("/")[0]:
        bench.step()
    bench.run(0.5)
    before = len(bench.commanded())
    bench.crash()
    bench.run(0.1)
    bench.ask(ResumePlan("survey"))
    bench.run(0.3)
    assert len(bench.commanded()) == before + 1
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert len(bench.commanded()) == before + 1


def test_shut_down_it_is_suspended(bench: PlanBench) -> None:
    bench.go(plan(AHEAD))
    bench.run(1.0)
    bench.executive.close()
    assert ends(bench) == [Stage.CANCELLED]
    bench.crash()
    bench.run(0.1)
    assert bench.status().status is SUSPENDED
    assert "shut down" in bench.status().text
    bench.ask(ResumePlan("survey"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED


def test_a_leaf_that_raises_fails_its_plan_and_nothing_else(
    bench: PlanBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.go(plan(f"<Fallback>{AHEAD}{BACK}</Fallback>"))
    bench.run(1.0)

    def fail(*_: object) -> None:
        raise RuntimeError("broken")

    with monkeypatch.context() as broken:
        broken.setattr("executive.plans.work.Work.look", fail)
        bench.run(0.1)
    assert bench.status().status is FAILED
    assert bench.status().text == "plan:survey/Fallback/moveForward raised RuntimeError('broken')"
    assert ends(bench) == [Stage.CANCELLED]
    bench.run(2.0)
    assert bench.rover.velocity == STANDING
    bench.submit(MoveForward(0.5), 1)
    assert bench.finish(1) is Stage.EXECUTED


def test_without_a_ledger_nothing_more_is_begun(bench: PlanBench) -> None:
    bench.go(plan(f"<Sequence>{BACK}{AHEAD}</Sequence>"))
    bench.run(1.0)
    database = bench.executive.ledger._db
    database.execute("PRAGMA query_only = ON")
    bench.run(10.0)
    assert bench.executive.mode is Mode.SAFE
    assert bench.rover.velocity == STANDING
    assert bench.rover.pose.x_m == pytest.approx(-1.0, abs=0.1)
    database.execute("PRAGMA query_only = OFF")
    bench.run(0.1)
    assert bench.status().status is SUSPENDED
    bench.submit(Resume(), 1)
    bench.ask(ResumePlan("survey"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert ends(bench) == [Stage.EXECUTED, Stage.EXECUTED]


def test_numbers_of_a_removed_plan_are_not_used_again(bench: PlanBench) -> None:
    outcome(bench, BACK)
    bench.ask(RemovePlan("survey"))
    bench.crash()
    bench.run(0.1)
    outcome(bench, BACK)
    assert [number for number, _ in bench.commanded()] == [1, 2]


def test_a_plan_is_seen_in_the_tree(bench: PlanBench) -> None:
    bench.go(plan(f'<Repeat num_cycles="2"><Parallel>{AHEAD}</Parallel></Repeat>'))
    bench.run(1.0)
    tree = bench.executive.tree
    nodes = {node.path: node for node in tree.nodes()}  # type: ignore[attr-defined]
    assert nodes["plan:survey"].depth == 1
    assert nodes["plan:survey/Repeat/Parallel/moveForward"].status.name == "RUNNING"
    bench.ask(AbortPlan("survey"))
    assert not any(n.path.startswith("plan:") for n in tree.nodes())  # type: ignore[attr-defined]
