from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import (
    AbortPlan,
    ActivatePlan,
    Command,
    Mode,
    MoveForward,
    RemovePlan,
    Request,
    Resume,
    ResumePlan,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    SuspendPlan,
)
from executive.commands.lifecycle import Accepted, Duplicate, Rejected
from executive.values.facts import Odometry
from executive.values.geometry import STANDING, Pose
from executive.values.reasons import Reason
from executive.values.reports import Identity, PlanStatus, ReportKind, Stage
from tests.support.kinematic import ALL_STAGES
from tests.support.plans import AHEAD, BACK, TOO_LATE, PlanBench, plan
from trees import commands_by_node

COMPLETED, FAILED = PlanStatus.COMPLETED, PlanStatus.FAILED


def test_a_sequence_commands_its_leaves_one_after_the_other(bench: PlanBench) -> None:
    turn, poll = '<rotateBy angle="1.5" deadline_s="30"/>', '<takePicture deadline_s="9"/>'
    body = f"<Sequence>{BACK}{turn}{poll}</Sequence>"
    assert bench.outcome(body) is COMPLETED
    assert [stages for _, stages in bench.commanded()] == [ALL_STAGES] * 3
    assert bench.rover.pose.x_m == pytest.approx(-1.0, abs=0.1)
    reported = [
        (u.status, u.node.rpartition("/")[2], u.done, u.total) for u in bench.received.plans
    ]
    assert reported == [
        (PlanStatus.SUBMITTED, "", 0, 3),
        (PlanStatus.ACTIVATED, "", 0, 3),
        (PlanStatus.EXECUTING, "", 0, 3),
        (PlanStatus.EXECUTING, "moveForward", 0, 3),
        (PlanStatus.EXECUTING, "rotateBy", 1, 3),
        (PlanStatus.EXECUTING, "takePicture", 2, 3),
        (COMPLETED, "takePicture", 3, 3),
    ]


def test_a_leaf_past_its_deadline_is_cancelled_and_a_fallback_continues(bench: PlanBench) -> None:
    assert bench.outcome(f"<Fallback>{TOO_LATE}{BACK}</Fallback>") is COMPLETED
    assert bench.ends() == [Stage.CANCELLED, Stage.EXECUTED]
    late = next(r for r in bench.of() if r.stage is Stage.CANCELLED)
    assert late.reason is Reason.PLAN_DEADLINE
    assert [f.value for f in late.figures] == [1.0]


def test_a_plan_that_fails_names_the_leaf_and_the_rover_halts(bench: PlanBench) -> None:
    assert bench.outcome(f"<Sequence>{TOO_LATE}{BACK}</Sequence>") is FAILED
    assert "plan:survey/Sequence/moveForward: CANCELLED" in bench.status().text
    event = [r for r in bench.received.reports if r.kind is ReportKind.EVENT][-1]
    assert (event.reason, event.text[:18]) == (Reason.PLAN_FAILED, "plan survey FAILED")
    bench.run(2.0)
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.IDLE


@pytest.mark.at_length
def test_repeat_retry_and_inverter_run_their_child_as_often_as_declared(bench: PlanBench) -> None:
    assert bench.outcome(f'<Repeat num_cycles="3">{BACK}</Repeat>') is COMPLETED
    assert bench.ends() == [Stage.EXECUTED] * 3
    assert (bench.status().done, bench.status().total) == (1, 1)
    bench.request(RemovePlan("survey"))
    late = f'<RetryUntilSuccessful num_attempts="2">{TOO_LATE}</RetryUntilSuccessful>'
    assert bench.outcome(f"<Inverter>{late}</Inverter>") is COMPLETED
    assert bench.ends()[3:] == [Stage.CANCELLED] * 2


