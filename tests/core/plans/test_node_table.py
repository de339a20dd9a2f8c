"""The table of a plan's nodes: what has happened to each, while it runs, waits, and has ended."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.explanation import UnknownCommandError, explain_node
from adapters.recording import RunFile
from adapters.recording.replay import replay
from executive.commands import (
    AbortPlan,
    AnswerQuestion,
    PlanDefinition,
    ResumePlan,
    RetryNode,
    SkipNode,
    SuspendPlan,
)
from executive.plans import NodeRecords, PlanRoot, check_plan, nodes, read_plan
from executive.plans.node_records import read_records
from executive.settings import Settings
from executive.values.clock import ManualClock
from executive.values.plan_nodes import NodeStatus, PlanNodeReport
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, PlanStatus
from tests.support.plans import AHEAD, TOO_LATE, PlanBench, plan

BACK = '<moveForward name="back" distance="1" deadline_s="60"/>'


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    with PlanBench(tmp_path) as bench:
        yield bench


SKIPPED = "skipped with SUCCESS: requested by an operator"
FALLBACK = f'<Fallback name="there">{TOO_LATE}{BACK}</Fallback>'


def table(bench: PlanBench, by_path: bool = False) -> dict[str, PlanNodeReport]:
    """Return the nodes of the plan by the ends of their paths, or by their paths."""
    found = bench.executive.plan_nodes("survey")
    assert not isinstance(found, Refusal), found
    return {each.path if by_path else each.path.rpartition("/")[2]: each for each in found}


def test_a_fallback_reports_which_branch_it_took_and_why(bench: PlanBench) -> None:
    assert bench.outcome(FALLBACK) is PlanStatus.COMPLETED
    found = table(bench)
    late, back, there = found["moveForward"], found["back"], found["there"]
    assert there.decision.startswith("took the second branch back: moveForward was CANCELLED 7")
    assert (late.result, late.tries, late.reason) == (NodeStatus.FAILURE, 1, Reason.PLAN_DEADLINE)
    assert "not done within 1 s" in late.text
    assert (back.result, back.reason, back.text) == (NodeStatus.SUCCESS, None, "")
    assert back.command == Identity("plan:survey", 2)
    assert there.result is NodeStatus.SUCCESS
    assert {each.status for each in found.values()} == {NodeStatus.IDLE}
    assert back.since_utc_s is not None
    assert late.since_utc_s is not None
    assert late.since_utc_s < back.since_utc_s


ASKS = """<Sequence>
<Ask name="ditch" question="Cross it?" options="cross;back" default="back" deadline_s="20"
     answer="{way}"/>
<Switch2 name="way" variable="{way}" case_1="cross" case_2="back">
  <moveForward name="over" distance="1" deadline_s="60"/>
  <moveForward name="home" distance="-1" deadline_s="60"/>
  <AlwaysFailure/>
