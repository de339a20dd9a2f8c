"""Whatever happens to a plan, and when: nothing is done twice, every command has one end."""

from collections import Counter
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from executive.commands import Resume, Stop
from executive.facts import Odometry
from executive.geometry import STANDING, Pose
from executive.plans.definition import PlanStatus
from executive.plans.lifecycle import EDGES, FINAL
from executive.plans.requests import AbortPlan, ActivatePlan, ResumePlan, SubmitPlan, SuspendPlan
from executive.reports import Stage
from tests.support.plans import PlanBench, plan

BODY = """<Sequence>
  <moveForward distance="0.31" deadline_s="60"/>
  <Parallel success_count="1">
    <setAngles pan="2.1" deadline_s="60"/>
    <Sequence><rotateBy angle="0.4" deadline_s="60"/><moveForward distance="0.32" deadline_s="60"/></Sequence>
  </Parallel>
  <Fallback>
    <Timeout msec="900"><moveForward distance="5"/></Timeout>
    <rotateBy angle="-0.5" deadline_s="60"/>
  </Fallback>
  <Inverter>
    <RetryUntilSuccessful num_attempts="2"><delete path="nothing.jpg" deadline_s="5"/></RetryUntilSuccessful>
  </Inverter>
  <Repeat num_cycles="2"><setTravelSpeed speed="0.7" deadline_s="5"/></Repeat>
  <takePicture deadline_s="9"/>
</Sequence>"""  # noqa: E501

ALWAYS = Counter(
    {
        '{"distance_m": 0.31}': 1,
        '{"angle_rad": -0.5}': 1,
        '{"speed_mps": 0.7}': 2,
        '{"width_px": null, "height_px": null, "format": null, "quality": null}': 1,
    }
)
"""What is executed in the end, whatever happened: each as often as the plan says."""

SOMETIMES = {'{"angle_rad": 0.4}', '{"distance_m": 0.32}', '{"pan_rad": 2.1, "tilt_rad": null}'}