def test_a_timeout_cancels_its_children(bench: PlanBench) -> None:
    slow = f'<Sequence><moveForward distance="50"/>{AHEAD}</Sequence>'
    body = f'<Fallback><Timeout msec="1500">{slow}</Timeout>{BACK}</Fallback>'
    assert bench.outcome(body) is COMPLETED
    assert bench.ends() == [Stage.CANCELLED, Stage.EXECUTED]


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
    poll = '<setCameraAngles pan="0.5" deadline_s="20"/>'
    assert bench.outcome(f"<Parallel {thresholds}>{AHEAD}{poll}</Parallel>") is status
    assert bench.ends() == stages


def test_a_parallel_fails_when_enough_have_failed(bench: PlanBench) -> None:
    late = TOO_LATE.replace("moveForward", 'moveForward name="late"')
    assert bench.outcome(f'<Parallel failure_count="1">{late}{AHEAD}</Parallel>') is FAILED
    assert bench.ends() == [Stage.CANCELLED, Stage.CANCELLED]


def test_a_subtree_sees_its_arguments(bench: PlanBench) -> None:
    leg = '<BehaviorTree ID="Leg"><moveForward distance="{far}" deadline_s="{=}"/></BehaviorTree>'
    body = (
        '<Sequence><SubTree ID="Leg" far="{way}" deadline_s="60"/>'
        '<SubTree ID="Leg" name="home" far="-2" deadline_s="60"/></Sequence>'
    )
    bench.go(plan(body, others=leg, way="2"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert bench.rover.pose.x_m == pytest.approx(0.0, abs=0.2)
    assert bench.status().node == "plan:survey/Sequence/home/moveForward"


def test_a_plan_is_seen_in_the_tree(bench: PlanBench) -> None:
    bench.begin(f'<Repeat num_cycles="2"><Parallel>{AHEAD}</Parallel></Repeat>')
    nodes = {node.path: node for node in bench.nodes()}
    assert nodes["plan:survey"].depth == 1
    assert nodes["plan:survey/Repeat/Parallel/moveForward"].status.name == "RUNNING"
    bench.request(AbortPlan("survey"))
    assert not any(n.path.startswith("plan:") for n in bench.nodes())


@pytest.mark.at_length
def test_executed_steps_of_a_plan_remain_marked_in_the_tree(bench: PlanBench) -> None:
    def statuses() -> list[str]:
        return [
            f"{node.name} {node.status.name}"
            for node in bench.nodes()
            if node.path.startswith("plan:survey/")
        ]

    late = TOO_LATE.replace("moveForward", 'moveForward name="late"')
    then = AHEAD.replace("moveForward", 'moveForward name="then"')
    body = f"<Fallback>{late}<Sequence>{BACK}{then}</Sequence></Fallback>"
    bench.begin(f'<Repeat num_cycles="2">{body}</Repeat>', 6.0)
    in_cycle = ["Repeat RUNNING", "Fallback RUNNING"]
    back = [*in_cycle, "late FAILURE", "Sequence RUNNING", "moveForward SUCCESS", "then RUNNING"]
    assert statuses() == back
    bench.request(SuspendPlan("survey"))
    bench.request(ResumePlan("survey"))
    bench.run(0.5)
    assert statuses() == back
    while bench.status().done < 3:
        bench.step()
    bench.run(0.2)
    assert statuses() == [
        *in_cycle,
        *("late RUNNING", "Sequence IDLE", "moveForward IDLE", "then IDLE"),
    ]


def test_a_leaf_of_a_plan_names_its_command_also_after_a_suspension(bench: PlanBench) -> None:
    def working() -> dict[str, str | None]:
        nodes = bench.nodes()
        pairs = zip(nodes, commands_by_node(nodes), strict=True)
        return {
            node.name: command for node, command in pairs if node.path.startswith("plan:survey/")
        }

    then = AHEAD.replace("moveForward", 'moveForward name="then"')
    bench.begin(f"<Sequence>{BACK}{then}</Sequence>", 0.5)
    assert working() == {"Sequence": None, "moveForward": "plan:survey:1", "then": None}
    bench.run(4.0)
    expected = {"Sequence": None, "moveForward": "plan:survey:1"}
    assert working() == {**expected, "then": "plan:survey:2"}
    bench.request(SuspendPlan("survey"))
    bench.request(ResumePlan("survey"))
    bench.run(0.5)
    assert working() == {**expected, "then": "plan:survey:3"}


COMPLETED, FAILED, SUSPENDED = PlanStatus.COMPLETED, PlanStatus.FAILED, PlanStatus.SUSPENDED


@pytest.mark.at_length
def test_while_a_plan_executes_no_other_source_moves_the_rover(bench: PlanBench) -> None:
    bench.begin(AHEAD)
    assert bench.executive.mode is Mode.PLAN
    assert "plan:survey:1 moveForward" in bench.executive.why
    answer = bench.refusal(MoveForward(1.0), 1)
    assert answer.reason is Reason.WRONG_MODE
    assert "suspend the plan" in answer.text
    bench.submit(SetCameraAngles(0.3, 0.0), 2)
    bench.submit(SetTravelSpeed(0.5), 3)
    assert bench.finish(2) is bench.finish(3) is Stage.EXECUTED
    assert bench.until(COMPLETED, FAILED) is COMPLETED


def test_suspended_the_rover_halts_and_resumed_the_leaf_is_requested_again(
    bench: PlanBench,
) -> None:
    bench.begin(f"<Sequence>{BACK}{AHEAD}</Sequence>", 4.0)
    bench.request(SuspendPlan("survey"))
    bench.run(2.0)
    assert bench.rover.velocity == STANDING
    assert bench.ends() == [Stage.EXECUTED, Stage.CANCELLED]
    assert bench.executive.mode is Mode.PAUSED
    reported = "is suspended; send resumePlan survey (`rover plan resume survey`)"
    assert reported in bench.executive.why
    bench.submit(MoveForward(0.5), 1)
    assert bench.executive.mode.name == "MOVING"
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.EXECUTED, Stage.CANCELLED, Stage.EXECUTED]
    assert [number for number, _ in bench.commanded()] == [1, 2, 3]


@pytest.mark.at_length
def test_a_stop_suspends_and_resume_alone_does_not_continue(bench: PlanBench) -> None:
    bench.begin(f"<Fallback>{AHEAD}{BACK}</Fallback>")
    bench.submit(Stop(), 1)
    assert bench.rover.velocity == STANDING
    assert bench.status().status is SUSPENDED
    assert bench.plan_refusal(ResumePlan("survey")).reason is Reason.WRONG_MODE
    bench.submit(Resume(), 2)
    bench.run(5.0)
    assert bench.rover.velocity == STANDING
    assert bench.ends() == [Stage.CANCELLED]
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.CANCELLED, Stage.EXECUTED]


