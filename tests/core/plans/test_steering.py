"""An active plan is steered: nodes are skipped, begun again, held at; questions are answered."""

from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest

from adapters.recording import RunFile, RunReader
from adapters.recording.replay import replay
from adapters.recording.timed_items import read_timed
from executive.commands import (
    AbortPlan,
    ActivatePlan,
    AnswerQuestion,
    Command,
    HoldAtNode,
    PlanRequest,
    PlanSteering,
    ResumePlan,
    RetryNode,
    SkipNode,
    SubmitPlan,
    SuspendPlan,
)
from executive.commands.lifecycle import Accepted, SubmitResult
from executive.core.recording import TreeChanged
from executive.plans.state import MAX_STATE_LENGTH
from executive.values.clock import START_UTC_S
from executive.values.reasons import Reason
from executive.values.reports import Identity, PlanStatus, Stage
from tests.support.plans import PlanBench, plan

COMPLETED, FAILED, SUSPENDED = PlanStatus.COMPLETED, PlanStatus.FAILED, PlanStatus.SUSPENDED
LONG = '<moveForward name="long" distance="50" deadline_s="600"/>'
CAMERA = '<setCameraAngles name="camera" pan="0.4" tilt="0" deadline_s="9"/>'
DRIVE = f"<Sequence>{LONG}{CAMERA}</Sequence>"
QUESTION = (
    '<Ask name="ditch" question="The ditch?" options="cross;stay" deadline_s="600" answer="{go}"/>'
)
DITCH = f"""<Sequence>{CAMERA}{QUESTION}
  <Switch2 variable="{{go}}" case_1="cross" case_2="stay">
    <moveForward distance="-0.3" deadline_s="60"/><AlwaysSuccess/><AlwaysFailure/>
  </Switch2>
</Sequence>"""


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    with PlanBench(tmp_path) as bench:
        yield bench


def steer(bench: PlanBench, request: PlanSteering) -> str:
    """Send a request that is executed; return the text of its report."""
    assert isinstance(bench.request(request), Accepted)
    bench.step()
    ends = [
        r for r in bench.received.reports if r.identity and r.identity.command_id == bench.number
    ]
    assert ends[-1].stage is Stage.EXECUTED
    return ends[-1].text


@pytest.mark.parametrize("suspended", [False, True])
def test_a_request_that_the_state_has_no_space_for_is_refused(
    bench: PlanBench, suspended: bool
) -> None:
    codes = [f"a := '{'x' * 1000}'", *(f"v{number} := a" for number in range(256))]
    scripts = "".join(f'<Script code="{code}"/>' for code in codes)
    bench.begin(f"<Sequence>{scripts}{DRIVE}</Sequence>")
    ((length,),) = bench.ledger.rows("SELECT length(state) FROM plan_states")
    assert 0 < MAX_STATE_LENGTH - length < 8192
    if suspended:
        bench.request(SuspendPlan("survey"))
        bench.step()
    refusal = bench.plan_refusal(HoldAtNode("survey", "camera"))
    assert refusal.reason is Reason.PLAN_TOO_LARGE
    assert bench.status().status is (SUSPENDED if suspended else PlanStatus.EXECUTING)
    if suspended:
        bench.request(ResumePlan("survey"))
        bench.run(1.0)
    assert bench.status().status is PlanStatus.EXECUTING


def continued(bench: PlanBench) -> PlanStatus:
    """Kill the executive, resume the plan, and run it to its end."""
    bench.crash()
    bench.step()
    return bench.resumed()


