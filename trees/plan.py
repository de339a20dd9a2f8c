"""`PlanTree`: the py_trees tree of a plan, with the nodes of BehaviorTree.CPP v4 that it may have.

Its leaves command nothing themselves: they poll the `PlanExecution`, which knows the completed
steps. A node that is halted while it runs halts its running descendants.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import assert_never

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator, Inverter

from executive.plans import (
    FallbackNode,
    InverterNode,
    LoopNode,
    ParallelNode,
    PlanExecution,
    PlanNode,
    PlanStep,
    RepeatOn,
    SequenceNode,
    StepStatus,
    TimeoutNode,
    step_key,
)
from trees.leaf import ContainedNode

_STATUS = {progress: Status[progress.name] for progress in StepStatus}
_ENDED = {Status.SUCCESS, Status.FAILURE}
_PROGRESS = {status: progress for progress, status in _STATUS.items()}


class Cycle:
    """The present cycle of a loop, from 1."""

    def __init__(self) -> None:
        self.now = 1


class PlanTree:
    """The tree of one plan."""

    def __init__(self, plan: PlanNode, execution: PlanExecution) -> None:
        self._execution = execution
        self.root = _node(plan, execution, ())

    def tick(self) -> StepStatus:
        """Tick once from the root."""
        self._execution.begin_tick()
        self.root.tick_once()
        return _PROGRESS[self.root.status]


class CommandLeaf(ContainedNode):
    """A leaf: waits up to its deadline for the end of its command, which its message names."""

    def __init__(self, step: PlanStep, execution: PlanExecution, cycles: Sequence[Cycle]) -> None:
        super().__init__(step.location.name)
        self._step = step
        self._execution = execution
        self._cycles = cycles

    def initialise(self) -> None:
        """Store the cycle of each loop around it, and the start time."""
        self._key = step_key(self._step.location, [cycle.now for cycle in self._cycles])
        self._began_s = self._execution.clock.now_s()

    def update(self) -> Status:
        """Poll the command."""
        progress, allowed_s = self._execution.poll(self._key, self._step), self._step.deadline_s
        command = self._execution.command_of(self._key)
        self.feedback_message = "" if command is None else str(command)
        if allowed_s is not None and progress is StepStatus.RUNNING and self._passed(allowed_s):
            progress = self._execution.fail_overdue(self._key, self._step, allowed_s)
        return _STATUS[progress]

    def _passed(self, allowed_s: float) -> bool:
        return self._execution.clock.now_s() >= self._began_s + allowed_s

    def terminate(self, new_status: Status) -> None:
        """Cancel the command, if halted while it is active."""
        if new_status is Status.INVALID and self.status is Status.RUNNING:
            self._execution.halt_step(self._key)


class SkippedNode(ContainedNode):
    """A node that an operator skipped."""

    def update(self) -> Status:
        """Succeed at once."""
        self.feedback_message = "skipped"
        return Status.SUCCESS


class LoopDecorator(Decorator):
    """`Repeat` and `RetryUntilSuccessful`: repeats its child while it has the loop's result."""

    def __init__(
        self, loop: LoopNode, child: Behaviour, execution: PlanExecution, cycle: Cycle
    ) -> None:
        super().__init__(loop.location.name, child)
        self._execution = execution
        self._times = loop.times
        self._again = Status.SUCCESS if loop.repeat_on is RepeatOn.SUCCESS else Status.FAILURE
        self._cycle = cycle

    def initialise(self) -> None:
        """Start the first cycle."""
        self._cycle.now = 1

    def tick(self) -> Iterator[Behaviour]:
        """Tick the child; after its end start the next cycle in the same tick, if permitted."""
        if self.status is not Status.RUNNING:
            self.initialise()
        yield from self.decorated.tick()
        while self._continues:
            self._cycle.now += 1
            self.decorated.stop(Status.INVALID)  # or the last cycle's results would be shown
            if self._execution.exhausted:
                yield from _ended(self, Status.RUNNING)
                return
            yield from self.decorated.tick()
        self.feedback_message = f"{self._cycle.now} of {self._times}"
        yield from _ended(self, self.update())

    @property
    def _continues(self) -> bool:
        return self.decorated.status is self._again and self._cycle.now < self._times

    def update(self) -> Status:
        """Return the status of the last cycle."""
        return _status_of(self.decorated)


