"""Converts the nodes of plans to the wire and back."""

from typing import Final

from adapters.mrs.spec import types
from adapters.mrs.spec.core_values import reason_of, utc_s_of
from adapters.mrs.spec.mapping import to_ns
from executive.commands.intake import source_of
from executive.values.plan_nodes import PlanNodeReport, Question
from executive.values.reports import Identity

LAST_UTC_S: Final = 5e9
"""Latest time of a report, in 2128: a plan may wait until any time, a MAL time ends in 2137."""


def wire_node(node: PlanNodeReport) -> types.PlanNode:
    """Return a node of a plan for the wire."""
    return types.PlanNode(
        path=node.path,
        kind=node.kind,
        line=node.line,
        status=node.status,
        result=node.result,
        timestamp=_ns(node.since_utc_s),
        tries=node.tries,
        code=None if node.reason is None else node.reason.value,
        text=node.text or None,
        unknown=node.unknown or None,
        decision=node.decision or None,
        next=_ns(node.next_utc_s),
        question=None if node.question is None else _question(node.question),
        commandId=None if node.command is None else node.command.command_id,
    )


def plan_node_of(plan_id: str, node: types.PlanNode) -> PlanNodeReport:
    """Return a node of a plan."""
    question, number = node.question, node.commandId
    return PlanNodeReport(
        node.path,
        node.kind,
        node.line,
        node.status,
        node.result,
        _utc_s(node.timestamp),
        node.tries,
        None if node.code is None else reason_of(node.code),
        node.text or "",
        node.unknown or "",
        node.decision or "",
        _utc_s(node.next),
        None if question is None else _question_of(question),
        None if number is None else Identity(source_of(plan_id), number),
    )


def _question_of(sent: types.PlanQuestion) -> Question:
    until_utc_s = _utc_s(sent.until)
    return Question(sent.key, sent.text, sent.options, sent.default, until_utc_s)


def _question(question: Question) -> types.PlanQuestion:
    return types.PlanQuestion(
        key=question.key,
        text=question.text,
        options=question.options,
        default=question.default,
        until=_ns(question.until_utc_s),
    )


def _ns(utc_s: float | None) -> int | None:
    return None if utc_s is None else to_ns(min(max(utc_s, 0.0), LAST_UTC_S))


def _utc_s(time_ns: int | None) -> float | None:
    return None if time_ns is None else utc_s_of(time_ns)