class AnyTime(RuleBasedStateMachine):
    """A plan, and all that can happen to it."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = TemporaryDirectory()
        self.bench = PlanBench(Path(self.folder.name))
        self.bench.rover.lazy_camera = True
        self.bench.ask(SubmitPlan(plan(BODY)))

    @property
    def status(self) -> PlanStatus:
        return self.bench.status().status

    @rule()
    def activate(self) -> None:
        self.bench.ask(ActivatePlan("survey"))

    @rule()
    def go_on(self) -> None:
        self.bench.ask(ResumePlan("survey"))

    @rule(steps=st.integers(1, 40))
    def wait(self, steps: int) -> None:
        for _ in range(steps):
            self.bench.step()

    @rule()
    def suspend(self) -> None:
        self.bench.ask(SuspendPlan("survey"))

    @rule()
    def stop_and_resume(self) -> None:
        PlanBench.numbers += 2
        self.bench.submit(Stop(), PlanBench.numbers)
        assert self.bench.rover.velocity == STANDING
        assert not self.status.running
        self.bench.run(1.0)
        self.bench.submit(Resume(), PlanBench.numbers + 1)
        PlanBench.numbers += 1

    @rule()
    def jump(self) -> None:
        rover = self.bench.rover
        rover.pose = Pose(rover.pose.x_m + 3.0, rover.pose.y_m, heading_rad=rover.pose.heading_rad)
        now_s = self.bench.clock.now_s()
        self.bench.executive.observe(Odometry(now_s, rover.pose, rover.velocity))
        self.bench.executive.tick()
        assert not self.status.running
        self.bench.run(1.0)
        PlanBench.numbers += 1
        self.bench.submit(Resume(), PlanBench.numbers)

    @rule()
    def crash(self) -> None:
        self.bench.crash()
        self.bench.step()
        assert not self.status.running

    @precondition(lambda self: self.status is PlanStatus.SUSPENDED)
    @rule()
    def stands_while_suspended(self) -> None:
        self.bench.run(2.5)
        assert self.bench.rover.velocity == STANDING
        assert all(stages[-1].terminal for _, stages in self.bench.commanded())

    @invariant()
    def statuses_follow_the_table(self) -> None:
        allowed = {(edge.source, edge.target) for edge in EDGES}
        statuses = [update.status for update in self.bench.heard.plans]
        for before, after in pairwise(statuses):
            assert before is after or (before, after) in allowed

    @invariant()
    def a_command_ends_once(self) -> None:
        for _, stages in self.bench.commanded():
            assert sum(stage.terminal for stage in stages) <= 1

    @invariant()
    def nothing_is_executed_more_often_than_the_plan_says(self) -> None:
        done = self.executed()
        assert not done - ALWAYS - Counter(SOMETIMES)

    def executed(self) -> Counter[str]:
        ledger = self.bench.executive.ledger
        rows = ledger.rows("SELECT command_id, request FROM commands WHERE source = 'plan:survey'")
        asked = dict(rows)
        return Counter(
            asked[number]
            for number, stages in self.bench.commanded()
            if stages[-1] is Stage.EXECUTED
        )

    def teardown(self) -> None:
        self.bench.run(1.0)
        for _ in range(3):
            self.bench.ask(ActivatePlan("survey"))
            self.bench.ask(ResumePlan("survey"))
            self.bench.until(*FINAL, PlanStatus.SUSPENDED)
        assert self.status is PlanStatus.COMPLETED, self.bench.status()
        assert Counter({k: n for k, n in self.executed().items() if k in ALWAYS}) == ALWAYS
        assert all(stages[-1].terminal for _, stages in self.bench.commanded())
        assert self.bench.executive.ledger.rows("SELECT * FROM plan_steps") == []
        self.bench.executive.ledger.abandon()
        self.folder.cleanup()


TestAnyTime = AnyTime.TestCase
TestAnyTime.settings = settings(max_examples=40, stateful_step_count=20, deadline=None)

GOOD = '<setTravelSpeed speed="{}" deadline_s="5"/>'
BAD = '<delete path="{}.jpg" deadline_s="5"/>'
TREES = st.recursive(
    st.sampled_from(["good", "bad"]),
    lambda below: st.one_of(
        st.tuples(
            st.sampled_from(["Sequence", "Fallback"]), st.lists(below, min_size=1, max_size=3)
        ),
        st.tuples(
            st.sampled_from(["Inverter", "Repeat", "RetryUntilSuccessful"]),
            st.lists(below, min_size=1, max_size=1),
        ),
    ),
    max_leaves=8,
)
EXTRA = {"Repeat": ' num_cycles="2"', "RetryUntilSuccessful": ' num_attempts="2"'}


def written(tree: object) -> str:
    """Return a random tree as XML."""
    if tree == "good":
        return GOOD.format("0.5")
    if tree == "bad":
        return BAD.format("nothing")
    kind, children = tree  # type: ignore[misc]
    return f"<{kind}{EXTRA.get(kind, '')}>{''.join(map(written, children))}</{kind}>"


def expected(tree: object, asked: list[bool]) -> bool:
    """Run a random tree in the head: whether it succeeds, and how each command ends."""
    if tree in ("good", "bad"):
        asked.append(tree == "good")
        return asked[-1]
    kind, children = tree  # type: ignore[misc]
    match kind:
        case "Sequence":
            return all(expected(child, asked) for child in children)
        case "Fallback":
            return any(expected(child, asked) for child in children)
        case "Inverter":
            return not expected(children[0], asked)
        case "Repeat":
            return expected(children[0], asked) and expected(children[0], asked)
        case _:
            return expected(children[0], asked) or expected(children[0], asked)


@given(TREES, st.lists(st.integers(0, 40), max_size=3), st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_plan_runs_as_in_the_head(tree: object, breaks: list[int], crashes: bool) -> None:
    asked: list[bool] = []
    succeeds = expected(tree, asked)
    with TemporaryDirectory() as folder:
        bench = PlanBench(Path(folder))
        bench.go(plan(written(tree)))
        for steps in breaks:
            for _ in range(steps):
                bench.step()
            if crashes:
                bench.crash()
            else:
                bench.ask(SuspendPlan("survey"))
            bench.step()
            bench.ask(ResumePlan("survey"))
        end = bench.until(*FINAL)
        assert end is (PlanStatus.COMPLETED if succeeds else PlanStatus.FAILED)
        assert [stages[-1] for _, stages in bench.commanded()] == [
            Stage.EXECUTED if good else Stage.REJECTED for good in asked
        ]
        bench.ask(AbortPlan("survey"))
        assert bench.status().status is end
        bench.executive.ledger.abandon()
