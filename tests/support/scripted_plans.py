"""`play`: runs a plan whose leaves play the scripts in their names, and returns its trace."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from unittest.mock import patch

from executive.commands import PlanDefinition, Request, SetCameraAngles
from executive.plans import (
    CommandOutcome,
    PlanNode,
    PlanRoot,
    PlanStep,
    Steering,
    Value,
    nodes,
    read_plan,
)
from executive.plans.state import PlanState, decode, encode
from executive.values.clock import Clock, ManualClock
from executive.values.plan_nodes import Question
from executive.values.reasons import Refusal
from tests.support.behaviortree_cpp.traces import CellChange, Trace, TracedTick
from tests.support.random_plans import STEP_MS, TELEMETRY, TICKS, RandomPlan
from trees.plan import FAILURE, SUCCESS, Answer, PlanBehaviour, PlanLeaf, PlanTree
from trees.plan import tree as tree_module


@dataclass(slots=True)
class _Playing:
    """A command under way: its word, and the letter that it plays next."""

    word: str
    at: int = 0


class ScriptedPort:
    """The executive's side of a plan: commands play their scripts. See `PlanPort`.

    Attributes:
        events: starts and halts of commands in this tick, as in a `TracedTick`.
    """

    def __init__(self) -> None:
        self.manual_clock = ManualClock()
        self.clock: Clock = self.manual_clock
        self.why = ""
        self.records = None
        self.values: dict[str, float] = {}
        self.events: list[tuple[str | float, ...]] = []
        self.queries: dict[int, int] = {}
        self._starts: dict[int, int] = {}
        self._playing: dict[int, _Playing] = {}

    def telemetry(self, name: str) -> Value | None:
        """Return a value."""
        return self.values.get(name)

    def check_target(self, _x_m: float, _y_m: float) -> Refusal | None:
        """Accept each target."""
        return None

    def fault_active(self, _name: str) -> bool:
        """Return False."""
        return False

    def request(self, step: PlanStep, _cycles: tuple[int, ...], cells: list[Value | None]) -> None:
        """Start the next word of a script, unless one is under way."""
        number = step.location.number
        if number not in self._playing:
            parts = script_of(step)
            start = self._starts.get(number, 0)
            self._starts[number] = start + 1
            self._playing[number] = _Playing(parts[start % len(parts)])
            request = step.request_from(cells)
            self.events.append(("+", number - 1, *_angles(request)))

    def poll(self, step: PlanStep) -> CommandOutcome | None:
        """Play the next letter; the last one repeats."""
        playing = self._playing[step.location.number]
        letter = playing.word[min(playing.at, len(playing.word) - 1)]
        playing.at += 1
        if letter == "R":
            return None
        del self._playing[step.location.number]
        return CommandOutcome(letter == "S")

    def halt_step(self, step: PlanStep) -> None:
        """Note the halt."""
        del self._playing[step.location.number]
        self.events.append(("-", step.location.number - 1))

    def fail_overdue(self, step: PlanStep, allowed_s: float) -> CommandOutcome:
        """Raise: no deadline is due."""
        raise AssertionError(f"{step.location.path} after {allowed_s} s")

    def command_text(self, _step: PlanStep) -> str:
        """Return nothing."""
        return ""

    def has_expired(self, _node: PlanNode, _cycles: tuple[int, ...]) -> bool:
        """Return False: there is no journal."""
        return False

    def take_answer(self, question: Question) -> str | None:
        """Raise: there is no question."""
        raise AssertionError(question)

    def withdraw(self, question: Question, answer: str = "") -> None:
        """Raise: there is no question."""
        raise AssertionError(question)

    def note_failure(self, _node: PlanNode, _text: str, unknown: int | None = None) -> None:
        """Do nothing."""

    def on_forced(self, node: PlanNode, steering: Steering) -> None:
        """Raise: no node is forced."""
        raise AssertionError(node.location.path)


def _angles(request: Request) -> tuple[float, ...]:
    if not isinstance(request, SetCameraAngles):
        return ()
    assert request.pan_rad is not None
    assert request.tilt_rad is not None
    return request.pan_rad, request.tilt_rad


def script_of(node: PlanNode) -> list[str]:
    """Return the parts of the script in the name of a leaf."""
    return node.location.name.split()[1:]


class ScriptedCondition(PlanLeaf):
    """`Near`, whose answers are the letters of its script."""

    def run(self) -> Answer:
        """Play the next letter."""
        port = self.context.port
        assert isinstance(port, ScriptedPort)
        count = port.queries.get(self.number, 0)
        port.queries[self.number] = count + 1
        word = script_of(self.plan)[0]
        return SUCCESS if word[count % len(word)] == "S" else FAILURE


def read(plan: RandomPlan) -> PlanRoot | Refusal:
    """Read a plan."""
    return read_plan(PlanDefinition("random", "A random plan", "BTCPP4", plan.text.encode(), ()))


Classes = Mapping[str, type[PlanBehaviour]]


def play(
    plan: RandomPlan, root: PlanRoot, stored: bool = False, classes: Classes | None = None
) -> Trace:
    """Return the trace of a plan.

    Args:
        stored: whether the tree is built again before each tick, and its state written and read.
        classes: classes of nodes to use instead of the product's.
    """
    used: Classes = {"Near": ScriptedCondition, **(classes or {})}
    # The reference has no bound of nodes in a tick: it repeats the tick 50 times.
    with patch.object(tree_module, "MAX_EXECUTED_NODES", 1_000_000, create=True):
        return tuple(_ticks(plan, root, stored, used))


def _ticks(
    plan: RandomPlan, root: PlanRoot, stored: bool, classes: Classes
) -> Iterator[TracedTick]:
    port, tree = ScriptedPort(), None
    label_of = _labels(root)
    known: dict[int, Value] = {}
    for tick in range(TICKS):
        port.manual_clock.set(tick * STEP_MS / 1000)
        port.values = {
            name: values[min(tick, len(values) - 1)] for name, values in plan.telemetry.items()
        }
        port.events.clear()
        if tree is None or stored:
            tree = _rebuilt(root, port, classes, tree)
        if tick == plan.abort:
            tree.halt()
            result = "H"
        else:
            name = tree.tick().name
            result = "K" if name == "SKIPPED" else name[0]
        statuses = tree.state().statuses[1:]
        yield TracedTick(result, statuses, _changes(tree, known, label_of), tuple(port.events))
        if result != "R":
            return


def _rebuilt(
    root: PlanRoot, port: ScriptedPort, classes: Classes, before: PlanTree | None
) -> PlanTree:
    """Return a new tree, in the state of the one before as it was written and read."""
    tree = PlanTree(root, port, classes)
    if before is not None:
        state = decode(encode(PlanState(before.state()))).tree
        assert state is not None
        tree.load(state)
    return tree


def _labels(root: PlanRoot) -> dict[int, tuple[int, str]]:
    """Return the number of the subtree and the name of each cell, without telemetry."""
    subtrees = [each for each in nodes(root) if each.kind.name == "SubTree"]
    paths = [each.location.path.partition("/")[2] for each in subtrees]
    found = {}
    for cell, name in enumerate(root.blackboard.names):
        path, _, own = name.rpartition("/")
        if name not in TELEMETRY:
            found[cell] = paths.index(path), own
    return found


def _changes(
    tree: PlanTree, known: dict[int, Value], label_of: Mapping[int, tuple[int, str]]
) -> tuple[CellChange, ...]:
    """Return the cells that have changed, and note their values."""
    changed = []
    for cell, label in label_of.items():
        value = tree.cells[cell]
        if value is not None and (cell not in known or known[cell] != value):
            known[cell] = value
            changed.append((*label, value))
    return tuple(sorted(changed))
