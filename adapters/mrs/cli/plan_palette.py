"""The palette of plan nodes for Groot2."""

from collections.abc import Mapping
from typing import Final
from xml.sax.saxutils import quoteattr

from executive.plans import DIALECT, Port, PortType

_OWN_NODES: Final = frozenset(
    ["WaitUntil", "WaitFor", "Window", "Ask", "Near", "Reachable", "FaultActive", "LoopPlace"]
)
_TYPES: Final[Mapping[PortType, str]] = {
    PortType.COUNT: "int",
    PortType.SECONDS: "double",
    PortType.MILLISECONDS: "unsigned int",
    PortType.STATUS: "BT::NodeStatus",
    PortType.FLAG: "bool",
    PortType.NUMBER: "double",
    PortType.ANY: "BT::AnyTypeAllowed",
    PortType.WRITTEN_NUMBER: "double",
    PortType.WRITTEN: "BT::AnyTypeAllowed",
}
"""Types in Groot2's model; all others are texts."""


def palette() -> str:
    """Return Groot2's model of all nodes of the dialect that BehaviorTree.CPP does not have."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<root BTCPP_format="4">']
    lines.append("  <TreeNodesModel>")
    for kind in DIALECT.values():
        if kind.command is None and kind.name not in _OWN_NODES:
            continue
        lines.append(f'    <{kind.role.value} ID="{kind.name}">')
        lines += (f"      {_model_of(port)}" for port in kind.ports)
        lines.append(f"    </{kind.role.value}>")
    lines += ["  </TreeNodesModel>", "</root>"]
    return "\n".join(lines) + "\n"


def _model_of(port: Port) -> str:
    direction = "output_port" if port.type.is_output else "input_port"
    kind = _TYPES.get(port.type, "std::string")
    if port.argument is not None and port.argument.kind is int:
        kind = "int"
    about = f"{port.meaning} (optional)" if port.optional else port.meaning
    default = "" if port.default is None else f" default={quoteattr(port.default)}"
    text = f'<{direction} name="{port.name}" type="{kind}"{default}'
    return f"{text} description={quoteattr(about)}/>"
