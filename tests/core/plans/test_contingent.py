"""Waits, windows, questions, conditions and variables of plans, on a rover without physics."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import (
    AbortPlan,
    AnswerQuestion,
    MoveForward,
    RemovePlan,
    Request,
    Resume,
    ResumePlan,
    SetCameraAngles,
    SkipNode,
    Stop,
    SuspendPlan,
)
from executive.plans import PlanRoot, PlanStep, nominal_steps, read_plan
from executive.state.uncertainty import Uncertainty
from executive.values.clock import START_UTC_S
from executive.values.geometry import STANDING, Pose
from executive.values.reasons import Reason
from executive.values.reports import PlanStatus, Stage
from tests.support.kinematic import STEP_S
from tests.support.plans import PlanBench, plan, xml

COMPLETED, FAILED = PlanStatus.COMPLETED, PlanStatus.FAILED
EXECUTING, SUSPENDED = PlanStatus.EXECUTING, PlanStatus.SUSPENDED
BACK = '<moveForward distance="-0.3" deadline_s="60"/>'
LONG = '<moveForward name="long" distance="50" deadline_s="600"/>'
AIM = '<setCameraAngles pan="{pan}" tilt="0" deadline_s="9"/>'


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    with PlanBench(tmp_path) as bench:
        yield bench


def requests(bench: PlanBench) -> list[Request]:
    """Return the requests of the plan's commands, by number."""
    found = []
    for number, _ in bench.commanded():
        identity = next(
            r.identity for r in bench.of() if r.identity and r.identity.command_id == number
        )
        request = bench.ledger.request(identity)
        assert request is not None
        found.append(request)
    return found


def after(seconds: float) -> str:
    """Return a time of the bench, seconds after its start."""
    return str(START_UTC_S + seconds)


def test_a_loop_gives_each_part_to_its_command(bench: PlanBench) -> None:
    body = f'<LoopDouble queue="-0.8;0.4" value="{{pan}}" _onSuccess="all := 1">{AIM}</LoopDouble>'
    assert bench.outcome(body) is COMPLETED
    assert requests(bench) == [SetCameraAngles(-0.8, 0.0), SetCameraAngles(0.4, 0.0)]
    assert bench.status().done == bench.status().total == 1


def test_telemetry_is_read_in_each_tick_and_unknown_is_no_answer(bench: PlanBench) -> None:
    guard = '<ScriptCondition code="@BATERY_VOLTAGE &gt; 24"/>'
    body = f"<ReactiveSequence>{guard}{LONG}</ReactiveSequence>"
    bench.begin(body, 2.0)
    assert bench.status().status is PlanStatus.EXECUTING
    bench.voltage_v = 23.0
    bench.run(0.2)
    assert bench.status().status is FAILED
    assert bench.status().text == (
        "plan:survey/ReactiveSequence/ScriptCondition: not @BATERY_VOLTAGE > 24"
    )
    assert bench.ends() == [Stage.CANCELLED]


def test_a_wait_does_not_end_by_an_unknown_value(bench: PlanBench) -> None:
    bench.voltage_v = None
    bench.executive.status.battery = None
    bench.begin(
        f'<Sequence><WaitFor if="@BATERY_VOLTAGE &gt; 24" deadline_s="5"/>{BACK}</Sequence>', 4.0
    )
    (waits,) = (node for node in bench.nodes() if node.name == "WaitFor")
    assert (waits.status.name, waits.message) == ("RUNNING", "BATERY_VOLTAGE is not known")
    bench.run(1.5)
    assert bench.status().status is FAILED
    assert bench.status().text == "plan:survey/Sequence/WaitFor: BATERY_VOLTAGE is not known"


def test_a_window_waits_and_halts_its_child_at_its_end(bench: PlanBench) -> None:
    window = f'<Window from="{after(3)}" until="{after(6)}">{LONG}</Window>'
    bench.begin(f"<Fallback>{window}{BACK}</Fallback>", 2.5)
    assert bench.commanded() == []
    bench.run(2.0)
    assert bench.ends()[0] in {Stage.STARTED, Stage.PROGRESS}
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert bench.ends() == [Stage.CANCELLED, Stage.EXECUTED]


@pytest.mark.parametrize(("late_s", "status"), [(30.0, COMPLETED), (1.0, FAILED)])
def test_a_wait_for_a_time_that_has_passed_may_fail(
    bench: PlanBench, late_s: float, status: PlanStatus
) -> None:
    bench.run(10.0)
    assert (
        bench.outcome(f'<Sequence><WaitUntil utc="{after(2)}" late_s="{late_s}"/>{BACK}</Sequence>')
        is status
    )


