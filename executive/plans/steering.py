"""Requests that steer a plan: skip, retry, hold at a node, answer a question.

They change the plan's state only: a node finds its steering there at its next tick, so that
nothing is lost after the state was stored.
"""

from typing import Final

from executive.commands import AnswerQuestion, HoldAtNode, PlanSteering, RetryNode, SkipNode
from executive.plans.execution import Steering
from executive.plans.model import PlanNode, PlanRoot, nodes, parts_of
from executive.plans.state import MAX_STATE_LENGTH, PlanState, encode
from executive.values.reasons import Figure, Reason, Refusal

MAX_NAMED: Final = 10
"""Maximum number of nodes that a report names."""
MAX_STEERED_LENGTH: Final = MAX_STATE_LENGTH - 8192
"""Maximum length in characters of the state with a request: the plan itself may need the rest."""


def check_steering(request: PlanSteering, root: PlanRoot, state: PlanState) -> PlanNode | Refusal:
    """Return the node that a request names, or why it cannot be steered so in its state."""
    node = _check_node(request, root, state)
    if isinstance(node, Refusal):
        return node
    changed, _ = steered(request, node, state)
    length = len(encode(changed._replace(records="")))
    if length <= MAX_STEERED_LENGTH:
        return node
    text = f"the state of the plan is too large for requests: {length} characters"
    bound = Figure("bound", MAX_STEERED_LENGTH)
    return Refusal(Reason.PLAN_TOO_LARGE, f"{text}, {MAX_STEERED_LENGTH} at most", (bound,))


def _check_node(request: PlanSteering, root: PlanRoot, state: PlanState) -> PlanNode | Refusal:
    """Return the node that a request names, or why it cannot obey in its state."""
    if isinstance(request, AnswerQuestion):
        node = _find(root, request.question, Reason.NO_SUCH_QUESTION, "Ask")
        return node if isinstance(node, Refusal) else _check_answer(node, request.option, state)
    node = _find(root, request.node, Reason.NO_SUCH_STEP)
    if isinstance(node, Refusal):
        return node
    letter = "I" if state.tree is None else state.tree.statuses[node.location.number]
    match request, letter:
        case SkipNode(_, _, result), _ if result not in {"SUCCESS", "FAILURE"}:
            text = f"result {result[:64]!r} is neither SUCCESS nor FAILURE"
            return Refusal(Reason.OUT_OF_RANGE, text, argument=3)
        case SkipNode(), "S" | "F":
            return _status(node, "has ended: there is nothing to skip")
        case RetryNode(), "I" | "S" | "F":
            return _status(node, "is not running: only what runs is begun again")
        case HoldAtNode(), "R":
            return _status(node, "runs already: suspend the plan")
        case _:
            return node


def steered(request: PlanSteering, node: PlanNode, state: PlanState) -> tuple[PlanState, str]:
    """Return the state after a request on a node that was checked, and the text of the report."""
    key = node.location.path
    match request:
        case SkipNode(_, _, result):
            steering, text = Steering[result], f"skipped with {result}"
        case RetryNode():
            steering, text = Steering.RETRY, "begins again"
        case HoldAtNode():
            steering, text = Steering.HOLD, "the plan is suspended before it begins"
        case AnswerQuestion(_, _, option):
            if key not in state.questions and key in dict(state.settled):
                return state, f"was answered before: {option}"
            answers = {**dict(state.answers), key: option}
            return state._replace(answers=tuple(answers.items())), f"answered: {option}"
    forced = {**dict(state.forced), node.location.number: steering.name}
    return state._replace(forced=tuple(forced.items())), text


def _check_answer(node: PlanNode, option: str, state: PlanState) -> PlanNode | Refusal:
    """Return why a question takes no such answer; the same answer again is accepted."""
    key, options = node.location.path, parts_of(node.text("options"))
    if option not in options:
        text = f"{key}: {option[:64]!r} is no option: {' or '.join(options)}"
        return Refusal(Reason.NO_SUCH_OPTION, text, argument=3)
    given = dict(state.answers).get(key)
    if given is None and key not in state.questions:
        given = dict(state.settled).get(key)
    if given is None or given == option:
        return node
    how = f"was answered: {given}" if given else "ended without an answer"
    return Refusal(Reason.QUESTION_ANSWERED, f"{key} {how}")


def _status(node: PlanNode, text: str) -> Refusal:
    return Refusal(Reason.PLAN_STATUS, f"{node.location.path} {text}")


def _find(root: PlanRoot, name: str, reason: Reason, kind: str | None = None) -> PlanNode | Refusal:
    candidates = [each for each in nodes(root) if kind in {None, each.kind.name}]
    found = [each for each in candidates if f"/{each.location.path}".endswith(f"/{name}")]
    if len(found) == 1:
        return found[0]
    known = [each.location.path for each in found or candidates]
    shown = ", ".join(path.partition("/")[2] or path for path in known[:MAX_NAMED])
    what = "nodes" if kind is None else "questions"
    text = f"{len(found) or 'no'} {what} of {root.location.path} are named {name[:64]!r}"
    return Refusal(reason, f"{text}; {what}: {shown or 'none'}", argument=2, subject=name[:64])
