import pytest

from executive.commands import AbortPlan, Mode, RemovePlan
from executive.geometry import STANDING
from executive.reasons import Reason
from executive.reports import Kind, PlanStatus, Stage
from tests.support.kinematic import WHOLE_LIFE
from tests.support.plans import AHEAD, BACK, TOO_LATE, PlanBench, plan

COMPLETED, FAILED = PlanStatus.COMPLETED, PlanStatus.FAILED


def test_a_sequence_commands_its_leaves_one_after_the_other(bench: PlanBench) -> None:
    turn, look = '<rotateBy angle="1.5" deadline_s="30"/>', '<takePicture deadline_s="9"/>'
    body = f"<Sequence>{BACK}{turn}{look}</Sequence>"
    assert bench.outcome(body) is COMPLETED
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
    assert bench.outcome(f"<Fallback>{TOO_LATE}{BACK}</Fallback>") is COMPLETED
    assert bench.ends() == [Stage.CANCELLED, Stage.EXECUTED]
    late = next(r for r in bench.of() if r.stage is Stage.CANCELLED)
    assert late.reason is Reason.PLAN_DEADLINE
    assert [f.value for f in late.figures] == [1.0]


def test_a_plan_that_fails_says_where_and_the_rover_stands(bench: PlanBench) -> None:
    assert bench.outcome(f"<Sequence>{TOO_LATE}{BACK}</Sequence>") is FAILED
    assert "plan:survey/Sequence/moveForward: CANCELLED" in bench.status().text
    event = [r for r in bench.heard.reports if r.kind is Kind.EVENT][-1]
    assert (event.reason, event.text[:18]) == (Reason.PLAN_FAILED, "plan survey FAILED")
    bench.run(2.0)
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.IDLE


def test_a_leaf_that_is_refused_fails(bench: PlanBench) -> None:
    body = f'<Fallback><deleteFile path="nothing.jpg" deadline_s="5"/>{BACK}</Fallback>'
    assert bench.outcome(body) is COMPLETED
    assert bench.ends() == [Stage.REJECTED, Stage.EXECUTED]


def test_repeat_retry_and_inverter_run_their_child_as_often_as_they_say(bench: PlanBench) -> None:
    assert bench.outcome(f'<Repeat num_cycles="3">{BACK}</Repeat>') is COMPLETED
    assert bench.ends() == [Stage.EXECUTED] * 3
    assert (bench.status().done, bench.status().total) == (1, 1)
    bench.ask(RemovePlan("survey"))
    late = f'<RetryUntilSuccessful num_attempts="2">{TOO_LATE}</RetryUntilSuccessful>'
    assert bench.outcome(f"<Inverter>{late}</Inverter>") is COMPLETED
    assert bench.ends()[3:] == [Stage.CANCELLED] * 2


def test_a_timeout_cancels_what_is_below_it(bench: PlanBench) -> None:
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
    look = '<setCameraAngles pan="0.5" deadline_s="20"/>'
    assert bench.outcome(f"<Parallel {thresholds}>{AHEAD}{look}</Parallel>") is status
    assert bench.ends() == stages


def test_a_parallel_fails_when_enough_have_failed(bench: PlanBench) -> None:
    late = TOO_LATE.replace("moveForward", 'moveForward name="late"')
    assert bench.outcome(f'<Parallel failure_count="1">{late}{AHEAD}</Parallel>') is FAILED
    assert bench.ends() == [Stage.CANCELLED, Stage.CANCELLED]


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


def test_a_plan_is_seen_in_the_tree(bench: PlanBench) -> None:
    bench.go(plan(f'<Repeat num_cycles="2"><Parallel>{AHEAD}</Parallel></Repeat>'))
    bench.run(1.0)
    tree = bench.executive.tree
    nodes = {node.path: node for node in tree.nodes()}  # type: ignore[attr-defined]
    assert nodes["plan:survey"].depth == 1
    assert nodes["plan:survey/Repeat/Parallel/moveForward"].status.name == "RUNNING"
    bench.ask(AbortPlan("survey"))
    assert not any(n.path.startswith("plan:") for n in tree.nodes())  # type: ignore[attr-defined]
