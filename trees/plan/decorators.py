"""The nodes of a plan with one child: loops, limits of time, forced results, conditions."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Final

from executive.plans import LOOPS, MAX_READ_PARTS, ArgumentError, PlanNode, part_values, parts_of
from trees.plan.node import (
    ANSWERS,
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Answer,
    PlanBehaviour,
    PlanRun,
    time_text,
)


class PlanDecorator(PlanBehaviour):
    """A node with one child, which is IDLE again after it has ended."""

    def execute(self) -> Answer:
        """Tick the node; see `PlanBehaviour.execute`."""
        answer = super().execute()
        child = self.nodes[0]
        if child.status is SUCCESS or child.status is FAILURE:
            child.status = IDLE
        return answer

    def answer_as(self, port: str, why: str) -> Answer:
        """Return the result that a port declares; a failure has a reason."""
        answer = ANSWERS[self.plan.text(port)]
        if answer is FAILURE:
            self.context.port.note_failure(self.plan, why)
        return answer


class SubTree(PlanDecorator):
    """`SubTree`, and the root of a plan: runs a tree with variables of its own."""

    def run(self) -> Answer:
        """Tick the tree."""
        if self.status is IDLE:
            self.status = RUNNING
        return self.nodes[0].execute()


_RESULTS: Final[Mapping[str, Mapping[Answer, Answer]]] = {
    "Inverter": {SUCCESS: FAILURE, FAILURE: SUCCESS},
    "ForceSuccess": {FAILURE: SUCCESS},
    "ForceFailure": {SUCCESS: FAILURE},
    "KeepRunningUntilFailure": {SUCCESS: RUNNING, SKIPPED: RUNNING},
}
"""Results by the answer of the child, where they differ."""


class MappedResult(PlanDecorator):
    """Gives another result than its child: `Inverter`, `ForceSuccess`, `ForceFailure`.

    `KeepRunningUntilFailure` begins its child again in the next tick.
    """

    def run(self) -> Answer:
        """Tick the child, and map its result."""
        self.status = RUNNING
        answer = self.nodes[0].execute()
        result = _RESULTS[self.plan.kind.name].get(answer, answer)
        if result is FAILURE and answer is SUCCESS:
            self.context.port.note_failure(self.plan, f"{self.nodes[0].name} succeeded")
        return result


class LoopDecorator(PlanDecorator):
    """`Repeat`, `RetryUntilSuccessful`: yield between cycles that end at once.

    Attributes:
        count: number of cycles that have ended.
    """

    memory = ("count",)
    count = 0

    def __init__(self, plan: PlanNode, run: PlanRun, nodes: Sequence[PlanBehaviour]) -> None:
        super().__init__(plan, run, nodes)
        self.times = plan.number(LOOPS[plan.kind.name])
        self.again = SUCCESS if plan.kind.name == "Repeat" else FAILURE

    def run(self) -> Answer:
        """Tick the child, and begin the next cycle after its end."""
        child, times = self.nodes[0], self.times
        self.status = RUNNING
        loops = times == -1 or self.count < times
        while loops:
            self.feedback_message = f"{self.count + 1} of {times:g}"
            begins = child.status is IDLE
            answer = child.execute()
            if answer is RUNNING:
                return RUNNING
            child.reset()
            if answer is SKIPPED:
                return SKIPPED
            if answer is not self.again:
                self.count = 0
                return answer
            self.count += 1
            loops = times == -1 or self.count < times
            if begins and loops:
                self.context.yielded = True
                return RUNNING
        self.count = 0
        return self.again


class RunOnce(PlanDecorator):
    """`RunOnce`: after its first end SKIPPED, or that result.

    Attributes:
        was: name of the first result; empty before.
    """

    memory = ("was",)
    was = ""

    def on_halt(self) -> None:
        """Remember the result."""

    def run(self) -> Answer:
        """Tick the child, unless it has ended once."""
        if self.was:
            if not self.plan.ports["then_skip"] and self.was == FAILURE.name:
                self.context.port.note_failure(self.plan, "it failed before")
            return SKIPPED if self.plan.ports["then_skip"] else ANSWERS[self.was]
        self.status = RUNNING
        answer = self.nodes[0].execute()
        if answer is SUCCESS or answer is FAILURE:
            self.was = answer.name
        return answer


class TimedDecorator(PlanDecorator):
    """A decorator with a timer on the executive's clock.

    Attributes:
        until_s: end of the timer; None while it is not running.
    """

    timers = ("until_s",)
    until_s: float | None = None

    def tick_child(self) -> Answer:
        """Tick the child; its end drops the timer."""
        answer = self.nodes[0].execute()
        if answer is SUCCESS or answer is FAILURE:
            self.until_s = None
        return answer

    @property
    def next_utc_s(self) -> float | None:
        """The end of its timer."""
        return self.utc_of(self.until_s)


class Timeout(TimedDecorator):
    """`Timeout`: fails when its child takes too long. The timer ends once if the child is idle."""

    def run(self) -> Answer:
        """Tick the child, unless its time has expired."""
        port, duration_s = self.context.port, self.plan.number("msec") / 1000
        if self.until_s is None:
            if port.has_expired(self.plan, self.cycles):
                return FAILURE
            self.status = RUNNING
            self.until_s = port.clock.now_s() + duration_s
        elif self.overdue_s(self.until_s) >= 0.0:
            if self.nodes[0].status is RUNNING:
                self.until_s = None
                self.nodes[0].reset()
                text = f"not done within {duration_s:g} s"
                port.note_failure(self.plan, text)
                self.decide("ended", f"ended {self.nodes[0].name}: {text}")
                return FAILURE
            self.until_s = inf
        return self.tick_child()


class Delay(TimedDecorator):
    """`Delay`: waits, then runs its child."""

    def run(self) -> Answer:
        """Tick the child after the delay."""
        if self.until_s is None:
            self.status = RUNNING
            now_s = self.context.port.clock.now_s()
            self.until_s = now_s + self.plan.number("delay_msec") / 1000
        if self.nodes[0].status is IDLE and self.overdue_s(self.until_s) < 0.0:
            return RUNNING
        return self.tick_child()


class Precondition(PlanDecorator):
    """`Precondition`: runs its child if a condition holds when it begins.

    Attributes:
        inside: whether the condition has held, and the child has not ended.
    """

    memory = ("inside",)
    inside = False

    def run(self) -> Answer:
        """Test the condition unless the child was begun, and tick the child."""
        if not self.inside:
            holds = self.holds(self.script("if"))
            if holds is None:
                return FAILURE
            if not holds:
                text = f"not {self.script('if').text}"
                self.decide("else", f"skipped {self.nodes[0].name}: {text}")
                return self.answer_as("else", text)
            self.inside = True
        answer = self.nodes[0].execute()
        if answer is SUCCESS or answer is FAILURE:
            self.inside = False
        return answer


class QueueLoop(PlanDecorator):
    """`LoopString`, `LoopDouble`, `LoopPlace`: runs its child for each part of a queue.

    Attributes:
        left: the parts that are left.
        busy: whether the child runs.
    """

    memory = ("left", "busy")
    left: tuple[str, ...] = ()
    busy = False

    def run(self) -> Answer:
        """Take the next part unless the child runs, and tick the child."""
        if (self.status is IDLE or not self.busy) and not self._take_part():
            return self.answer_as("if_empty", "no part of the queue is left")
        if self.status is IDLE:
            self.status = RUNNING
        answer = self.nodes[0].execute()
        self.busy = answer is RUNNING
        return FAILURE if answer is FAILURE else RUNNING

    def _take_part(self) -> bool:
        if self.status is IDLE:
            self.busy, self.left = False, parts_of(self.read_text("queue"))
            if len(self.left) > MAX_READ_PARTS and not isinstance(self.plan.ports["queue"], str):
                problem = f"queue has {len(self.left)} parts: {MAX_READ_PARTS} at most"
                raise ArgumentError(f"{problem} from a variable")
        if not self.left:
            return False
        part, *rest = self.left
        self.left = tuple(rest)
        self.feedback_message = f"part {part}"[:80]
        self.write("heading", None)
        for port, value in part_values(self.plan.kind.name, part).items():
            self.write(port, value)
        return True


class Window(PlanDecorator):
    """`Window`: runs its child between two times, and fails at the end; times are absolute."""

    def run(self) -> Answer:
        """Wait for the begin, tick the child, halt it at the end."""
        self.status = RUNNING
        ports = self.plan.ports
        if "until" in ports and self.past_s(self.plan.number("until")) >= 0.0:
            if self.nodes[0].status is RUNNING:
                self.decide("ended", f"ended {self.nodes[0].name}: the window has closed")
            self.nodes[0].reset()
            self.context.port.note_failure(self.plan, "the window has closed")
            return FAILURE
        if "from" in ports and self.past_s(self.plan.number("from")) < 0.0:
            return RUNNING
        return self.nodes[0].execute()

    @property
    def next_utc_s(self) -> float | None:
        """Its begin, or its end."""
        utc_s, ports = self.context.port.clock.utc_s(), self.plan.ports
        times = (self.plan.number(each) for each in ("from", "until") if each in ports)
        return next((each for each in times if each > utc_s), None)

    @property
    def waits(self) -> str:
        """Its begin, before that."""
        if "from" not in self.plan.ports:
            return ""
        begin_utc_s = self.plan.number("from")
        return f"waits until {time_text(begin_utc_s)}" if self.past_s(begin_utc_s) < 0.0 else ""
