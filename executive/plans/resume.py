"""`skipped_steps` returns the nodes that a plan skips when it is resumed at a named step.

A plan can be resumed at the nodes that it executes one after the other: those below nothing but
sequences, each as a whole. A step that has ended cannot be named, because no step is repeated.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from executive.plans.model import PlanNode, SequenceNode
from executive.values.reasons import Reason, Refusal


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """A node that an operator can name to resume a plan there.

    Attributes:
        paths: its path, after those of the sequences that begin with it.
    """

    node: PlanNode
    paths: tuple[str, ...]

    def is_named(self, name: str) -> bool:
        """Whether a name is one of its paths, or the end of one."""
        return any(f"/{path}".endswith(f"/{name}") for path in self.paths)


def resume_points(node: PlanNode, above: tuple[str, ...] = ()) -> Iterator[ResumePoint]:
    """Yield the nodes that a plan executes one after the other."""
    paths = (*above, node.location.path)
    if not isinstance(node, SequenceNode):
        yield ResumePoint(node, paths)
        return
    for child in node.children:
        yield from resume_points(child, paths)
        paths = ()


def skipped_steps(
    root: PlanNode, step: str, last: str, ended: Collection[str]
) -> tuple[PlanNode, ...] | Refusal:
    """Return the nodes to skip from the interruption to a named step, or a refusal.

    Args:
        root: root node of the plan.
        step: name of the step: a path in the plan, or the end of one.
        last: path of the leaf that started or ended last.
        ended: keys of the steps in the journal.
    """
    points = tuple(resume_points(root))
    begun = [index for index, each in enumerate(points) if _is_in(last, each.node.location.path)]
    after = range(max(begun, default=0), len(points))
    present = next(
        (i for i in after if str(points[i].node.location.number) not in ended), len(points)
    )
    named = [index for index, each in enumerate(points) if each.is_named(step)]
    if len(named) == 1 and named[0] >= present:
        return tuple(each.node for each in points[present : named[0]])
    plan, names = root.location.path, ", ".join(map(_label, points[present:])) or "none"
    if len(named) == 1:
        text = f"step {step[:64]} of {plan} has ended and is not repeated; remaining steps: {names}"
        return Refusal(Reason.PLAN_STATUS, text, argument=2)
    text = f"{len(named) or 'no'} steps of {plan} are named {step[:64]!r}; remaining steps: {names}"
    return Refusal(Reason.NO_SUCH_STEP, text, argument=2, subject=step[:64])


def _is_in(path: str, whole: str) -> bool:
    return f"{path}/".startswith(f"{whole}/")


def _label(point: ResumePoint) -> str:
    return point.node.location.path.partition("/")[2]