</Switch2></Sequence>"""


def test_an_open_question_has_its_deadline(bench: PlanBench) -> None:
    bench.begin(ASKS)
    ditch = table(bench)["ditch"]
    assert ditch.question is not None
    assert ditch.question.options == ("cross", "back")
    assert ditch.question.until_utc_s == ditch.next_utc_s
    assert ditch.since_utc_s is not None
    assert ditch.next_utc_s is not None
    assert 19.9 < ditch.next_utc_s - ditch.since_utc_s <= 20.0
    bench.request(AnswerQuestion("survey", "ditch", "cross"))
    bench.run(0.5)
    found = table(bench)
    assert found["ditch"].question is None
    assert found["ditch"].decision == "answered cross"
    assert found["way"].decision == "took the case 1 over: way is cross"


def test_a_default_is_named(bench: PlanBench) -> None:
    assert bench.outcome(ASKS) is PlanStatus.COMPLETED
    found = table(bench)
    assert found["ditch"].decision == "took the default back: no answer within its deadline"
    assert found["way"].decision == "took the case 2 home: way is back"


def test_the_unknown_value_of_a_wait_is_named(bench: PlanBench) -> None:
    wait = '<WaitFor name="w" if="@BATTERY_CHARGE &gt; 0.9" deadline_s="60"/>'
    bench.begin(f"<Sequence>{wait}{AHEAD}</Sequence>")
    found = table(bench)["w"]
    assert (found.status, found.unknown) == (NodeStatus.RUNNING, "BATTERY_CHARGE")
    bench.charge_ratio = 0.5
    bench.run(1.0)
    found = table(bench)["w"]
    assert (found.status, found.unknown) == (NodeStatus.RUNNING, "")
    assert found.tries == 1


def test_the_table_survives_a_kill(bench: PlanBench) -> None:
    bench.begin(f"<Sequence>{FALLBACK}<Sleep name='rest' msec='60000'/></Sequence>", 0.2)
    bench.run(30.0)
    before = table(bench)
    assert before["rest"].next_utc_s is not None
    bench.crash()
    found = table(bench)
    assert bench.status().status is PlanStatus.SUSPENDED
    assert found["rest"].next_utc_s is None
    assert found == {
        name: each if name != "rest" else replace(each, next_utc_s=None)
        for name, each in before.items()
    }


def test_a_branch_is_shown_after_a_restart(bench: PlanBench) -> None:
    rest = f"<Sequence><Sleep msec='60000'/>{AHEAD}</Sequence>"
    bench.begin(f'<Fallback name="there">{TOO_LATE}{rest}</Fallback>', 3.0)
    (before,) = (each.message for each in bench.nodes() if each.name == "there")
    assert before == "took the second branch Sequence: moveForward was CANCELLED 761 (not done" + (
        " within 1 s)"
    )
    bench.crash()
    bench.step()
    bench.request(ResumePlan("survey"))
    bench.run(0.5)
    assert [each.message for each in bench.nodes() if each.name == "there"] == [before]


def test_the_branch_of_an_earlier_cycle_is_not_shown(bench: PlanBench) -> None:
    check = '<Fallback name="f"><ScriptCondition code="n == 1"/><AlwaysSuccess/></Fallback>'
    cycle = f'<Sequence>{check}<Script code="n += 1"/><Sleep msec="1000"/></Sequence>'
    loop = f'<Script code="n := 0"/><Repeat num_cycles="3">{cycle}</Repeat>'
    bench.begin(f"<Sequence>{loop}{AHEAD}</Sequence>", 0.5)
    shown = []
    for _ in range(3):
        shown.append(table(bench)["f"].decision.partition(":")[0])
        bench.run(1.0)
    assert shown == ["took the second branch AlwaysSuccess", "", shown[0]]


def test_the_branch_of_before_a_suspension_is_not_shown_for_another(bench: PlanBench) -> None:
    bench.voltage_v = 23.0
    full = '<ScriptCondition code="@BATERY_VOLTAGE &gt; 24"/><Sleep msec="60000"/>'
    bench.begin(
        f'<ReactiveFallback name="f"><Sequence name="a">{full}</Sequence>{AHEAD}</ReactiveFallback>'
    )
    assert table(bench)["f"].decision.startswith("took the second branch moveForward")
    bench.request(SuspendPlan("survey"))
    bench.voltage_v = 26.0
    bench.run(1.0)
    bench.request(ResumePlan("survey"))
    bench.run(0.5)
    assert table(bench)["f"].decision == "took the first branch a: a no longer fails"


def test_an_answer_to_a_suspended_plan_ends_its_question(bench: PlanBench) -> None:
    bench.begin(ASKS)
    bench.request(SuspendPlan("survey"))
    bench.run(0.5)
    assert table(bench)["ditch"].question is not None
    bench.request(AnswerQuestion("survey", "ditch", "cross"))
    bench.run(0.5)
    assert table(bench)["ditch"].question is None
    assert bench.executive.plan_questions["survey"] == ()
    assert bench.resumed() is PlanStatus.COMPLETED
    assert table(bench)["ditch"].decision == "answered cross"


FAILS = '<ForceSuccess><AlwaysFailure name="late"/></ForceSuccess>'
NOISE = f'<Sleep msec="1500"/>{FAILS}{BACK}'


@pytest.mark.parametrize(
    "body",
    [
        f"<TryCatch>{TOO_LATE}<Sequence>{NOISE}</Sequence></TryCatch>",
        f"<ParallelAll>{TOO_LATE}<Sequence>{NOISE}</Sequence></ParallelAll>",
    ],
)
def test_why_a_plan_fails_survives_a_kill(bench: PlanBench, body: str) -> None:
    bench.begin(body, 2.0)
    bench.crash()
    bench.run(0.5)
    assert bench.resumed() is PlanStatus.FAILED
    assert "moveForward: CANCELLED 761 (not done within 1 s)" in bench.status().text


def test_a_name_of_several_nodes_is_not_explained_by_one_of_them(bench: PlanBench) -> None:
    leg = f'<BehaviorTree ID="Leg">{AHEAD}</BehaviorTree>'
    legs = '<SubTree ID="Leg" name="out"/><SubTree ID="Leg" name="home"/>'
    bench.go(plan(f"<Sequence>{legs}</Sequence>", others=leg))
    bench.run(0.5)
    found = tuple(table(bench, by_path=True).values())
    with pytest.raises(UnknownCommandError, match="out/moveForward, plan:survey/Sequence/home/"):
        explain_node(found, "moveForward")
    explained = explain_node(found, "home/moveForward")
    assert explained is not None
    assert explained.headline == "Sequence/home/moveForward has not begun"


def test_only_plans_with_open_questions_are_read_at_the_start(
    bench: PlanBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for plan_id, body in (("survey", ASKS), ("drive", AHEAD)):
        bench.go(plan(body, plan_id))
        bench.run(0.5)
        bench.request(SuspendPlan(plan_id))
        bench.run(0.5)
    read = list[str]()

    def checked(definition: PlanDefinition, settings: Settings) -> PlanRoot | Refusal:
        read.append(definition.plan_id)
        return check_plan(definition, settings)

    monkeypatch.setattr("executive.plans.planner.check_plan", checked)
    bench.crash()
    assert read == ["survey"]
    assert len(bench.executive.plan_questions["survey"]) == 1


def test_nothing_runs_after_the_abort_of_a_killed_plan(
    bench: PlanBench,
) -> None:
    bench.begin(ASKS)
    bench.crash()
    bench.run(0.5)
    assert table(bench)["ditch"].question is not None
    bench.request(AbortPlan("survey"))
    bench.run(0.5)
    found = table(bench)
    assert {each.status for each in found.values()} == {NodeStatus.IDLE}
    assert (found["ditch"].question, found["ditch"].next_utc_s) == (None, None)
    assert found["ditch"].tries == 1


def test_a_skipped_node_has_not_begun_and_a_retried_one_begins_again(bench: PlanBench) -> None:
    bench.begin(f'<Sequence name="all">{AHEAD}{BACK}</Sequence>')
    bench.request(SkipNode("survey", "back", "FAILURE"))
    bench.request(RetryNode("survey", "moveForward"))
    bench.run(0.5)
    ahead = table(bench)["moveForward"]
    assert (ahead.tries, ahead.decision) == (2, "begins again: requested by an operator")
    assert bench.until(PlanStatus.COMPLETED, PlanStatus.FAILED) is PlanStatus.FAILED
    back = table(bench)["back"]
    assert (back.tries, back.result, back.command) == (0, NodeStatus.FAILURE, None)
    assert back.decision == "skipped with FAILURE: requested by an operator"


def test_records_of_long_failures_stay_small_and_have_their_reasons() -> None:
    names = "".join(f'<AlwaysFailure name="{"n" * 70}{n}"/>' for n in range(480))
    root = read_plan(plan(f"<Sequence>{AHEAD}<Fallback>{names}</Fallback></Sequence>"))
    assert not isinstance(root, Refusal), root
    clock = ManualClock()
    records = NodeRecords("", clock)
    for node in nodes(root):
        clock.advance(1.0)
        records.note(node, True, "F", f"{'path/' * 99}{node.location.name}: {'w' * 150}")
    text = records.encoded(())
    assert len(text) < 100_000
    found, _ = read_records(text)
    assert len(found) == 484
    assert found[483].text == f"{'n' * 70}479: {'w' * 150}"
    assert (found[1].text, found[1].result, found[1].tries) == ("", "F", 1)


@pytest.mark.at_length
def test_a_contingent_run_is_replayed_bit_for_bit(tmp_path: Path) -> None:
    """An answer, a skip, a retry, a wait for telemetry, a branch, a suspension and a kill."""
    body = f"""<Sequence>
      <Fallback name="there">{TOO_LATE}{BACK}</Fallback>
      <Ask name="ditch" question="Cross it?" options="cross;stay" deadline_s="600" answer="{{go}}"/>
      <WaitFor name="charged" if="@BATTERY_CHARGE &gt; 0.9" deadline_s="600"/>
      <Switch2 variable="{{go}}" case_1="cross" case_2="stay">
        <moveForward name="over" distance="3" deadline_s="60"/><AlwaysSuccess/><AlwaysFailure/>
      </Switch2>
      <takePicture name="photo" deadline_s="9"/>
      <moveForward name="home" distance="-2" deadline_s="60"/>
    </Sequence>"""
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, PlanBench(tmp_path, tape=tape) as bench:
        bench.begin(body, 10.0)
        bench.request(AnswerQuestion("survey", "ditch", "cross"))
        bench.run(1.0)
        bench.charge_ratio = 0.95
        bench.run(1.0)
        bench.request(RetryNode("survey", "over"))
        bench.request(SkipNode("survey", "photo", "SUCCESS"))
        bench.run(1.0)
        bench.request(SuspendPlan("survey"))
        bench.run(0.5)
        bench.request(ResumePlan("survey"))
        bench.run(1.0)
        bench.crash()
        bench.run(0.5)
        assert bench.resumed() is PlanStatus.COMPLETED
        found = table(bench)
        assert (found["over"].tries, found["photo"].decision) == (2, SKIPPED)
    replayed = replay(path)
    assert (replayed.difference, replayed.whole, replayed.starts) == (None, True, 2)
