"""`node_reports`: the nodes of a plan as operators see them, from its state alone.

So the table of a plan is the same while it runs, while it is suspended, after a restart, and after
its end.
"""

from collections.abc import Mapping
from typing import Final

from executive.commands.intake import source_of
from executive.plans.model import PlanNode, PlanRoot, nodes, parts_of
from executive.plans.node_records import NodeDetail, NodeRecord, read_records
from executive.plans.state import PlanState
from executive.values.plan_nodes import NodeStatus, PlanNodeReport, Question
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import Identity

_STATUSES: Final[Mapping[str, NodeStatus]] = {each.name[0]: each for each in NodeStatus}
_REASONS: Final = {each.value: each for each in Reason}
_PENDING: Final = {
    "SUCCESS": "is to be skipped with SUCCESS",
    "FAILURE": "is to be skipped with FAILURE",
    "RETRY": "is to begin again",
    "HOLD": "the plan is suspended before it begins",
}
"""Steering that a node has not obeyed yet."""
_ABSOLUTE: Final = {"WaitUntil", "WaitFor", "Window", "Ask"}
"""Nodes with times that continue while the plan is suspended."""


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


def _reason(number: int) -> Reason | UnknownReason | None:
    """Return a stored reason; another version may have stored it."""
    return (_REASONS.get(number) or UnknownReason(number)) if number else None


def node_reports(
    plan_id: str, root: PlanRoot, state: PlanState, *, executes: bool
) -> tuple[PlanNodeReport, ...]:
    """Return all nodes of a plan in a state, in the order of its text.

    Args:
        plan_id: its id.
        root: its root node.
        state: its state.
        executes: whether it executes: otherwise its timers are stopped.
    """
    letters = "" if state.tree is None else state.tree.statuses
    last, answers, forced = dict(state.last), dict(state.answers), dict(state.forced)
    records, details = read_records(state.records)
    found = []
    for node in nodes(root):
        at, number = node.location, node.location.number
        record = records.get(number, NodeRecord(number))
        detail = details.get(number, NodeDetail(number))
        continues = executes or node.kind.name in _ABSOLUTE
        next_utc_s = detail.next_utc_s if continues and letters[number:][:1] == "R" else None
        is_open = at.path in state.questions and at.path not in answers
        pending = _PENDING.get(forced.get(number, ""), "")
        if at.path in answers:
            pending = f"answered {answers[at.path]} in advance"
        found.append(
            PlanNodeReport(
                at.path,
                node.kind.name,
                at.line,
                _STATUSES[letters[number]] if letters else NodeStatus.IDLE,
                _STATUSES[record.result] if record.result else None,
                record.since_utc_s or None,
                record.tries,
                _reason(record.reason),
                record.text,
                detail.unknown,
                pending or record.decision,
                next_utc_s,
                question_of(node, next_utc_s) if is_open else None,
                Identity(source_of(plan_id), last[number]) if number in last else None,
            )
        )
    return tuple(found)