QUESTION = f"""<Sequence>
  <Ask question="The ditch?" options="cross;stay"DEFAULT deadline_s="5" answer="{{answer}}"/>
  <Switch2 variable="{{answer}}" case_1="cross" case_2="stay">
    {BACK}<setCameraAngles name="stays" pan="0.1" deadline_s="9"/><AlwaysFailure/>
  </Switch2>
</Sequence>"""


def with_question(default: str = "") -> str:
    return QUESTION.replace("DEFAULT", default)


def test_a_question_is_reported_and_answered_once(bench: PlanBench) -> None:
    bench.begin(with_question(), 1.0)
    (report,) = (r for r in bench.received.reports if "The ditch?" in r.text)
    assert "question plan:survey/Sequence/Ask: The ditch? (cross or stay)" in report.text
    bench.request(AnswerQuestion("survey", "Ask", "cross"))
    bench.step()
    bench.crash()
    bench.step()
    bench.request(ResumePlan("survey"))
    assert bench.until(COMPLETED, FAILED) is COMPLETED
    assert requests(bench)[-1] == MoveForward(-0.3)
    assert len([r for r in bench.received.reports if "The ditch?" in r.text]) == 1


@pytest.mark.parametrize(("default", "status"), [(' default="stay"', COMPLETED), ("", FAILED)])
def test_without_an_answer_the_default_counts_also_over_a_restart(
    bench: PlanBench, default: str, status: PlanStatus
) -> None:
    bench.begin(with_question(default), 1.0)
    bench.crash()
    bench.clock.advance(20.0)
    bench.step()
    bench.request(ResumePlan("survey"))
    bench.run(0.2)
    assert bench.until(COMPLETED, FAILED) is status
    assert requests(bench) == ([SetCameraAngles(0.1, None)] if default else [])


def test_the_reason_of_a_refusal_and_the_file_are_variables(bench: PlanBench) -> None:
    body = """<Sequence>
      <takePicture deadline_s="9" file="{file}"/>
      <ForceSuccess><deleteFile path="none.jpg" deadline_s="9" reason="{why}"/></ForceSuccess>
      <ScriptCondition code="why == 601 &amp;&amp; file &gt; 'pictures/'"/>
      <deleteFile name="again" path="{file}" deadline_s="9" reason="{why}"/>
      <ScriptCondition name="done" code="why == 0"/>
    </Sequence>"""
    assert bench.outcome(body) is COMPLETED, bench.status()
    assert list(bench.executive.files.paths()) == []


def test_conditions_on_the_rover(bench: PlanBench) -> None:
    body = f"""<Sequence>
      <Near x="0" y="0" within="0.3"/><Inverter><Near name="far" x="3" y="0" within="1"/></Inverter>
      <Reachable x="1" y="1"/><Inverter><Reachable name="too far" x="9000" y="0"/></Inverter>
      <Inverter><FaultActive name="battery_low"/></Inverter>{BACK}
    </Sequence>"""
    assert bench.outcome(body) is COMPLETED, bench.status()


@pytest.mark.parametrize("condition", ["Near within='1'", "Reachable"])
def test_a_text_that_is_no_number_fails_a_condition_on_a_point(
    bench: PlanBench, condition: str
) -> None:
    def outcome(text: str) -> PlanStatus:
        test = f"""<{condition} name="there" x="{{x}}" y="0"/>"""
        done = bench.outcome(f"<Sequence><Script code=\"x := '{text}'\"/>{test}{BACK}</Sequence>")
        bench.request(RemovePlan("survey"))
        return done

    assert outcome("0.2") is COMPLETED
    assert outcome("a") is FAILED
    assert bench.received.plans[-1].text == "plan:survey/Sequence/there: x 'a' is not a number in m"


def test_a_suspension_halts_no_node_and_stores_the_rest_of_a_sleep(bench: PlanBench) -> None:
    body = f"""<Sequence><Script code="halted := 0"/>
      <Sequence name="in" _onHalted="halted := 1"><Sleep msec="4000"/>{BACK}</Sequence>
      <ScriptCondition code="halted == 0"/></Sequence>"""
    bench.begin(body, 3.0)
    bench.request(SuspendPlan("survey"))
    bench.run(30.0)
    bench.request(ResumePlan("survey"))
    bench.run(0.5)
    assert bench.commanded() == []
    bench.run(1.0)
    assert len(bench.commanded()) == 1
    assert bench.until(COMPLETED, FAILED) is COMPLETED, bench.status()


