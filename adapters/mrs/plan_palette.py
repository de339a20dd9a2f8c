"""The nodes of plans as a `TreeNodesModel`, the part of a plan's XML that tells Groot2 of them."""

from xml.sax.saxutils import quoteattr

from executive.plans import DEADLINE, LEAVES, Kind, Parameter

_TYPE = {Kind.PLACES: Kind.TEXT.value}


def palette() -> str:
    """Return a plan without trees, with a model of every leaf."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<root BTCPP_format="4">']
    lines.append("  <TreeNodesModel>")
    for leaf in LEAVES.values():
        lines.append(f'    <Action ID="{leaf.name}">')
        lines += [_port(parameter) for parameter in (*leaf.parameters, DEADLINE)]
        lines.append("    </Action>")
    lines += ["  </TreeNodesModel>", "</root>"]
    return "\n".join(lines) + "\n"


def _port(parameter: Parameter) -> str:
    kind = quoteattr(_TYPE.get(parameter.kind, parameter.kind.value))
    about = quoteattr(parameter.help if parameter.required else f"{parameter.help} (optional)")
    return f'      <input_port name="{parameter.name}" type={kind} description={about}/>'
