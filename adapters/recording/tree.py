"""The behaviour tree of a recorded run, as the recording tells it."""

from dataclasses import replace
from typing import Final

from executive.commands.intake import SOURCE_PREFIX
from executive.core.recording import NodeState, TreeChanged
from executive.settings import Settings
from trees import NodeKind, NodeStatus, TreeNodeSnapshot, preview

_GUARDS: Final = {NodeKind.CONDITION, NodeKind.TAKE}
"""What says nothing but which command it lets its branch work on."""


class RecordedTree:
    """The tree of one life of an executive, kept up to date by what was recorded of it."""

    def __init__(self, settings: Settings) -> None:
        self._static = preview(settings)
        self._paths = {node.path for node in self._static}
        self._guards = {node.path for node in self._static if node.kind in _GUARDS}
        self._states: dict[str, NodeState] = {}
        self._nodes: tuple[TreeNodeSnapshot, ...] | None = None

    def put(self, change: TreeChanged) -> tuple[str, ...]:
        """Take a change; return the paths of the nodes that differ in more than their words.

        That is, those that came, have another status, or name another command: guards, and the
        leaves of a plan.
        """
        self._nodes = None
        others = []
        for each in change.nodes:
            before = self._states.get(each.path)
            names_command = each.path in self._guards or each.message.startswith(SOURCE_PREFIX)
            if before is None or before.status != each.status or names_command:
                others.append(each.path)
            self._states[each.path] = each
        for lost in change.gone:
            self._states.pop(lost, None)
        return tuple(others)

    def nodes(self) -> tuple[TreeNodeSnapshot, ...]:
        """Return the nodes as they are now; those of a plan stand first below the root."""
        if self._nodes is None:
            self._nodes = self._drawn()
        return self._nodes

    def _drawn(self) -> tuple[TreeNodeSnapshot, ...]:
        planned = tuple(
            TreeNodeSnapshot(
                state.path,
                state.path.rpartition("/")[2],
                1 + state.path.count("/"),
                NodeKind.PLANNED,
                NodeStatus[state.status],
                state.message,
            )
            for state in self._states.values()
            if state.path not in self._paths
        )
        others = tuple(_with(node, self._states.get(node.path)) for node in self._static)
        return (*others[:1], *planned, *others[1:])


def _with(node: TreeNodeSnapshot, state: NodeState | None) -> TreeNodeSnapshot:
    if state is None:
        return node
    return replace(node, status=NodeStatus[state.status], message=state.message)
