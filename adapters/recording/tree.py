"""Behaviour tree of a recorded run, rebuilt from the recording."""

from dataclasses import replace
from typing import Final

from executive.commands.intake import SOURCE_PREFIX
from executive.core.recording import NodeState, TreeChanged
from executive.settings import Settings
from trees import NodeKind, NodeStatus, TreeNodeSnapshot, preview

_GUARDS: Final = {NodeKind.CONDITION, NodeKind.TAKE}
"""Nodes whose message only names the command of their branch."""


class RecordedTree:
    """Behaviour tree of one start of an executive, updated by its recorded changes."""

    def __init__(self, settings: Settings) -> None:
        self._static = preview(settings)
        self._paths = {node.path for node in self._static}
        self._guards = {node.path for node in self._static if node.kind in _GUARDS}
        self._states: dict[str, NodeState] = {}
        self._nodes: tuple[TreeNodeSnapshot, ...] | None = None

    def put(self, change: TreeChanged) -> tuple[str, ...]:
        """Apply a change; return the paths of nodes that differ in more than their message.

        These are new nodes, nodes with another status, and nodes that name another command: guards,
        and the leaves of a plan.
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
        """Return the present nodes; those of a plan are first below the root."""
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
