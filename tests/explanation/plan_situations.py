"""Situations of plans: what is wrong with one, what becomes of it, and of its commands."""

from collections.abc import Callable
from typing import Final

from executive.commands import (
    AbortPlan,
    ActivatePlan,
    MoveForward,
    PlanDefinition,
    RemovePlan,
    Request,
    Stop,
    SubmitPlan,
    SuspendPlan,
)
from executive.plans.plan_xml import MAX_PLAN_OCTETS
from executive.values.reasons import Reason
from tests.explanation.case import Case
from tests.support.kinematic import Bench
from tests.support.plans import AHEAD, BACK, TOO_LATE, plan, xml

CASES: Final = f"""<Sequence><Script code="way:='cross'"/>
  <Switch2 variable="{{way}}" case_1="cross" case_2="stay">{AHEAD}{BACK}<AlwaysFailure/></Switch2>
</Sequence>"""

STEP: Final = "plan:survey:1"
"""The first command of the plan."""


def _refused(reason: Reason, text: bytes, message: str = "", form: str = "BTCPP4") -> Case:
    request = SubmitPlan(PlanDefinition("survey", "A test", form, text))
    return Case(
        f"plan refused {reason.name}",
        lambda bench: bench.submit(request, 1),
        "MOE:1",
        reason,
        message,
    )


def _runs(body: str, *others: Request, for_s: float = 1.0) -> Callable[[Bench], None]:
    """Return what lets a plan run, and then gives commands, the last of them as number 1."""

    def inject(bench: Bench) -> None:
        bench.submit(SubmitPlan(plan(body)), 5)
        bench.submit(ActivatePlan("survey"), 6)
        bench.run(for_s)
        for number, request in zip(range(len(others), 0, -1), others, strict=True):
            bench.submit(request, number)
        bench.run(0.5)

    return inject


def _too_many(bench: Bench) -> None:
    for number in range(2, 200):
        bench.submit(SubmitPlan(plan(AHEAD, f"plan{number}")), number)
    bench.submit(SubmitPlan(plan(AHEAD)), 1)


def _continues(bench: Bench) -> None:
    in_parallel = f'<Parallel success_count="1">{AHEAD}<takePicture deadline_s="30"/></Parallel>'
    _runs(f"<Sequence>{in_parallel}{BACK}</Sequence>", for_s=2.0)(bench)


PLANS: Final = (
    _refused(Reason.PLAN_FORMAT, xml(AHEAD), form="SCXML"),
    _refused(Reason.PLAN_TOO_LARGE, b" " * (MAX_PLAN_OCTETS + 1)),
    _refused(Reason.PLAN_STRUCTURE, xml("<Sequence/>"), "needs at least 1 child"),
    _refused(Reason.PLAN_UNKNOWN_NODE, xml("<fly/>"), "unknown node 'fly'"),
    _refused(Reason.PLAN_BAD_ARGUMENT, xml('<moveForward distance="far" deadline_s="9"/>')),
    Case("plan there already", _runs(AHEAD, SubmitPlan(plan(BACK))), "MOE:1", Reason.PLAN_EXISTS),
    Case(
        "another plan has the rover",
        _runs(AHEAD, SubmitPlan(plan(BACK, "second")), ActivatePlan("second")),
        "MOE:1",
        Reason.PLAN_ACTIVE,
    ),
    Case("running plan kept", _runs(AHEAD, RemovePlan("survey")), "MOE:1", Reason.PLAN_STATUS),
    Case("too many plans", _too_many, "MOE:1", Reason.TOO_MANY_PLANS),
    Case("step too late", _runs(TOO_LATE, for_s=2.0), STEP, Reason.PLAN_DEADLINE),
    Case(
        "now: plan failed", _runs(TOO_LATE, for_s=2.0), None, Reason.PLAN_DEADLINE, "plan:survey:1"
    ),
    Case(
        "step of the second branch",
        _runs(f'<Fallback name="there">{TOO_LATE}{AHEAD}</Fallback>', for_s=2.0),
        "plan:survey:2",
        None,
        "there took the second branch moveForward 2: moveForward was CANCELLED 761",
    ),
    Case(
        "step of a case",
        _runs(CASES),
        STEP,
        None,
        "Switch2 took the case 1 moveForward: way is cross",
    ),
    Case(
        "now: a plan waits on its second branch",
        _runs(
            f'<Fallback name="there">{TOO_LATE}<Sequence><Sleep msec="60000"/>{AHEAD}</Sequence>'
            "</Fallback>",
            for_s=2.0,
        ),
        None,
        Reason.PLAN_DEADLINE,
        "there took the second branch Sequence: moveForward was CANCELLED 761",
    ),
    Case("step suspended", _runs(AHEAD, SuspendPlan("survey")), STEP, Reason.PLAN_SUSPENDED),
    Case("step aborted", _runs(AHEAD, AbortPlan("survey")), STEP, Reason.PLAN_ABORTED),
    Case("step that is not waited for", _continues, STEP, Reason.STEP_HALTED),
    Case("step stopped", _runs(AHEAD, Stop()), STEP, Reason.STOPPED, "MOE requested stop"),
    Case(
        "refused while a plan runs",
        _runs(AHEAD, MoveForward(1.0)),
        "MOE:1",
        Reason.WRONG_MODE,
        "PLAN",
    ),
)
