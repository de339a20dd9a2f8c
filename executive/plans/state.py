"""The state of a running plan as one small value, and as the text that is stored.

All that a tick changes is here: statuses, memories and timers of the nodes, the blackboard, the
running commands. Timers are times on the executive's clock; as text they are the times left.
The text ends with a checksum: a damaged state would otherwise repeat or omit steps.
"""

import json
from binascii import crc32
from typing import Any, Final, NamedTuple

from executive.plans.syntax import Value

MAX_STATE_LENGTH: Final = 256 * 1024
"""Maximum length in characters of the text of a state; chosen."""


class StateError(Exception):
    """A state does not belong to the plan."""


class TreeState(NamedTuple):
    """State of a plan's tree.

    Attributes:
        statuses: a letter for each node: I, R, S or F.
        memory: further attributes of the nodes, in their order.
        timers: ends of timers on the executive's clock; None for those not running.
        cells: the blackboard without telemetry.
    """

    statuses: str
    memory: tuple[Any, ...]
    timers: tuple[float | None, ...]
    cells: tuple[Value | None, ...]


class StateCommand(NamedTuple):
    """A command of a node.

    Attributes:
        stage: number of its terminal stage; 0 while it is active.
        reason: number of its refusal; 0 without one.
    """

    node: int
    command_id: int
    stage: int = 0
    reason: int = 0


class PlanState(NamedTuple):
    """State of a plan.

    Attributes:
        tree: None before its first tick.
        commands: commands that the nodes have not seen to end.
        last: number of each node that gave a command, and of its last one.
        ended: numbers of the nodes that ended at least once, or were skipped.
        forced: numbers of nodes, and the name of the `Steering` that each obeys at its next tick.
        answers: keys of questions with their answers that no node has taken yet.
        questions: keys of the open questions.
        charge_ratio: charge of the battery when the plan began; None if it was not known.
        restarts: how often it has continued by itself after a restart.
        position: x and y of the rover when it was stored, m; None if they were not known.
        settled: keys of the questions that have ended, and their answers; empty for none.
        records: records of the nodes as text; see `node_records`.
    """

    tree: TreeState | None = None
    commands: tuple[StateCommand, ...] = ()
    last: tuple[tuple[int, int], ...] = ()
    ended: tuple[int, ...] = ()
    forced: tuple[tuple[int, str], ...] = ()
    answers: tuple[tuple[str, str], ...] = ()
    questions: tuple[str, ...] = ()
    charge_ratio: float | None = None
    restarts: int = 0
    position: tuple[float, float] | None = None
    settled: tuple[tuple[str, str], ...] = ()
    records: str = ""

    def at_end(self) -> "PlanState":
        """Return the part that is stored after the end of the plan."""
        statuses = "" if self.tree is None else self.tree.statuses.replace("R", "I")
        tree = None if self.tree is None else TreeState(statuses, (), (), ())
        return PlanState(tree, last=self.last, settled=self.settled, records=self.records)


def shifted(state: PlanState, by_s: float) -> PlanState:
    """Return a state with its timers shifted by seconds."""
    if state.tree is None:
        return state
    timers = tuple(None if each is None else each + by_s for each in state.tree.timers)
    return state._replace(tree=state.tree._replace(timers=timers))


def encode(state: PlanState) -> str:
    """Return a state as text, a JSON array with its checksum at the end."""
    fields = json.dumps(state, separators=(",", ":"))
    return f"{fields[:-1]},{crc32(fields.encode())}]"


def decode(text: str) -> PlanState:
    """Return the state of a text.

    Raises:
        StateError: the text is no state, or damaged.
    """
    try:
        head, _, checksum = text.rpartition(",")
        fields = f"{head}]"
        if checksum != f"{crc32(fields.encode())}]":
            raise StateError("the stored state is damaged")
        state = PlanState(*_frozen(json.loads(fields)))
        tree = None if state.tree is None else TreeState(*state.tree)
        commands = tuple(StateCommand(*each) for each in state.commands)
    except (ValueError, TypeError, AttributeError) as error:
        raise StateError("the stored state cannot be read") from error
    return state._replace(tree=tree, commands=commands)


def _frozen(found: Any) -> Any:
    return tuple(map(_frozen, found)) if isinstance(found, list) else found
