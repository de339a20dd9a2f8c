"""Plans for tests: their text, and a bench that knows how to send them."""

from executive.commands import (
    ActivatePlan,
    PlanArgument,
    PlanDefinition,
    PlanRequest,
    Request,
    ResumePlan,
    SubmitPlan,
)
from executive.commands.lifecycle import Accepted, SubmitResult
from executive.values.reasons import Refusal
from executive.values.reports import PlanStatus, PlanUpdate, Report, Stage
from tests.support.kinematic import STEP_S, Bench
from trees import TreeNodeSnapshot, snapshot_of

AHEAD = '<moveForward distance="4" deadline_s="60"/>'
BACK = '<moveForward distance="-1" deadline_s="60"/>'
TOO_LATE = '<moveForward distance="50" deadline_s="1"/>'


def xml(body: str, others: str = "") -> bytes:
    """Return the text of a plan whose main tree has this root node."""
    return (
        '<root BTCPP_format="4" main_tree_to_execute="Main">\n'
        f'<BehaviorTree ID="Main">\n{body}\n</BehaviorTree>\n{others}</root>\n'
    ).encode()


def plan(body: str, plan_id: str = "survey", others: str = "", **arguments: str) -> PlanDefinition:
    """Return a plan."""
    given = tuple(PlanArgument(name, text) for name, text in arguments.items())
    return PlanDefinition(plan_id, "A test", "BTCPP4", xml(body, others), given)


class PlanBench(Bench):
    """A bench with plans."""

    number = 1000

    def request(self, request: PlanRequest) -> SubmitResult:
        """Send a command about a plan."""
        return self.numbered(request)

    def plan_refusal(self, request: PlanRequest) -> Refusal:
        """Send a command about a plan that is refused, and return why."""
        self.number += 1
        return self.refusal(request, self.number)

    def numbered(self, request: Request) -> SubmitResult:
        """Send a command under a new number."""
        self.number += 1
        return self.submit(request, self.number)

    def go(self, definition: PlanDefinition) -> None:
        """Submit and activate a plan."""
        for request in (SubmitPlan(definition), ActivatePlan(definition.plan_id)):
            answer = self.request(request)
            assert isinstance(answer, Accepted), answer

    def begin(self, body: str, duration_s: float = 1.0) -> None:
        """Run a plan for a while."""
        self.go(plan(body))
        self.run(duration_s)

    def resumed(self) -> PlanStatus:
        """Resume the plan and run it to its end."""
        self.request(ResumePlan("survey"))
        return self.until(PlanStatus.COMPLETED, PlanStatus.FAILED)

    def status(self, plan_id: str = "survey") -> PlanUpdate:
        """Return how far a plan has come."""
        (found,) = (u for u in self.executive.plans() if u.plan_id == plan_id)
        return found

    def nodes(self) -> tuple[TreeNodeSnapshot, ...]:
        """Return the nodes of the tree."""
        return snapshot_of(self.executive, 0.0).nodes

    def until(
        self, *statuses: PlanStatus, plan_id: str = "survey", limit_s: float = 300.0
    ) -> PlanStatus:
        """Let time pass until a plan is in one of these statuses."""
        for _ in range(round(limit_s / STEP_S)):
            if self.status(plan_id).status in statuses:
                return self.status(plan_id).status
            self.step()
        raise AssertionError(f"{self.status(plan_id)} after {limit_s} s")

    def outcome(self, body: str, others: str = "") -> PlanStatus:
        """Run a plan to its end."""
        self.go(plan(body, others=others))
        return self.until(PlanStatus.COMPLETED, PlanStatus.FAILED)

    def ends(self) -> list[Stage]:
        """Return how each of the plan's commands ended, or where it is, by number."""
        return [stages[-1] for _, stages in self.commanded()]

    def commanded(self, plan_id: str = "survey") -> list[tuple[int, list[Stage]]]:
        """Return the plan's commands by number, each with its stages."""
        stages_by_number: dict[int, list[Stage]] = {}
        for report in self.of(plan_id):
            assert report.identity is not None
            assert report.stage is not None
            stages_by_number.setdefault(report.identity.command_id, []).append(report.stage)
        return sorted(stages_by_number.items())

    def of(self, plan_id: str = "survey") -> list[Report]:
        """Return the reports on the plan's commands."""
        source = f"plan:{plan_id}"
        return [r for r in self.received.reports if r.identity and r.identity.source == source]
