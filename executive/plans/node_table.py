"""`node_reports`: the nodes of a plan as operators see them, from its state alone.

So the table of a plan is the same while it runs, while it is suspended, after a restart, and after
its end.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from executive.commands.intake import source_of
from executive.plans.model import PlanNode, PlanRoot, nodes, parts_of
from executive.plans.state import PlanState
from executive.values.plan_nodes import NodeStatus, PlanNodeReport, Question
from executive.values.reports import Identity

_STATUSES: Final[Mapping[str, NodeStatus]] = {each.name[0]: each for each in NodeStatus}


def question_of(node: PlanNode, until_utc_s: float | None) -> Question:
    """Return the question of a node with its deadline, seconds since 1970-01-01 UTC."""
    default = node.ports.get("default")
    return Question(
        node.location.path,
        node.text("question"),
        parts_of(node.text("options")),
        default if isinstance(default, str) else None,
        until_utc_s,
    )


def node_reports(plan_id: str, root: PlanRoot, state: PlanState) -> tuple[PlanNodeReport, ...]:
    """Return all nodes of a plan in a state, in the order of its text."""
    last = dict(state.last)
    letters = "" if state.tree is None else state.tree.statuses
    found = []
    for node in nodes(root):
        at = node.location
        report = PlanNodeReport(at.path, node.kind.name, at.line)
        if letters:
            report = replace(report, status=_STATUSES[letters[at.number]])
        if at.number in last:
            report = replace(report, command=Identity(source_of(plan_id), last[at.number]))
        if at.path in state.questions:
            report = replace(report, question=question_of(node, None))
        found.append(report)
    return tuple(found)