@pytest.mark.parametrize(("result", "status"), [("SUCCESS", COMPLETED), ("FAILURE", FAILED)])
def test_a_running_node_is_skipped_with_its_command(
    bench: PlanBench, result: str, status: PlanStatus
) -> None:
    bench.begin(DRIVE, 2.0)
    text = steer(bench, SkipNode("survey", "long", result))
    assert text.startswith(f"plan:survey/Sequence/long: skipped with {result}, by ")
    assert bench.until(COMPLETED, FAILED) is status
    assert bench.ends() == [Stage.CANCELLED, Stage.EXECUTED][: 2 if status is COMPLETED else 1]
    if status is COMPLETED:
        assert bench.status().done == 2
    else:
        assert bench.status().text == "plan:survey/Sequence/long: skipped with FAILURE"


def test_a_node_that_is_not_reached_is_skipped_also_after_a_kill(bench: PlanBench) -> None:
    bench.begin(f"<Sequence>{CAMERA}<Sleep msec='3000'/>{LONG}</Sequence>", 1.0)
    steer(bench, SkipNode("survey", "long", "SUCCESS"))
    assert continued(bench) is COMPLETED
    assert bench.ends() == [Stage.EXECUTED]
    assert bench.status().done == 2


def test_a_running_node_begins_again(bench: PlanBench) -> None:
    bench.begin(f"<Sequence><Sleep name='rest' msec='4000'/>{CAMERA}</Sequence>", 3.0)
    steer(bench, RetryNode("survey", "rest"))
    bench.run(2.0)
    assert bench.commanded() == []
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    bench.go(plan(DRIVE, "again"))
    bench.run(1.0)
    steer(bench, RetryNode("again", "Sequence/long"))
    bench.run(1.0)
    stages = [stages[-1] for _, stages in bench.commanded("again")]
    assert stages[0] is Stage.CANCELLED
    assert stages[1] in {Stage.STARTED, Stage.PROGRESS}
    assert len(stages) == 2


@pytest.mark.parametrize("kill", [False, True])
def test_a_plan_is_held_before_a_node(bench: PlanBench, kill: bool) -> None:
    late = f"<Timeout name='t' msec='60000'>{CAMERA}</Timeout>"
    body = f"<Sequence><Sleep msec='2000'/>{late}</Sequence>"
    bench.begin(body, 0.5)
    steer(bench, HoldAtNode("survey", "camera"))
    if kill:
        bench.crash()
        bench.step()
        bench.request(ResumePlan("survey"))
    assert bench.until(SUSPENDED, COMPLETED) is SUSPENDED
    assert bench.status().text == "held at plan:survey/Sequence/t/camera"
    assert bench.commanded() == []
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.EXECUTED]


def test_an_answer_counts_once(bench: PlanBench) -> None:
    bench.begin(DITCH, 2.0)
    assert bench.status().status is PlanStatus.EXECUTING
    assert steer(bench, AnswerQuestion("survey", "ditch", "stay")).startswith(
        "plan:survey/Sequence/ditch: answered: stay, by "
    )
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert len(bench.commanded()) == 1


def test_steering_a_suspended_plan_does_not_change_its_reason(bench: PlanBench) -> None:
    bench.begin(DITCH, 2.0)
    bench.request(SuspendPlan("survey"))
    bench.step()
    reason = bench.status().text
    steer(bench, AnswerQuestion("survey", "ditch", "stay"))
    assert bench.status().text == reason