def test_a_hazard_suspends(bench: PlanBench) -> None:
    bench.begin(f"<Fallback>{AHEAD}{BACK}</Fallback>")
    bench.executive.observe(Odometry(bench.clock.now_s(), Pose(x_m=9.0), STANDING))
    bench.executive.tick()
    assert bench.executive.mode is Mode.SAFE
    assert bench.status().status is SUSPENDED
    assert bench.ends() == [Stage.CANCELLED]
    assert {r.reason for r in bench.of() if r.stage is Stage.CANCELLED} == {Reason.ODOMETRY_JUMPED}


def test_aborted_it_is_over(bench: PlanBench) -> None:
    bench.begin(AHEAD)
    bench.request(AbortPlan("survey"))
    assert bench.status().status is PlanStatus.ABORTED
    assert bench.ends() == [Stage.CANCELLED]
    assert bench.plan_refusal(ResumePlan("survey")).reason is Reason.PLAN_STATUS
    bench.request(RemovePlan("survey"))
    assert not bench.executive.plans()


def test_one_plan_has_the_rover(bench: PlanBench) -> None:
    bench.go(plan(AHEAD))
    bench.request(SubmitPlan(plan(BACK, "second")))
    bench.run(0.5)
    for request, reason in (
        (ActivatePlan("second"), Reason.PLAN_ACTIVE),
        (ActivatePlan("third"), Reason.NO_SUCH_PLAN),
        (SubmitPlan(plan(BACK, "second")), Reason.PLAN_EXISTS),
        (RemovePlan("survey"), Reason.PLAN_STATUS),
    ):
        assert bench.plan_refusal(request).reason is reason
    bench.request(SuspendPlan("survey"))
    bench.request(ActivatePlan("second"))
    assert bench.until(COMPLETED, plan_id="second") is COMPLETED
    bench.request(ResumePlan("survey"))
    assert bench.until(COMPLETED) is COMPLETED


