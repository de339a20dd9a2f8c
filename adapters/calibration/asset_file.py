"""Update of figures in the YAML file of an asset; its comments and layout are unchanged."""

from collections.abc import Mapping
from dataclasses import dataclass

import yaml

from executive.settings import SettingsError, parse_yaml

Tree = dict[str, "float | Tree"]


@dataclass(frozen=True, slots=True)
class _Edit:
    """A section of the text and its replacement."""

    begin: int
    end: int
    text: str


def with_figures(text: str, figures: Mapping[str, float]) -> str:
    """Return the text of a YAML file with new figures; missing ones are added.

    Args:
        text: content of the file.
        figures: new figures, by dotted key.

    Raises:
        SettingsError: it is not the YAML of an asset, or a key of a figure has another content.
    """
    parse_yaml(text, "the asset's file")
    root = yaml.compose(text)
    if not isinstance(root, yaml.MappingNode):
        raise SettingsError("is no YAML of an asset")
    edits = sorted(_edits(text, root, _tree(figures)), key=lambda edit: edit.begin, reverse=True)
    for edit in edits:
        text = text[: edit.begin] + edit.text + text[edit.end :]
    return text


def _tree(figures: Mapping[str, float]) -> Tree:
    root: Tree = {}
    for key, value in figures.items():
        *path, last = key.split(".")
        inner = root
        for name in path:
            deeper = inner.setdefault(name, {})
            assert isinstance(deeper, dict)
            inner = deeper
        inner[last] = value
    return root


def _edits(text: str, node: yaml.MappingNode, wanted: Tree) -> list[_Edit]:
    there = {key.value: value for key, value in node.value}
    edits: list[_Edit] = []
    added: list[str] = []
    for name, value in wanted.items():
        match there.get(name):
            case None:
                added.append(f"{name}: {_flow(value)}")
            case yaml.MappingNode() as inner if isinstance(value, dict):
                edits += _edits(text, inner, value)
            case yaml.ScalarNode() as scalar if not isinstance(value, dict):
                begin, end = scalar.start_mark.index, scalar.end_mark.index
                edits.append(_Edit(begin, end, _flow(value)))
            case _:
                raise SettingsError(f"has no figures at {name}")
    if added:
        edits.append(_addition(text, node, added))
    return edits


def _addition(text: str, node: yaml.MappingNode, lines: list[str]) -> _Edit:
    """Return the edit that adds lines at the end of a section."""
    if node.flow_style:
        at = node.end_mark.index - 1
        return _Edit(at, at, "".join(f", {line}" for line in lines))
    last = node.value[-1][1].end_mark.index
    end_of_line = text.find("\n", len(text[:last].rstrip()))
    at = len(text) if end_of_line < 0 else end_of_line
    indent = "\n" + " " * node.value[0][0].start_mark.column
    return _Edit(at, at, "".join(indent + line for line in lines))


def _flow(value: float | Tree) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}: {_flow(each)}" for name, each in value.items()) + "}"
    return f"{value:g}"