def test_a_sleep_continues_by_the_clock_while_the_process_is_down(bench: PlanBench) -> None:
    bench.begin(f'<Sequence><Sleep msec="60000"/>{BACK}</Sequence>', 3.0)
    bench.executive.simulate_crash()
    bench.clock.advance(58.0)
    bench.restart()
    bench.run(2.0)  # suspended, it does not continue
    bench.request(ResumePlan("survey"))
    assert bench.commanded() == []
    bench.run(0.2)
    bench.request(ResumePlan("survey"))
    bench.run(0.2)
    assert len(bench.commanded()) == 1


def test_an_abort_runs_the_scripts_of_halted_nodes_and_commands_nothing(bench: PlanBench) -> None:
    body = f'<TryCatch catch_on_halt="true"><Sequence>{LONG}</Sequence>{BACK}</TryCatch>'
    bench.begin(body, 1.0)
    bench.request(AbortPlan("survey"))
    bench.run(1.0)
    assert bench.ends() == [Stage.CANCELLED]
    assert bench.rover.velocity == STANDING


@pytest.mark.parametrize("cause", ["abort", "time limit"])
def test_a_halt_reports_no_question(bench: PlanBench, cause: str) -> None:
    cleanup = with_question()
    caught = f'<TryCatch catch_on_halt="true"><Sequence>{LONG}</Sequence>{cleanup}</TryCatch>'
    limit = 1_000 if cause == "time limit" else 9_000
    bench.begin(f'<Fallback><Timeout msec="{limit}">{caught}</Timeout>{BACK}</Fallback>', 0.5)
    if cause == "abort":
        bench.request(AbortPlan("survey"))
    bench.run(5.0)
    assert bench.ends() == [Stage.CANCELLED, *([Stage.EXECUTED] * (cause == "time limit"))]
    assert not [each for each in bench.received.reports if "The ditch?" in each.text]


def test_a_wrong_script_does_not_prevent_an_abort(bench: PlanBench) -> None:
    bench.begin(f'<Sequence _onHalted="x := 1 / (@LINK_UP - @LINK_UP)">{LONG}</Sequence>', 1.0)
    bench.request(AbortPlan("survey"))
    assert bench.status().status is PlanStatus.ABORTED
    assert bench.ends() == [Stage.CANCELLED]


def test_the_nominal_course_takes_the_branch_that_the_switch_takes(bench: PlanBench) -> None:
    names = ("one", "two", "else")
    leaves = "".join(BACK.replace("/>", f' name="{name}"/>') for name in names)
    switch = f'<Switch2 variable="{{x}}" case_1="1" case_2="two">{leaves}</Switch2>'
    body = f"<Sequence><Script code=\"x := '1.0'\"/>{switch}</Sequence>"
    root = read_plan(plan(body))
    assert isinstance(root, PlanRoot)
    course = [each.location.name for each in nominal_steps(root) if isinstance(each, PlanStep)]
    assert bench.outcome(body) is COMPLETED
    assert course == [bench.status().node.rpartition("/")[2]] == ["one"]


def test_a_switch_fails_while_its_telemetry_is_not_known(bench: PlanBench) -> None:
    bench.voltage_v = None
    bench.executive.status.battery = None
    body = f'<Switch2 variable="{{@BATERY_VOLTAGE}}" case_1="1" case_2="2">{BACK * 3}</Switch2>'
    assert bench.outcome(body) is FAILED
    assert bench.status().text.endswith("BATERY_VOLTAGE is not known")
    assert bench.commanded() == []


def test_a_wrong_script_fails_the_plan(bench: PlanBench) -> None:
    body = f'<Fallback><Script code="x := 1 / (@LINK_UP - @LINK_UP)"/>{BACK}</Fallback>'
    assert bench.outcome(body) is FAILED
    assert "plan:survey/Fallback/Script" in bench.status().text
    assert "division by zero" in bench.status().text


