"""`random_plan`: random plans of all controls, decorators, conditions, scripts and subtrees.

The leaves play scripts that their names contain, so that a plan behaves alike in any
implementation. A seed gives the same plan in each version of Python: of `random.Random` only
`random()` is used.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Final, TypeVar
from xml.sax.saxutils import quoteattr

T = TypeVar("T")

STEP_MS: Final = 125
"""Time between two ticks: a power of two of a second, so that sums of times are exact."""
TICKS: Final = 16
MAX_DEPTH: Final = 4
NUMBERS: Final = ("x", "y")
TEXT: Final = "s"
TEXTS: Final = ("'a'", "'b'", "'c'")
TELEMETRY: Final = ("BATERY_VOLTAGE", "LINK_SILENT_S", "LINK_UP")
_DURATIONS_MS: Final = (75, 125, 200, 250, 500, 875)
_PRECONDITIONS: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
_ALWAYS_SKIPPED: Final = {"_skipIf": "1 == 1", "_while": "0 == 1"}
_POSTCONDITIONS: Final = ("_onHalted", "_onFailure", "_onSuccess", "_post")


@dataclass(frozen=True, slots=True)
class RandomPlan:
    """A plan, and what happens while it is executed.

    Attributes:
        text: the XML of the plan.
        telemetry: values of each parameter by tick; the last one remains.
        abort: tick at which the plan is aborted, instead of a tick of its tree; -1 for none.
    """

    text: str
    telemetry: dict[str, list[float]]
    abort: int


class Draw:
    """Draws of a seed."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)

    def below(self, bound: int) -> int:
        """Return a whole number from 0, below the bound."""
        return int(self._random.random() * bound)

    def chance(self, probability: float) -> bool:
        """Return True with this probability."""
        return self._random.random() < probability

    def one(self, choices: Sequence[T]) -> T:
        """Return one of the choices."""
        return choices[self.below(len(choices))]


@dataclass(slots=True)
class _Trees:
    """The trees of a plan; each may call those that follow it."""

    draw: Draw
    bodies: list[str] = field(default_factory=list)
    models: list[str] = field(default_factory=list)
    leaves: int = 0


def random_plan(seed: int) -> RandomPlan:
    """Return the plan of a seed."""
    draw = Draw(seed)
    trees = _Trees(draw)
    callable_trees: list[str] = []
    for number in range(draw.below(3), 0, -1):
        body = _Tree(trees, tuple(callable_trees)).node(MAX_DEPTH - 2)
        callable_trees.append(f"T{number}")
        trees.bodies.append(f'<BehaviorTree ID="T{number}">{body}</BehaviorTree>')
        if draw.chance(0.3):
            trees.models.append(_model(f"T{number}", draw))
    body = _Tree(trees, tuple(callable_trees)).node(MAX_DEPTH)
    if draw.chance(0.5):
        body = f'<Repeat num_cycles="3"><ForceSuccess>{body}</ForceSuccess></Repeat>'
    start = f"x := {draw.one(_LITERALS)}; y := {draw.one(_LITERALS)}; s := {draw.one(TEXTS)}"
    last = '<takePicture name="last RS" deadline_s="1000"/>'
    main = f"<Sequence><Script code={quoteattr(start)}/>{body}{last}</Sequence>"
    models = f"<TreeNodesModel>{''.join(trees.models)}</TreeNodesModel>" if trees.models else ""
    text = plan_text(main, "".join(trees.bodies) + models)
    telemetry = {name: _series(draw) for name in TELEMETRY}
    return RandomPlan(text, telemetry, 1 + draw.below(TICKS - 1) if draw.chance(0.3) else -1)


def plan_text(main: str, more: str = "") -> str:
    """Return the text of a plan.

    Args:
        main: the root node of the main tree.
        more: other trees, and models.
    """
    return (
        '<root BTCPP_format="4" main_tree_to_execute="Main">'
        f'<BehaviorTree ID="Main">{main}</BehaviorTree>{more}</root>'
    )


