"""A suspended plan is resumed at a named step: those before it are skipped, none is repeated."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import Resume, ResumePlan, Stop, SuspendPlan
from executive.commands.lifecycle import Accepted, Rejected
from executive.plans import check_plan
from executive.plans.model import resume_points
from executive.values.reasons import Reason, Refusal
from executive.values.reports import PlanStatus, Stage
from tests.support.plans import PlanBench, plan

FINAL = (PlanStatus.COMPLETED, PlanStatus.FAILED)
ROUTE = """<Sequence>
  <moveForward name="wp1" distance="0.31" deadline_s="60"/>
  <moveForward name="wp2" distance="1.5" deadline_s="60"/>
  <Fallback name="photo"><takePicture deadline_s="9"/><rotateBy angle="1" deadline_s="60"/></Fallback>
  <Sequence name="back"><rotateBy angle="0.5" deadline_s="60"/><moveForward name="wp3" distance="0.32" deadline_s="60"/></Sequence>
  <Inverter name="odd"><deleteFile path="nothing.jpg" deadline_s="5"/></Inverter>
  <moveForward name="wp4" distance="0.33" deadline_s="60"/>
</Sequence>"""  # noqa: E501


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    with PlanBench(tmp_path) as bench:
        yield bench


def suspended_at_wp2(bench: PlanBench) -> None:
    bench.go(plan(ROUTE))
    while not bench.status().node.endswith("/wp2"):
        bench.step()
    bench.run(0.5)
    bench.request(SuspendPlan("survey"))


def commands(bench: PlanBench) -> list[str]:
    """Return the requests of the plan in the ledger, in their order."""
    rows = bench.ledger.rows("SELECT request FROM commands WHERE source = 'plan:survey'")
    return [request for (request,) in rows]


def test_the_steps_before_the_named_one_are_skipped_also_after_a_crash(bench: PlanBench) -> None:
    suspended_at_wp2(bench)
    before = len(commands(bench))
    assert isinstance(bench.request(ResumePlan("survey", "wp3")), Accepted)
    ends = [r for r in bench.received.reports if r.stage is Stage.EXECUTED]
    assert ends[-1].text.endswith("at wp3, skipping wp2, photo, rotateBy")
    skipped = [each for each in bench.received.plans if each.text.endswith(": skipped")]
    assert [each.node.rpartition("/")[2] for each in skipped] == ["wp2", "photo", "rotateBy"]
    assert [each.done for each in skipped] == [2, 4, 5]
    bench.crash()  # before it continues
    bench.step()
    assert bench.status().status is PlanStatus.SUSPENDED
    bench.request(ResumePlan("survey"))
    bench.run(0.3)
    assert {"photo", "wp2"} <= {
        each.name for each in bench.nodes() if each.message.startswith("skipped")
    }
    bench.crash()
    bench.step()
    assert bench.plan_refusal(ResumePlan("survey", "photo")).reason is Reason.PLAN_STATUS
    bench.request(ResumePlan("survey", "wp3"))
    assert bench.until(*FINAL) is PlanStatus.COMPLETED
    assert bench.status().done == bench.status().total == 8
    later = set(commands(bench)[before:])
    assert not any("angle" in request or "width" in request for request in later)
    assert bench.ledger.rows("SELECT * FROM plan_steps") == []


def test_a_step_is_refused_that_ended_is_unknown_or_ambiguous(bench: PlanBench) -> None:
    suspended_at_wp2(bench)
    remaining = (
        "remaining steps: Sequence/wp2, Sequence/photo, Sequence/back/rotateBy,"
        " Sequence/back/wp3, Sequence/odd, Sequence/wp4"
    )
    for step, reason, text in (
        ("wp1", Reason.PLAN_STATUS, "step wp1 of plan:survey has ended and is not repeated; "),
        ("wp9", Reason.NO_SUCH_STEP, "no steps of plan:survey are named 'wp9'; "),
        ("takePicture", Reason.NO_SUCH_STEP, "no steps of plan:survey are named 'takePicture'; "),
        ("", Reason.NO_SUCH_STEP, "no steps of plan:survey are named ''; "),
    ):
        refusal = bench.plan_refusal(ResumePlan("survey", step))
        assert (refusal.reason, refusal.text) == (reason, text + remaining)
    assert bench.status().status is PlanStatus.SUSPENDED
    for step in ("wp2", "Sequence/wp2", "plan:survey/Sequence/wp2"):
        assert isinstance(bench.request(ResumePlan("survey", step)), Accepted)
        bench.run(0.2)
        bench.request(SuspendPlan("survey"))
    assert bench.status().done == 1
    bench.request(ResumePlan("survey", "back"))  # a sequence is named for its first step
    assert bench.until(*FINAL) is PlanStatus.COMPLETED
    twice = plan(
        "<Sequence><Sequence><takePicture deadline_s='9'/></Sequence>"
        "<Sequence><takePicture deadline_s='9'/></Sequence></Sequence>",
        "twice",
    )
    bench.go(twice)
    bench.request(SuspendPlan("twice"))
    refusal = bench.plan_refusal(ResumePlan("twice", "takePicture"))
    assert refusal.text.startswith("2 steps of plan:twice are named 'takePicture'; remaining steps")


BREAKS = st.tuples(
    st.integers(0, 40), st.sampled_from(["suspend", "stop", "crash"]), st.integers(0, 6)
)


@pytest.mark.at_length
@given(st.lists(BREAKS, min_size=1, max_size=4))
@settings(max_examples=12, deadline=None)
def test_resumed_anywhere_a_step_is_executed_or_skipped_once(
    breaks: list[tuple[int, str, int]],
) -> None:
    """Each of the plan's steps is executed once or was skipped, and none after it was skipped."""
    with TemporaryDirectory() as folder, PlanBench(Path(folder)) as bench:
        bench.rover.lazy_camera = True
        bench.go(plan(ROUTE))
        root = check_plan(plan(ROUTE), bench.executive.settings)
        assert not isinstance(root, Refusal)
        points = [each.location.path for each, _ in resume_points(root)]
        for steps, how, point in breaks:
            for _ in range(steps):
                bench.step()
            match how:
                case "crash":
                    bench.crash()
                    bench.step()
                case "stop":
                    bench.numbered(Stop())
                    bench.numbered(Resume())
                case _:
                    bench.request(SuspendPlan("survey"))
            if bench.status().status in FINAL:
                break
            known = {each.node for each in bench.received.plans if each.text.endswith("skipped")}
            answer = bench.request(ResumePlan("survey", points[point]))
            if isinstance(answer, Rejected):
                assert answer.refusal.reason is Reason.PLAN_STATUS
                bench.request(ResumePlan("survey"))
            now = {each.node for each in bench.received.plans if each.text.endswith("skipped")}
            assert all(points.index(each) < point for each in now - known)
        assert bench.until(*FINAL) is PlanStatus.COMPLETED, bench.status()
        skipped = [each.node for each in bench.received.plans if each.text.endswith("skipped")]
        executed = Counter(
            commands(bench)[number - 1]
            for number, stages in bench.commanded()
            if stages[-1] is Stage.EXECUTED
        )
        assert max(executed.values(), default=1) == max(Counter(skipped).values(), default=1) == 1
        for name, text in (("wp1", "0.31"), ("wp2", " 1.5"), ("wp3", "0.32"), ("wp4", "0.33")):
            is_skipped = any(each.endswith(f"/{name}") for each in skipped)
            assert is_skipped is not any(text in request for request in executed)
        status = bench.status()
        assert status.done == status.total - (not any(each.endswith("/photo") for each in skipped))
