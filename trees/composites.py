"""The composites of the rover's tree: as those of py_trees, but ticked by a plain call.

py_trees ticks by nested generators, and makes one for each node that stops: a tick of the idle tree
took more than four times as long. The trees of plans use the composites of py_trees.
"""

from abc import abstractmethod
from collections.abc import Iterator

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status


class TickedNode(Behaviour):
    """A node that is ticked by `run`."""

    @abstractmethod
    def run(self, ticked: list[Behaviour]) -> Status:
        """Tick the node, append it to `ticked` after its children, and return its status."""

    def tick(self) -> Iterator[Behaviour]:
        """Tick as any behaviour of py_trees."""
        ticked: list[Behaviour] = []
        self.run(ticked)
        yield from ticked

    def stop(self, new_status: Status) -> None:
        """Stop with a status."""
        self.terminate(new_status)
        self.status = new_status


class _Composite(TickedNode, composites.Composite):
    nodes: tuple[TickedNode, ...]

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Stop with a status; if that is INVALID, all children as well."""
        if new_status is Status.INVALID:
            self.current_child = None
            _invalidate(self.nodes)
        self.status = new_status

    def _end(self, status: Status, ticked: list[Behaviour]) -> Status:
        if status is Status.RUNNING:
            self.status = status
        else:
            self.stop(status)
        ticked.append(self)
        return status


class Selector(_Composite, composites.Selector):
    """Ticks its children in order until one does not fail; stops those after it."""

    def __init__(self, name: str, *nodes: TickedNode) -> None:
        super().__init__(name, memory=False, children=list(nodes))
        self.nodes = nodes

    def run(self, ticked: list[Behaviour]) -> Status:
        """Tick the children."""
        previous = self.current_child if self.status is Status.RUNNING else self.nodes[0]
        for index, child in enumerate(self.nodes):
            status = child.run(ticked)
            if status is not Status.FAILURE:
                self.current_child = child
                if child is not previous:
                    _invalidate(self.nodes[index + 1 :])
                return self._end(status, ticked)
        self.current_child = self.nodes[-1]
        return self._end(Status.FAILURE, ticked)


class Sequence(_Composite, composites.Sequence):
    """Ticks its children in order until one does not succeed.

    Args:
        memory: whether it continues at the child that was RUNNING.
    """

    def __init__(self, name: str, *nodes: TickedNode, memory: bool = False) -> None:
        super().__init__(name, memory=memory, children=list(nodes))
        self.nodes = nodes
        self._next = 0

    def run(self, ticked: list[Behaviour]) -> Status:
        """Tick the children."""
        if self.status is not Status.RUNNING:
            self._next = 0
            _invalidate(self.nodes)
        elif not self.memory:
            self._next = 0
        while self._next < len(self.nodes):
            self.current_child = child = self.nodes[self._next]
            status = child.run(ticked)
            if status is not Status.SUCCESS:
                if not self.memory:
                    _invalidate(self.nodes[self._next + 1 :])
                return self._end(status, ticked)
            self._next += 1
        return self._end(Status.SUCCESS, ticked)


class Parallel(_Composite, composites.Parallel):
    """Ticks all children; fails as soon as one does, and succeeds once all have."""

    def __init__(self, name: str, *nodes: TickedNode) -> None:
        policy = ParallelPolicy.SuccessOnAll(synchronise=False)
        super().__init__(name, policy, children=list(nodes))
        self.nodes = nodes

    def run(self, ticked: list[Behaviour]) -> Status:
        """Tick the children."""
        if self.status is not Status.RUNNING:
            _invalidate(self.nodes)
        statuses = [child.run(ticked) for child in self.nodes]
        if Status.FAILURE in statuses:
            return self._end(Status.FAILURE, ticked)
        running = Status.RUNNING in statuses
        return self._end(Status.RUNNING if running else Status.SUCCESS, ticked)

    def stop(self, new_status: Status = Status.INVALID) -> None:
        """Stop with a status; RUNNING children become INVALID."""
        for child in self.nodes:
            if child.status is Status.RUNNING:
                child.stop(Status.INVALID)
        super().stop(new_status)


def _invalidate(nodes: tuple[TickedNode, ...]) -> None:
    for node in nodes:
        if node.status is not Status.INVALID:
            node.stop(Status.INVALID)