@pytest.mark.at_length
def test_after_a_restart_it_is_suspended_and_continues_at_its_interruption(
    bench: PlanBench,
) -> None:
    bench.begin(f"<Sequence>{BACK}{AHEAD}</Sequence>", 4.0)
    bench.crash()
    bench.step()
    assert bench.status().status is SUSPENDED
    assert bench.status().done == 1
    assert any("SUSPENDED: the executive was restarted" in r.text for r in bench.received.reports)
    bench.run(1.0)
    assert bench.rover.velocity == STANDING
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.EXECUTED, Stage.FAILED, Stage.EXECUTED]


@pytest.mark.at_length
def test_a_step_that_ended_unobserved_is_not_repeated(bench: PlanBench) -> None:
    """The command ended in the tick of the crash; its plan had not seen it yet."""
    bench.go(plan(f"<Sequence>{BACK}{AHEAD}</Sequence>"))
    while not bench.ends() or bench.ends()[0] is not Stage.EXECUTED:
        bench.step()
    bench.crash()
    bench.run(0.1)
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.EXECUTED] * 2


@pytest.mark.parametrize(
    "first",
    [
        '<Inverter><Timeout msec="1500"><moveForward distance="50"/></Timeout></Inverter>',
        '<Parallel success_count="1"><moveForward distance="50" deadline_s="60"/>'
        '<setCameraAngles pan="0.5" deadline_s="9"/></Parallel>',
    ],
)
def test_a_step_skipped_by_the_plan_is_not_requested_again(bench: PlanBench, first: str) -> None:
    bench.go(plan(f"<Sequence>{first}{AHEAD}</Sequence>"))
    while "moveForward" not in bench.status().node.partition("Sequence/")[2].split("/")[0]:
        bench.step()
    bench.run(0.5)
    before = len(bench.commanded())
    bench.crash()
    bench.run(0.1)
    bench.request(ResumePlan("survey"))
    bench.run(0.3)
    assert len(bench.commanded()) == before + 1
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert len(bench.commanded()) == before + 1


def test_shut_down_it_is_suspended(bench: PlanBench) -> None:
    bench.begin(AHEAD)
    bench.executive.close()
    assert bench.ends() == [Stage.CANCELLED]
    bench.crash()
    bench.run(0.1)
    assert bench.status().status is SUSPENDED
    assert "shut down" in bench.status().text
    assert bench.resumed() is COMPLETED


def test_a_leaf_that_raises_fails_its_plan(
    bench: PlanBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.begin(f"<Fallback>{AHEAD}{BACK}</Fallback>")

    def fail(*_: object) -> None:
        raise RuntimeError("broken")

    with monkeypatch.context() as broken:
        broken.setattr("executive.plans.execution.PlanExecution.poll", fail)
        bench.run(0.1)
    assert bench.status().status is FAILED
    assert bench.status().text == "plan:survey/Fallback/moveForward raised RuntimeError('broken')"
    assert bench.ends() == [Stage.CANCELLED]
    bench.run(2.0)
    assert bench.rover.velocity == STANDING
    bench.execute(MoveForward(0.5), 1)


@pytest.mark.at_length
def test_without_a_ledger_nothing_more_is_begun(bench: PlanBench) -> None:
    bench.begin(f"<Sequence>{BACK}{AHEAD}</Sequence>")
    bench.fill_disk()
    bench.run(10.0)
    assert bench.executive.mode is Mode.SAFE
    assert bench.rover.velocity == STANDING
    assert bench.rover.pose.x_m == pytest.approx(-1.0, abs=0.1)
    bench.fill_disk(False)
    bench.run(0.1)
    assert bench.status().status is SUSPENDED
    bench.submit(Resume(), 1)
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.EXECUTED, Stage.EXECUTED]