OTHER = '<Fallback><AlwaysFailure name="other"/><AlwaysSuccess/></Fallback>'
"""A failure that is not the reason of the plan's."""
UNKNOWN = '<WaitFor if="@BATERY_VOLTAGE &gt; 1" deadline_s="90"/>'


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (f'<Precondition if="@POS_X &gt; 99">{BACK}</Precondition>', "not @POS_X > 99"),
        ('<AlwaysSuccess name="Precondition" _failureIf="1 == 1"/>', "_failureIf: 1 == 1"),
        ("<Inverter><AlwaysSuccess/></Inverter>", "AlwaysSuccess succeeded"),
        ("<ForceFailure><AlwaysSuccess/></ForceFailure>", "AlwaysSuccess succeeded"),
        ('<ForceFailure><AlwaysFailure name="why"/></ForceFailure>', "why: fails always"),
        (
            '<LoopString queue="a" value="{v}" if_empty="FAILURE"><AlwaysSuccess/></LoopString>',
            "no part of the queue is left",
        ),
        (f'<TryCatch><AlwaysFailure name="why"/>{OTHER}</TryCatch>', "why: fails always"),
        (
            f"""<ParallelAll><AlwaysFailure name="why"/>
            <Sequence><Sleep msec="500"/>{OTHER}</Sequence></ParallelAll>""",
            "why: fails always",
        ),
        (
            f"""<ParallelAll><Sequence><Sleep msec="500"/><AlwaysFailure name="why"/></Sequence>
            <Timeout msec="700">{UNKNOWN}</Timeout></ParallelAll>""",
            "Timeout: not done within 0.7 s",
        ),
    ],
)
def test_a_plan_fails_with_the_reason_of_the_node_that_failed(
    bench: PlanBench, body: str, text: str
) -> None:
    bench.voltage_v = None
    bench.executive.status.battery = None
    assert bench.outcome(f"<Sequence>{OTHER}{body}{BACK}</Sequence>") is FAILED
    assert bench.status().text.endswith(text), bench.status().text


def test_a_wait_for_an_unknown_value_is_no_failure(bench: PlanBench) -> None:
    bench.voltage_v = None
    bench.executive.status.battery = None
    body = f'<Parallel success_count="1">{UNKNOWN}<Sequence>{BACK}{BACK}</Sequence></Parallel>'
    assert bench.outcome(body) is COMPLETED
    assert not [each for each in bench.received.plans if "is not known" in each.text]


def test_a_plan_that_is_skipped_is_not_completed(bench: PlanBench) -> None:
    assert bench.outcome(f'<Sequence _skipIf="true">{BACK}</Sequence>') is FAILED
    assert "skipped" in bench.status().text


def resuming(body: str) -> bytes:
    return xml(body).replace(b"<root ", b'<root after_restart="resume" ')


def begin_resuming(bench: PlanBench) -> None:
    bench.go(replace(plan(""), content=resuming(f"<Sequence>{BACK}{LONG}</Sequence>")))
    bench.run(5.0)


def test_after_a_restart_a_plan_may_continue_by_itself_three_times(bench: PlanBench) -> None:
    begin_resuming(bench)
    for number in range(1, 5):
        bench.crash()
        bench.run(1.0)
        status = PlanStatus.EXECUTING if number <= 3 else SUSPENDED
        assert bench.status().status is status, number
    assert bench.ends() == [Stage.EXECUTED, *[Stage.FAILED] * 4]


@pytest.mark.parametrize("cause", ["stop", "stop before", "suspended", "moved", "no odometry"])
def test_it_does_not_continue_by_itself_after_another_cause(bench: PlanBench, cause: str) -> None:
    begin_resuming(bench)
    match cause:
        case "stop before":
            bench.numbered(Stop())
        case "suspended":
            bench.request(SuspendPlan("survey"))
        case "moved":
            bench.rover.pose = Pose(bench.rover.pose.x_m, 5.0)
        case "no odometry":
            bench.odometry = False
        case _:
            pass
    bench.crash()
    if cause == "stop":
        bench.numbered(Stop())
        bench.numbered(Resume())
    bench.run(2.0)
    assert bench.status().status is SUSPENDED
    assert bench.rover.velocity == STANDING


def end_orderly(bench: PlanBench) -> None:
    bench.executive.close()
    bench.clock.advance(600.0)
    bench.restart()


@pytest.mark.parametrize("cause", ["", "plan text", "stop", "suspended", "stop after"])
def test_it_continues_by_itself_after_an_orderly_end_without_another_cause(
    bench: PlanBench, cause: str
) -> None:
    if cause == "plan text":
        bench.begin(f"<Sequence>{BACK}{LONG}</Sequence>", 5.0)
    else:
        begin_resuming(bench)
    if cause == "stop":
        bench.numbered(Stop())
    elif cause == "suspended":
        bench.request(SuspendPlan("survey"))
    end_orderly(bench)
    if cause == "stop after":
        bench.numbered(Stop())
        bench.numbered(Resume())
    bench.run(1.0)
    assert bench.status().status is (SUSPENDED if cause else PlanStatus.EXECUTING)
    if not cause:
        assert bench.status().done == 1
        assert bench.ends()[:2] == [Stage.EXECUTED, Stage.CANCELLED]
        assert len(bench.ends()) == 3


