"""Base classes of leaves: a deadline on the core's clock, and containment of exceptions.

Whatever is raised within a leaf leaves the tree as a `LeafError` that has the leaf's path.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator
from types import UnionType

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.core.tree import LeafError
from executive.goals import Context, Goal, GoalQueue
from executive.values.facts import Source
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity


def path_of(behaviour: Behaviour) -> str:
    """Return the stable path of a node: the names from the root, joined by slashes."""
    names = [behaviour.name]
    while behaviour.parent is not None:
        behaviour = behaviour.parent
        names.append(behaviour.name)
    return "/".join(reversed(names))


class ContainedNode(Behaviour):
    """A node without children; what it raises leaves the tree with its path."""

    def tick(self) -> Iterator[Behaviour]:
        """Tick as every behaviour.

        Raises:
            LeafError: it raised something.
        """
        try:
            yield from super().tick()
        except Exception as error:
            raise LeafError(path_of(self)) from error


class Condition(ContainedNode):
    """A leaf that tests something: it never acts and is never RUNNING.

    Its message names the command for which it held last.

    Args:
        holds: whether it does.
        whose: for which command, where it holds; None where that is for none.
    """

    def __init__(
        self, name: str, holds: Callable[[], bool], whose: Callable[[], Identity] | None = None
    ) -> None:
        super().__init__(name)
        self._holds = holds
        self._whose = whose

    def update(self) -> Status:
        """Return SUCCESS if it holds, else FAILURE."""
        if not self._holds():
            return Status.FAILURE
        if self._whose is not None:
            self.feedback_message = str(self._whose())
        return Status.SUCCESS


class Leaf(ContainedNode):
    """A primitive. It wants things of the actuators through intents and never publishes.

    Attributes:
        allowed_s: how long it may take.
        deadline_s: when it gives up, on the core's clock.
    """

    def __init__(self, name: str, context: Context) -> None:
        super().__init__(name)
        self.context = context
        self.allowed_s = self.deadline_s = 0.0

    def allow(self, allowed_s: float) -> None:
        """Set the deadline, this many seconds from now."""
        self.allowed_s = allowed_s
        self.deadline_s = self.context.clock.now_s() + allowed_s

    def initialise(self) -> None:
        """Begin, and set the deadline."""
        self.allow(self.begin())

    def update(self) -> Status:
        """Act; past the deadline, give up."""
        status = self.act()
        late = self.context.clock.now_s() > self.deadline_s
        return self.give_up() if late and status is Status.RUNNING else status

    @abstractmethod
    def begin(self) -> float:
        """Prepare, and return the seconds after which the leaf gives up."""

    @abstractmethod
    def act(self) -> Status:
        """Do one tick's work."""

    @abstractmethod
    def give_up(self) -> Status:
        """Handle a missed deadline, and return the leaf's status."""


class GoalLeaf(Leaf):
    """A primitive that works on the active goal of a queue, and on no other.

    Attributes:
        goal: the goal that was active when it began.
        late: why the goal fails past the deadline.
        late_text: what is said of it then, before the seconds allowed.
        needs: the source whose data it waits for.
    """

    goal: Goal
    late: Reason
    late_text: str
    needs: Source | None = None

    def __init__(self, name: str, context: Context, queue: GoalQueue) -> None:
        super().__init__(name, context)
        self.queue = queue

    def initialise(self) -> None:
        """Take the active goal and begin."""
        if self.queue.active is not None:
            self.goal = self.queue.active
        super().initialise()

    def update(self) -> Status:
        """Act on the goal; once it has ended or was replaced, there is nothing left to do."""
        return super().update() if self.queue.active is self.goal else Status.FAILURE

    def give_up(self) -> Status:
        """Fail the goal, which took too long."""
        text = f"{self.late_text} within {self.allowed_s:.1f} s"
        text = self.context.status.rejections.explain(text, self.needs)
        return self.fail(Refusal(self.late, text, (Figure("bound", self.allowed_s, "s"),)))

    def fail(self, refusal: Refusal) -> Status:
        """End the goal without success."""
        self.queue.fail(refusal)
        return Status.FAILURE


class Idle(Behaviour):
    """Has nothing to do."""

    def update(self) -> Status:
        """Want nothing."""
        return Status.SUCCESS


class TakeGoal(ContainedNode):
    """Takes the next goal of a queue, which starts it, for the leaves after it in a sequence.

    Its message names the command whose goal it took last.

    Args:
        requests: those of goals that are for them; else the goal is left to the next branch.
        waits: whether no goal may be worked on now.
    """

    def __init__(
        self,
        name: str,
        queue: GoalQueue,
        requests: UnionType | type,
        waits: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(name)
        self._queue = queue
        self._requests = requests
        self._waits = waits

    def update(self) -> Status:
        """Return SUCCESS if there is a goal for the leaves after this one."""
        if self._waits():
            return Status.FAILURE
        goal = self._queue.take()
        if goal is None or not isinstance(goal.command.request, self._requests):
            return Status.FAILURE
        self.feedback_message = str(goal.command.identity)
        return Status.SUCCESS
