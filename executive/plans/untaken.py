"""Why nodes that people know from BehaviorTree.CPP are not taken, and what a wrong word is near."""

from collections.abc import Iterable
from itertools import islice
from typing import Final

_LONGEST: Final = 40
"""Characters of a wrong word that are looked at and told."""
_MOST: Final = 200
"""Words that a wrong one is held against: looking for more would keep a stop waiting."""

_REACTIVE: Final = "nodes that begin anew each time are not taken: use Sequence, Fallback, Timeout"
_ENDLESS: Final = "every plan ends: use Repeat or RetryUntilSuccessful"
_BLACKBOARD: Final = "scripts and a blackboard are not taken: give values by {name} and --arg"
_CONDITION: Final = "conditions are not taken: a leaf that fails makes a Fallback go on"
_RESULT: Final = "a result that nothing was done for is not taken: use Fallback or Inverter"
_SHAPE: Final = "use Sequence, Fallback or Parallel"
_WAIT: Final = "nothing waits alone: a leaf that takes long is limited by deadline_s or Timeout"

WHY: Final = {
    "stop": "a plan does not stop the rover: who does takes it from the plan",
    "resume": "a plan does not resume the rover: after a stop mission control does",
    "ReactiveSequence": _REACTIVE,
    "ReactiveFallback": _REACTIVE,
    "SequenceWithMemory": _SHAPE,
    "SequenceStar": _SHAPE,
    "AsyncSequence": _SHAPE,
    "AsyncFallback": _SHAPE,
    "ParallelAll": _SHAPE,
    "IfThenElse": _CONDITION,
    "WhileDoElse": _CONDITION,
    "Switch2": _CONDITION,
    "Switch3": _CONDITION,
    "Condition": _CONDITION,
    "Precondition": _CONDITION,
    "KeepRunningUntilFailure": _ENDLESS,
    "ForceSuccess": _RESULT,
    "ForceFailure": _RESULT,
    "AlwaysSuccess": _RESULT,
    "AlwaysFailure": _RESULT,
    "Delay": _WAIT,
    "Sleep": _WAIT,
    "Script": _BLACKBOARD,
    "ScriptCondition": _BLACKBOARD,
    "SetBlackboard": _BLACKBOARD,
    "UnsetBlackboard": _BLACKBOARD,
}


def told(word: str) -> str:
    """Return a wrong word as it may stand in a text."""
    return repr(word[:_LONGEST])


def perhaps(word: str, known: Iterable[str]) -> str:
    """Return what to append to a text about a wrong word: what it is near, if anything."""
    from difflib import get_close_matches

    short = [each for each in islice(known, _MOST) if len(each) <= 2 * _LONGEST]
    near = get_close_matches(word[:_LONGEST], short, 1)
    return f": {near[0]} perhaps" if near else ""