def _series(draw: Draw) -> list[float]:
    values = [float(draw.below(4))]
    while len(values) < TICKS:
        values.append(float(draw.below(4)) if draw.chance(0.3) else values[-1])
    return values


def _model(tree: str, draw: Draw) -> str:
    ports = "".join(
        f'<input_port name="{name}" default={quoteattr(draw.one(_LITERALS))}/>' for name in NUMBERS
    )
    return f'<SubTree ID="{tree}">{ports}<input_port name="{TEXT}" default="b"/></SubTree>'


_LITERALS: Final = ("0.0", "0.5", "1.0", "1.5", "2.5", "-1.0")


class _Tree:
    """Draws the nodes of one tree."""

    def __init__(self, trees: _Trees, callable_trees: tuple[str, ...]) -> None:
        self._trees = trees
        self._draw = trees.draw
        self._callable = callable_trees
        self._limited = 0
        """How many Timeouts are above the node."""

    def node(self, depth: int) -> str:
        """Return a node with at maximum this many levels below it."""
        if depth == 0 or self._draw.chance(0.15):
            return self._draw.one(self._kinds_of_leaves())(depth)
        kinds = (self._control, self._control, self._decorator)
        return self._draw.one(kinds)(depth - 1)

    def _kinds_of_leaves(self) -> Sequence[Callable[[int], str]]:
        kinds = [self._command] * 8 + [self._condition] * 3 + [self._script] * 2
        kinds += [self._camera, self._script_condition, self._sleep, self._always, self._set]
        return kinds + [self._subtree] * (3 if self._callable else 0)

    # Leaves

    def _name(self, kind: str) -> str:
        self._trees.leaves += 1
        return f"{kind}{self._trees.leaves}"

    def _played(self) -> str:
        parts = []
        for _ in range(1 + self._draw.below(3)):
            running = "R" * self._draw.one((0, 1, 1, 1, 2, 3))
            parts.append(running + self._draw.one("SSSFFR"))
        return " ".join(parts)

    def _command(self, _: int) -> str:
        name = f"{self._name('a')} {self._played()}"
        return self._element("takePicture", {"name": name, "deadline_s": "1000"})

    def _camera(self, _: int) -> str:
        name = f"{self._name('m')} {self._played()}"
        pan = self._draw.one(("{x}", "{y}", "0.5", "{@x}"))
        ports = {"name": name, "pan": pan, "tilt": "0.25", "deadline_s": "1000"}
        return self._element("setCameraAngles", ports)

    def _condition(self, _: int) -> str:
        answers = "".join(self._draw.one("SF") for _ in range(1 + self._draw.below(5)))
        name = f"{self._name('c')} {answers}"
        return self._element("Near", {"name": name, "x": "0", "y": "0", "within": "1"})

    def _script(self, _: int) -> str:
        return self._element("Script", {"code": self._assignments()})

    def _script_condition(self, _: int) -> str:
        return self._element("ScriptCondition", {"code": self._premise()})

    def _sleep(self, _: int) -> str:
        return self._element("Sleep", {"msec": str(self._draw.one(_DURATIONS_MS))})

    def _always(self, _: int) -> str:
        return self._element(self._draw.one(("AlwaysSuccess", "AlwaysFailure")), {})

    def _set(self, _: int) -> str:
        value = self._draw.one(("a", "b", "c", "{s}"))
        return self._element("SetBlackboard", {"output_key": TEXT, "value": value})

    def _subtree(self, _: int) -> str:
        tree = self._draw.one(self._callable)
        how = self._draw.below(4)
        if how == 0:
            ports = {"_autoremap": "true"}
        elif how == 1 and f'<SubTree ID="{tree}">' in "".join(self._trees.models):
            ports = {}
        else:
            ports = {name: self._number_port() for name in NUMBERS}
            ports[TEXT] = self._draw.one(("{s}", "{=}", "a", "b"))
        if self._draw.chance(0.3):
            ports["name"] = self._name("t")
        return self._element("SubTree", {"ID": tree, **ports})

    def _number_port(self) -> str:
        return self._draw.one(("{x}", "{y}", "{=}", "0.5", "1.5"))

    # Controls

    def _control(self, depth: int) -> str:
        plain = ("Sequence", "Fallback", "AsyncSequence", "AsyncFallback", "SequenceWithMemory")
        reactive = ("ReactiveSequence", "ReactiveFallback")
        own: tuple[Callable[[int], str], ...] = (
            self._parallel,
            self._parallel_all,
            self._branches,
            self._switch,
            self._try_catch,
        )
        at = self._draw.below(12)
        if at < 7:
            kind = (*plain, *reactive)[at]
            return self._element(kind, {}, self._children(depth, 2, 3))
        return own[at - 7](depth)

    def _children(self, depth: int, minimum: int, maximum: int) -> list[str]:
        count = minimum + (self._draw.below(maximum - minimum + 1) if self._draw.chance(0.6) else 0)
        return [self.node(depth) for _ in range(count)]

    def _parallel(self, depth: int) -> str:
        children = self._children(depth, 2, 3)
        ports = {}
        if self._draw.chance(0.6):
            ports["success_count"] = self._draw.one(("-1", "1", "2", "-2"))
        if self._draw.chance(0.5):
            ports["failure_count"] = self._draw.one(("1", "2", "-1"))
        return self._element("Parallel", ports, children)

    def _parallel_all(self, depth: int) -> str:
        ports = {"max_failures": self._draw.one(("1", "2"))} if self._draw.chance(0.6) else {}
        return self._element("ParallelAll", ports, self._children(depth, 2, 3))

    def _branches(self, depth: int) -> str:
        kind = self._draw.one(("IfThenElse", "WhileDoElse"))
        condition = self._draw.one((self._condition, self._script_condition, self.node))(depth)
        return self._element(kind, {}, [condition, *self._children(depth, 1, 2)])

    def _switch(self, depth: int) -> str:
        cases = 2 + self._draw.below(2)
        ports = {f"case_{number + 1}": "abc"[number] for number in range(cases)}
        ports["variable"] = "{s}"
        children = [self.node(depth) for _ in range(cases + 1)]
        return self._element(f"Switch{cases}", ports, children)

    def _try_catch(self, depth: int) -> str:
        ports = {"catch_on_halt": "true"} if self._draw.chance(0.5) else {}
        return self._element("TryCatch", ports, self._children(depth, 2, 3))

    # Decorators

    def _decorator(self, depth: int) -> str:
        at = self._draw.below(12)
        if at < 4:
            kind = ("Inverter", "ForceSuccess", "ForceFailure", "RunOnce")[at]
            ports = {}
            if kind == "RunOnce" and self._draw.chance(0.5):
                ports["then_skip"] = self._draw.one(("true", "false"))
            return self._element(kind, ports, [self.node(depth)])
        if at == 4:
            ports = {"delay_msec": str(self._draw.one(_DURATIONS_MS))}
            return self._element("Delay", ports, [self.node(depth)])
        own = (self._loop, self._loop, self._loop, self._timeout, self._precondition)
        return (*own, self._queue, self._queue)[at - 5](depth)

    def _loop(self, depth: int) -> str:
        if not self._limited and depth and self._draw.chance(0.25):
            return self._timeout(depth, self._loop)
        kinds = ["Repeat", "RetryUntilSuccessful"]
        if self._limited:
            kinds.append("KeepRunningUntilFailure")
        kind = self._draw.one(kinds)
        counts = ("1", "2", "3", "-1", "-1") if self._limited else ("1", "2", "3")
        port = {"Repeat": "num_cycles", "RetryUntilSuccessful": "num_attempts"}.get(kind)
        ports = {} if port is None else {port: self._draw.one(counts)}
        return self._element(kind, ports, [self.node(depth)])

    def _timeout(self, depth: int, of: Callable[[int], str] | None = None) -> str:
        self._limited += 1
        child = self.node(depth) if of is None else of(depth - 1)
        self._limited -= 1
        return self._element("Timeout", {"msec": str(self._draw.one(_DURATIONS_MS))}, [child])

    def _precondition(self, depth: int) -> str:
        ports = {"if": self._premise()}
        if self._draw.chance(0.7):
            ports["else"] = self._draw.one(("SUCCESS", "FAILURE", "SKIPPED", "RUNNING"))
        return self._element("Precondition", ports, [self.node(depth)])

    def _queue(self, depth: int) -> str:
        if self._draw.chance(0.5):
            kind, ports = "LoopDouble", {"queue": "0.5;1.5;2.5", "value": "{x}"}
        else:
            kind, ports = "LoopString", {"queue": "a;b;c", "value": "{s}"}
        if self._draw.chance(0.5):
            ports["if_empty"] = self._draw.one(("SUCCESS", "FAILURE", "SKIPPED"))
        return self._element(kind, ports, [self.node(depth)])

    # Scripts

    def _element(self, kind: str, ports: dict[str, str], children: Sequence[str] = ()) -> str:
        attributes = dict(ports)
        if self._draw.chance(0.16):
            name = self._draw.one(_PRECONDITIONS)
            always = _ALWAYS_SKIPPED.get(name) if self._draw.chance(0.4) else None
            attributes[name] = always or self._premise()
        if self._draw.chance(0.16):
            attributes[self._draw.one(_POSTCONDITIONS)] = self._assignments()
        written = "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items())
        if not children:
            return f"<{kind}{written}/>"
        return f"<{kind}{written}>{''.join(children)}</{kind}>"

    def _assignments(self) -> str:
        count = 2 if self._draw.chance(0.25) else 1
        return "; ".join(self._assignment() for _ in range(count))

    def _assignment(self) -> str:
        if self._draw.chance(0.3):
            target = self._draw.one((TEXT, TEXT, f"@{TEXT}"))
            operator = self._draw.one((":=", "="))
            return f"{target} {operator} {self._text(1)}"
        target = self._draw.one((*NUMBERS, *NUMBERS, "@x"))
        operator = self._draw.one((":=", "=", "=", "+=", "-=", "*=", "/="))
        value = self._draw.one(("0.5", "2.0")) if operator in "*=/=" else self._number(2)
        return f"{target} {operator} {value}"

    def _number(self, depth: int) -> str:
        kind = self._draw.below(8) if depth else self._draw.below(4)
        match kind:
            case 0 | 1:
                return self._draw.one(_LITERALS)
            case 2 | 3:
                return self._draw.one((*NUMBERS, *NUMBERS, "@x", f"@{self._draw.one(TELEMETRY)}"))
            case 4:
                condition = self._premise(1)
                return f"({condition} ? {self._number(depth - 1)} : {self._number(depth - 1)})"
            case 5:
                return f"-({self._number(depth - 1)})"
            case _:
                operator = self._draw.one("++-*")
                return f"({self._number(depth - 1)} {operator} {self._number(depth - 1)})"

    def _text(self, depth: int) -> str:
        if depth and self._draw.chance(0.2):
            return f"{self._premise(1)} ? {self._text(0)} : {self._text(0)}"
        if self._draw.chance(0.1):
            return f"{TEXT} {self._draw.one(('..', '+'))} {self._draw.one(TEXTS)}"
        return self._draw.one((*TEXTS, *TEXTS, TEXT))

    def _premise(self, depth: int = 2) -> str:
        """Return a condition: true or false, never another number."""
        kind = self._draw.below(10) if depth else self._draw.below(7)
        match kind:
            case 0:
                return f"{TEXT} {self._draw.one(('==', '!=', '<'))} {self._draw.one(TEXTS)}"
            case 1:
                return f"{self._draw.one(_LITERALS)} < {self._number(0)} <= 2"
            case 2:
                bits = self._draw.one("|&^")
                return f"({self._draw.below(4)} {bits} {self._draw.below(4)}) == 1"
            case 7 | 8:
                joined = self._draw.one(("&&", "||"))
                return f"({self._premise(depth - 1)}) {joined} ({self._premise(depth - 1)})"
            case 9:
                return f"!({self._premise(depth - 1)})"
            case _:
                operator = self._draw.one(("<", ">", "<=", ">=", "==", "!="))
                return f"{self._number(1)} {operator} {self._number(0)}"