def test_the_first_position_that_is_known_is_stored(bench: PlanBench) -> None:
    bench.executive.status.raise_uncertainty(0.5, 0.1, "a test")
    wait = f'<Sequence><Sleep msec="600000"/>{BACK}</Sequence>'
    bench.go(replace(plan(""), content=resuming(wait)))
    bench.run(1.0)
    bench.executive.status.uncertainty = Uncertainty()
    bench.run(1.0)
    bench.crash()
    bench.run(1.0)
    assert bench.status().status is PlanStatus.EXECUTING


@pytest.mark.parametrize(("charge_ratio", "status"), [(0.1001, SUSPENDED), (0.9, EXECUTING)])
@pytest.mark.parametrize("late_s", [0.0, 5.0])
def test_it_continues_by_itself_only_with_enough_energy(
    bench: PlanBench, charge_ratio: float, status: PlanStatus, late_s: float
) -> None:
    bench.charge_ratio = 0.9
    begin_resuming(bench)
    bench.executive.simulate_crash()
    bench.voltage_v, bench.charge_ratio = None, charge_ratio
    bench.restart()
    bench.run(late_s)
    bench.voltage_v = 26.0
    bench.run(1.0)
    assert bench.status().status is status
    low = [each for each in bench.received.reports if each.reason is Reason.BATTERY_INSUFFICIENT]
    assert len(low) == (status is SUSPENDED)


def test_the_energy_of_steps_that_have_ended_is_not_needed(bench: PlanBench) -> None:
    bench.charge_ratio = 0.9
    far = LONG.replace("50", "100")
    steps = f'<Sequence><ForceSuccess>{far}</ForceSuccess><Sleep msec="600000"/>{BACK}</Sequence>'
    bench.go(replace(plan(""), content=resuming(steps)))
    bench.run(2.0)
    bench.request(SkipNode("survey", "long", "SUCCESS"))
    bench.run(2.0)
    bench.charge_ratio = 0.103
    bench.crash()
    bench.run(1.0)
    assert bench.status().status is EXECUTING


def test_the_state_of_a_plan_is_one_row_that_does_not_grow(bench: PlanBench) -> None:
    bench.begin(f'<Sequence><Sleep msec="600000"/>{BACK}</Sequence>', 0.5)
    writes = bench.ledger.sealed
    bench.run(20 * STEP_S)
    before = bench.ledger.rows("SELECT count(*), length(state) FROM plan_states")
    bench.run(100.0)
    assert bench.ledger.rows("SELECT count(*), length(state) FROM plan_states") == before
    assert bench.ledger.sealed - writes < 30
    bench.request(AbortPlan("survey"))
    bench.step()
    ((final,),) = bench.ledger.rows("SELECT state FROM plan_states")
    assert len(final) < 500  # the last table of its nodes
    bench.request(RemovePlan("survey"))
    bench.step()
    assert bench.ledger.rows("SELECT * FROM plan_states") == []


DAMAGES: dict[str, Callable[[str], object]] = {
    "a letter of a status": lambda text: text.replace("R", "X", 1),
    "another status": lambda text: text.replace("R", "S", 1),
    "a figure": lambda text: text.replace("1", "2", 1),
    "the end": lambda text: text[:-9],
    "all": lambda _: "",
    "octets": lambda text: text.encode(),
    "too deep": lambda text: "[" * 5000 + text,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_state_fails_the_plan_by_name(
    bench: PlanBench, damage: Callable[[str], object]
) -> None:
    begin_resuming(bench)
    ((text,),) = bench.ledger.rows("SELECT state FROM plan_states")
    bench.ledger.write("UPDATE plan_states SET state = ?", (damage(text),))
    bench.step()
    bench.crash()
    bench.run(0.5)
    assert bench.status().status is SUSPENDED
    assert bench.plan_refusal(SkipNode("survey", "long", "SUCCESS")).reason is Reason.PLAN_STATUS
    assert bench.resumed() is FAILED
    assert bench.status().text.startswith("survey: the stored state")


def test_the_state_of_another_text_fails_the_plan_by_name(bench: PlanBench) -> None:
    bench.begin(f"<Sequence>{BACK}{LONG}</Sequence>", 3.0)
    bench.request(SuspendPlan("survey"))
    bench.step()
    content = plan(f"<Sequence>{LONG}{BACK}</Sequence>").content
    bench.ledger.write("UPDATE plans SET content = ? WHERE plan_id = 'survey'", (content,))
    bench.step()
    bench.request(ResumePlan("survey"))
    bench.run(0.2)
    assert bench.status().status is FAILED
    assert (
        bench.status().text
        == "survey: the stored state is of another text, of other arguments or nodes"
    )