def test_a_repeated_answer_does_not_answer_the_next_question(bench: PlanBench) -> None:
    rest = f"<Sleep msec='2000'/>{CAMERA}"
    body = f"<Repeat num_cycles='2'><Sequence>{QUESTION}{rest}</Sequence></Repeat>"
    bench.begin(body, 1.0)
    steer(bench, AnswerQuestion("survey", "ditch", "stay"))
    assert "was answered before: stay" in steer(bench, AnswerQuestion("survey", "ditch", "stay"))
    refusal = bench.plan_refusal(AnswerQuestion("survey", "ditch", "cross"))
    assert refusal.reason is Reason.QUESTION_ANSWERED
    assert refusal.text == "plan:survey/Repeat/Sequence/ditch was answered: stay"
    bench.run(4.0)
    assert bench.status().status is PlanStatus.EXECUTING  # the second question is open
    steer(bench, AnswerQuestion("survey", "ditch", "cross"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED


@pytest.mark.parametrize("when", ["submitted", "executing"])
def test_an_answer_before_the_question_is_stored(bench: PlanBench, when: str) -> None:
    if when == "submitted":
        bench.request(SubmitPlan(plan(DITCH)))
        bench.run(0.1)
        steer(bench, AnswerQuestion("survey", "ditch", "cross"))
        bench.crash()
        bench.step()
        bench.request(ActivatePlan("survey"))
        assert bench.until(COMPLETED, FAILED) is COMPLETED
    else:
        bench.begin(f"<Sequence><Sleep msec='1000'/>{DITCH}</Sequence>", 0.5)
        steer(bench, AnswerQuestion("survey", "ditch", "cross"))
        assert continued(bench) is COMPLETED
    assert bench.ends() == [Stage.EXECUTED, Stage.EXECUTED]
    assert not any("The ditch?" in r.text for r in bench.received.reports)


REFUSED: list[tuple[PlanSteering, Reason, str]] = [
    (SkipNode("survey", "nothing", "SUCCESS"), Reason.NO_SUCH_STEP, "no nodes of plan:survey"),
    (SkipNode("survey", "camera", "FAILURE"), Reason.PLAN_STATUS, "camera has ended"),
    (SkipNode("survey", "", "FAILURE"), Reason.NO_SUCH_STEP, "no nodes of plan:survey"),
    (SkipNode("survey", "long", "MAYBE"), Reason.OUT_OF_RANGE, "MAYBE"),
    (SkipNode("other", "long", "SUCCESS"), Reason.NO_SUCH_PLAN, "no plan 'other'"),
    (RetryNode("survey", "after"), Reason.PLAN_STATUS, "after is not running"),
    (HoldAtNode("survey", "long"), Reason.PLAN_STATUS, "long runs already: suspend the plan"),
    (AnswerQuestion("survey", "long", "stay"), Reason.NO_SUCH_QUESTION, "Sequence/ditch"),
    (AnswerQuestion("survey", "ditch", "fly"), Reason.NO_SUCH_OPTION, "cross or stay"),
]


@pytest.mark.parametrize("kill", [False, True])
def test_a_burst_of_requests_is_executed_in_order(bench: PlanBench, kill: bool) -> None:
    bench.begin(DRIVE, 2.0)
    answers: list[SubmitResult] = []
    skip, hold = SkipNode("survey", "long", "SUCCESS"), HoldAtNode("survey", "camera")
    requests: list[PlanRequest] = [SuspendPlan("survey"), skip, hold]
    for number, request in enumerate(requests, 7000):
        bench.executive.submit(Command(Identity("MOE", number), request, "direct"), answers.append)
    if not kill:
        resume = Command(Identity("MOE", 7003), ResumePlan("survey"), "direct")
        bench.executive.submit(resume, answers.append)
    bench.executive.serve_inbox()
    assert [each for each in answers if not isinstance(each, Accepted)] == []
    if kill:
        bench.crash()
        bench.step()
        bench.request(ResumePlan("survey"))
    bench.step()
    assert bench.until(SUSPENDED, COMPLETED) is SUSPENDED
    assert bench.status().text == "held at plan:survey/Sequence/camera"
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.CANCELLED, Stage.EXECUTED]


def test_what_cannot_be_is_refused_and_changes_nothing(bench: PlanBench) -> None:
    after = CAMERA.replace('"camera"', '"after"')
    bench.begin(f"<Sequence>{CAMERA}{LONG}{QUESTION}{after}</Sequence>", 2.5)
    before = bench.ledger.rows("SELECT * FROM plan_states")
    for request, reason, text in REFUSED:
        refusal = bench.plan_refusal(request)
        assert refusal.reason is reason, refusal
        assert text in refusal.text
    assert bench.ledger.rows("SELECT * FROM plan_states") == before
    assert bench.status().status is PlanStatus.EXECUTING
    steer(bench, SkipNode("survey", "long", "FAILURE"))
    bench.until(FAILED)
    ended = bench.plan_refusal(SkipNode("survey", "after", "SUCCESS"))
    assert (ended.reason, "is FAILED" in ended.text) == (Reason.PLAN_STATUS, True)


def test_the_reason_of_the_standstill_names_waits_and_questions(bench: PlanBench) -> None:
    until = START_UTC_S + 300 - START_UTC_S % 60
    at = f"{datetime.fromtimestamp(until, UTC):%H:%M} UTC"
    wait = f'<WaitUntil utc="{until}"/>'
    window = f'<Window from="{until + 60}">{CAMERA}</Window>'
    question = QUESTION.replace("answer=", 'default="stay" answer=')
    bench.begin(f"<Sequence>{question}{wait}{window}</Sequence>")
    assert bench.executive.why.startswith(
        "standing: plan survey waits for an answer to ditch: The ditch? (cross or stay) until "
    )
    assert bench.executive.why.endswith(" UTC, then stay")
    steer(bench, AnswerQuestion("survey", "ditch", "stay"))
    bench.run(0.2)
    assert bench.executive.why == f"standing: plan survey waits until {at}"
    steer(bench, SkipNode("survey", "WaitUntil", "SUCCESS"))
    bench.run(0.2)
    later = f"{datetime.fromtimestamp(until + 60, UTC):%H:%M} UTC"
    assert bench.executive.why == f"standing: plan survey waits until {later}"
    bench.request(AbortPlan("survey"))
    bench.run(0.2)
    assert bench.executive.why == "standing: no motion goal"


def test_a_recording_of_steering_is_replayed_with_the_same_decisions(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, PlanBench(tmp_path, tape=tape) as bench:
        later = CAMERA.replace('"camera"', '"later"')
        bench.begin(f"<Sequence>{LONG}{QUESTION}{CAMERA}{later}</Sequence>", 1.0)
        steer(bench, RetryNode("survey", "long"))
        steer(bench, AnswerQuestion("survey", "ditch", "stay"))
        bench.plan_refusal(AnswerQuestion("survey", "ditch", "cross"))
        steer(bench, HoldAtNode("survey", "later"))
        steer(bench, SkipNode("survey", "long", "SUCCESS"))
        assert bench.until(SUSPENDED, COMPLETED) is SUSPENDED
        assert bench.resumed() is COMPLETED
    replayed = replay(path)
    assert (replayed.difference, replayed.whole) == (None, True)


def test_a_recording_has_the_last_tick_of_a_plan(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, PlanBench(tmp_path, tape=tape) as bench:
        bench.begin(
            CAMERA.replace(" pan", ' _skipIf="1 &lt; 2" pan').replace("camera", "only"), 0.5
        )
        assert bench.status().status is FAILED
        assert not any("only" in each.path for each in bench.nodes())
    changes = [each.item for each in read_timed(RunReader(path), {TreeChanged})]
    assert [
        [each.message for each in item.nodes if each.path.endswith("/only")]
        for item in changes
        if isinstance(item, TreeChanged) and "only" in str(item)
    ] == [["skipped: _skipIf 1 < 2"], []]


def test_a_kill_after_the_report_and_before_the_node_obeys_loses_nothing(bench: PlanBench) -> None:
    bench.begin(DRIVE, 2.0)
    number = bench.number + 1
    bench.request(SkipNode("survey", "long", "SUCCESS"))
    bench.executive._commits.flush()
    bench.crash()
    bench.step()
    reports = [r for r in bench.received.reports if r.identity and r.identity.command_id == number]
    assert reports[-1].stage is Stage.EXECUTED
    assert bench.resumed() is COMPLETED
    assert bench.ends() == [Stage.FAILED, Stage.EXECUTED]
