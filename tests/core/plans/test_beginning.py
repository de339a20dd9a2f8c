"""When a plan may begin or go on."""

from executive.commands.catalogue import ActivatePlan, ResumePlan, SubmitPlan
from executive.commands.lifecycle import Refused
from executive.reasons import Reason
from executive.reports import PlanStatus
from tests.support.plans import AHEAD, PlanBench, plan


def test_a_plan_does_not_begin_before_the_rover_knows_where_it_is(bench: PlanBench) -> None:
    bench.ask(SubmitPlan(plan(AHEAD)))
    bench.crash()
    too_early = bench.ask(ActivatePlan("survey"))
    assert isinstance(too_early, Refused)
    assert too_early.refusal.reason is Reason.NO_ODOMETRY
    bench.step()
    bench.ask(ActivatePlan("survey"))
    bench.run(1.0)
    bench.crash()
    bench.odometry = False
    bench.run(1.0)
    too_early = bench.ask(ResumePlan("survey"))
    assert isinstance(too_early, Refused)
    assert too_early.refusal.text == "no odometry yet: the rover does not know where it is"
    assert bench.status().status is PlanStatus.SUSPENDED
    bench.odometry = True
    bench.step()
    bench.ask(ResumePlan("survey"))
    assert bench.until(PlanStatus.COMPLETED, PlanStatus.FAILED) is PlanStatus.COMPLETED
