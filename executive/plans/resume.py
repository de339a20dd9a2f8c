"""`skipped_nodes` returns the nodes that a plan skips when it is resumed at a named step.

A plan can be resumed at the nodes that it executes one after the other: those below nothing but
sequences, each as a whole. A step that has ended cannot be named, because no step is repeated.
"""

from collections.abc import Collection, Iterator

from executive.plans.model import PlanNode, SequenceNode
from executive.values.reasons import Reason, Refusal


def resume_points(
    node: PlanNode, above: tuple[str, ...] = ()
) -> Iterator[tuple[PlanNode, tuple[str, ...]]]:
    """Yield these nodes in order, each with its path and those of sequences that begin with it."""
    paths = (*above, node.location.path)
    if not isinstance(node, SequenceNode):
        yield node, paths
        return
    for child in node.children:
        yield from resume_points(child, paths)
        paths = ()


def skipped_nodes(
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
    at = [each.location for each, _ in points]
    begun = [i for i, each in enumerate(at) if f"{last}/".startswith(f"{each.path}/")]
    after = range(max(begun, default=0), len(points))
    present = next((i for i in after if str(at[i].number) not in ended), len(points))
    named = [
        i for i, (_, paths) in enumerate(points) if any(f"/{p}".endswith(f"/{step}") for p in paths)
    ]
    if len(named) == 1 and named[0] >= present:
        return tuple(each for each, _ in points[present : named[0]])
    plan, names = root.location.path, [each.path.partition("/")[2] for each in at[present:]]
    remaining = f"remaining steps: {', '.join(names) or 'none'}"
    if len(named) == 1:
        text = f"step {step[:64]} of {plan} has ended and is not repeated; {remaining}"
        return Refusal(Reason.PLAN_STATUS, text, argument=2)
    text = f"{len(named) or 'no'} steps of {plan} are named {step[:64]!r}; {remaining}"
    return Refusal(Reason.NO_SUCH_STEP, text, argument=2, subject=step[:64])