def test_numbers_of_a_removed_plan_are_not_used_again(bench: PlanBench) -> None:
    bench.outcome(BACK)
    bench.request(RemovePlan("survey"))
    bench.crash()
    bench.run(0.1)
    bench.outcome(BACK)
    assert [number for number, _ in bench.commanded()] == [1, 2]


@pytest.mark.parametrize("request_", [MoveForward(1.0), Stop()])
def test_no_other_client_commands_as_a_plan(bench: PlanBench, request_: Request) -> None:
    maximum = (1 << 63) - 1
    answer = bench.send(Command(Identity("plan:survey", maximum), request_, "direct"))
    assert isinstance(answer, Rejected)
    assert answer.refusal.reason is Reason.BAD_IDENTIFIER
    assert bench.received.reports[-1].text.startswith(f"plan:survey:{maximum}: sources that begin")
    assert bench.executive.mode is (Mode.STOPPED if request_ == Stop() else Mode.IDLE)
    bench.submit(Resume(), 1)
    assert bench.outcome(BACK) is COMPLETED
    assert [number for number, _ in bench.commanded()] == [1]


def test_a_plan_that_no_longer_fits_the_rover_fails_when_it_continues(bench: PlanBench) -> None:
    bench.begin(f"<Sequence>{BACK}{AHEAD}</Sequence>", 4.0)
    drive = replace(bench.settings.drive, distance_m=2.0)
    bench.settings = replace(bench.settings, drive=drive)
    bench.crash()
    bench.run(0.1)
    bench.request(ResumePlan("survey"))
    bench.run(0.1)
    assert bench.status().status is FAILED
    assert bench.status().text.startswith("line 3: distance 4 m is above its bound of 2 m")
    assert bench.executive.mode is Mode.IDLE


def test_a_bounded_number_of_plans_is_stored(bench: PlanBench) -> None:
    for number in range(99):
        bench.request(SubmitPlan(plan(BACK, f"plan-{number}")))
    assert isinstance(bench.request(SubmitPlan(plan(BACK))), Accepted)
    assert bench.plan_refusal(SubmitPlan(plan(BACK, "second"))).reason is Reason.TOO_MANY_PLANS
    bench.request(RemovePlan("survey"))
    assert isinstance(bench.request(SubmitPlan(plan(BACK, "second"))), Accepted)


def test_a_plan_sent_again_is_the_same_plan(bench: PlanBench) -> None:
    first = bench.submit(SubmitPlan(plan(BACK)), 1)
    again = bench.submit(SubmitPlan(plan(BACK)), 1)
    other = bench.submit(SubmitPlan(plan(AHEAD)), 1)
    assert isinstance(first, Accepted)
    assert isinstance(again, Duplicate)
    assert isinstance(other, Rejected)
    assert other.refusal.reason is Reason.DUPLICATE


def test_a_plan_does_not_begin_before_the_rover_knows_where_it_is(bench: PlanBench) -> None:
    bench.request(SubmitPlan(plan(AHEAD)))
    bench.crash()
    too_early = bench.request(ActivatePlan("survey"))
    assert isinstance(too_early, Rejected)
    assert too_early.refusal.reason is Reason.NO_ODOMETRY
    bench.step()
    bench.request(ActivatePlan("survey"))
    bench.run(1.0)
    bench.crash()
    bench.odometry = False
    bench.run(1.0)
    too_early = bench.request(ResumePlan("survey"))
    assert isinstance(too_early, Rejected)
    assert too_early.refusal.text == "no odometry yet: the position of the rover is unknown"
    assert bench.status().status is PlanStatus.SUSPENDED
    bench.odometry = True
    bench.step()
    assert bench.resumed() is COMPLETED


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    """Give an executive that knows plans, on a rover without physics."""
    with PlanBench(tmp_path) as bench:
        yield bench