class TimeoutDecorator(Decorator):
    """`Timeout`: fails when its child takes too long, on the core's clock."""

    def __init__(
        self,
        limit: TimeoutNode,
        child: Behaviour,
        execution: PlanExecution,
        cycles: Sequence[Cycle],
    ) -> None:
        super().__init__(limit.location.name, child)
        self._limit = limit
        self._execution = execution
        self._cycles = cycles

    def initialise(self) -> None:
        """Start the time limit."""
        self._key = step_key(self._limit.location, [cycle.now for cycle in self._cycles])
        self._until_s = self._execution.clock.now_s() + self._limit.duration_s

    def tick(self) -> Iterator[Behaviour]:
        """Tick the child, unless the journal records that its time expired."""
        if self.status is not Status.RUNNING:
            self.initialise()
        if self._execution.timed_out(self._key):
            yield from _ended(self, Status.FAILURE)
            return
        yield from self.decorated.tick()
        yield from _ended(self, self.update())

    def update(self) -> Status:
        """Return the status of the child, or FAILURE if its time has expired."""
        left_s = self._until_s - self._execution.clock.now_s()
        self.feedback_message = f"{max(left_s, 0.0):.0f} s left"
        if self.decorated.status is Status.RUNNING and left_s <= 0:
            self._execution.time_out(self._key, self._limit)
            return Status.FAILURE
        return _status_of(self.decorated)


class ParallelBranch(composites.Composite):
    """`Parallel`: ticks all children that have not ended, until enough have."""

    def __init__(self, parallel: ParallelNode, children: Sequence[Behaviour]) -> None:
        super().__init__(parallel.location.name, list(children))
        self._parallel = parallel

    def tick(self) -> Iterator[Behaviour]:
        """Tick the children in order until the result is decided."""
        if self.status is not Status.RUNNING:
            for child in self.children:
                child.stop(Status.INVALID)
        ends = Counter(child.status for child in self.children)
        for child in self.children:
            if child.status in _ENDED:
                continue
            yield from child.tick()
            ends[child.status] += child.status in _ENDED
            if self._decided(ends) is not Status.RUNNING:
                break
        self.status = self._decided(ends)
        if self.status is not Status.RUNNING:
            for child in self.children:
                if child.status is Status.RUNNING:
                    child.stop(Status.INVALID)
        yield self

    def _decided(self, ends: Counter[Status]) -> Status:
        """Return the status that follows from the numbers of successes and failures."""
        failed = ends[Status.FAILURE]
        if ends[Status.SUCCESS] >= self._parallel.successes:
            return Status.SUCCESS
        maximum = len(self.children) - failed
        if failed >= self._parallel.failures or maximum < self._parallel.successes:
            return Status.FAILURE
        return Status.RUNNING


def _status_of(node: Behaviour) -> Status:
    status: Status = node.status
    return status


def _ended(node: Decorator, status: Status) -> Iterator[Behaviour]:
    if status is not Status.RUNNING:
        node.stop(status)
    node.status = status
    yield node


def _node(node: PlanNode, execution: PlanExecution, cycles: tuple[Cycle, ...]) -> Behaviour:
    def below(children: Sequence[PlanNode]) -> list[Behaviour]:
        return [_node(child, execution, cycles) for child in children]

    if execution.skips(node.location):
        return SkippedNode(node.location.name)
    match node:
        case PlanStep():
            return CommandLeaf(node, execution, cycles)
        case SequenceNode() | FallbackNode():
            kind = composites.Sequence if isinstance(node, SequenceNode) else composites.Selector
            return kind(node.location.name, memory=True, children=below(node.children))
        case ParallelNode():
            return ParallelBranch(node, below(node.children))
        case LoopNode(_, _, _, child):
            cycle = Cycle()
            below_it = _node(child, execution, (*cycles, cycle))
            return LoopDecorator(node, below_it, execution, cycle)
        case TimeoutNode(_, _, child):
            return TimeoutDecorator(node, _node(child, execution, cycles), execution, cycles)
        case InverterNode(location, child):
            return Inverter(location.name, _node(child, execution, cycles))
        case _:
            assert_never(node)
