"""Explains plans: the branches above a command, the present decisions, a node's progress."""

from collections.abc import Iterator, Sequence
from typing import Final

from adapters.explanation.explanation import Explanation, ExplanationStep, UnknownCommandError
from executive.commands.intake import SOURCE_PREFIX
from executive.history import CommandHistory, LeafRun, RunHistory
from executive.values.plan_nodes import DECISIONS, NodeStatus, PlanNodeReport

MAX_NAMED: Final = 5
"""Maximum number of nodes that an error names."""


def branch_steps(history: RunHistory, command: CommandHistory) -> Iterator[ExplanationStep]:
    """Yield the decisions above a command, and the node of a plan that gave it."""
    given = next((each for each in history.leaves if each.message == str(command.identity)), None)
    if given is None:
        return
    path = f"{given.path}/"
    for each in history.leaves:
        began = each.began_utc_s <= given.began_utc_s
        in_force = began and (each.ended_utc_s is None or each.ended_utc_s >= given.began_utc_s)
        if in_force and is_decision(each) and path.startswith(f"{each.path}/"):
            yield decision_step(each)
    yield ExplanationStep(command.utc_s, f"given by {short_path(given.path)} of its plan")


def present_decisions(history: RunHistory) -> list[ExplanationStep]:
    """Return the decisions of plans that are in force at the end of a history."""
    found = (each for each in history.leaves if each.ended_utc_s is None and is_decision(each))
    return list(map(decision_step, found))


def is_decision(run: LeafRun) -> bool:
    """Return whether an entry is a decision of a plan's node."""
    return run.path.startswith(SOURCE_PREFIX) and run.message.startswith(DECISIONS)


def decision_step(run: LeafRun) -> ExplanationStep:
    """Return a decision as a step of an explanation."""
    return ExplanationStep(run.began_utc_s, f"{short_path(run.path)} {run.message}")


def short_path(path: str) -> str:
    """Return a path without the name of the plan."""
    return path.partition("/")[2] or path


def matches_node(name: str, path: str) -> bool:
    """Return whether a text is the path of a plan's node, or the end of it."""
    return path.startswith(SOURCE_PREFIX) and f"/{path}".endswith(f"/{name}")


def explain_recorded_node(history: RunHistory, name: str) -> Explanation | None:
    """Explain a node of a plan, by its path or the end of it; None if it is unknown.

    Only nodes that gave commands or took decisions are known.
    """
    found = [each for each in history.leaves if matches_node(name, each.path)]
    if not found:
        return None
    steps = [
        decision_step(each)
        if is_decision(each)
        else ExplanationStep(each.began_utc_s, f"{short_path(each.path)} gave {each.message}")
        for each in found
    ]
    return Explanation(steps[-1].text, None, tuple(steps))


def explain_node(nodes: Sequence[PlanNodeReport], name: str) -> Explanation | None:
    """Return the progress of a node of a plan and of those above it; None if it is unknown.

    Args:
        nodes: all nodes of the plan.
        name: the path of the node, or the end of it.

    Raises:
        UnknownCommandError: several nodes match.
    """
    found = [each for each in nodes if matches_node(name, each.path)]
    if not found:
        return None
    node, *others = found
    if others:
        known = ", ".join(each.path for each in found[:MAX_NAMED])
        raise UnknownCommandError(f"{len(found)} nodes end with {name[:64]!r}: name one of {known}")
    above = (each for each in nodes if f"{node.path}/".startswith(f"{each.path}/"))
    steps = [
        ExplanationStep(each.since_utc_s, f"{short_path(each.path)} {each.decision}")
        for each in above
        if each.decision
    ]
    if node.text:
        path, _, text = node.text.partition(": ")
        steps.append(ExplanationStep(node.since_utc_s, f"last failure: {short_path(path)}: {text}"))
    if node.unknown:
        steps.append(ExplanationStep(None, f"{node.unknown} is not known"))
    if node.question is not None:
        options = " or ".join(node.question.options)
        steps.append(ExplanationStep(None, f"open question: {node.question.text} ({options})"))
    if node.next_utc_s is not None:
        steps.append(ExplanationStep(node.next_utc_s, "next time: end of its wait or deadline"))
    if node.command is not None:
        steps.append(ExplanationStep(None, f"its last command is {node.command}"))
    return Explanation(_node_headline(node), node.reason, tuple(steps))


def _node_headline(node: PlanNodeReport) -> str:
    name, tries = short_path(node.path), f", begun {node.tries} times" if node.tries > 1 else ""
    if node.status is NodeStatus.IDLE:
        ended = "has not ended" if node.result is None else f"ended last with {node.result.name}"
        begun = ended if node.tries else "has not begun"
        return f"{name} {begun}{tries}"
    return f"{name} is {node.status.name}{tries}"
