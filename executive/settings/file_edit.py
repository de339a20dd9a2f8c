"""New values in the YAML files of an asset; their comments, order and layout are unchanged."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from errno import EACCES
from pathlib import Path
from shutil import copymode
from typing import Any, Final

import yaml

from executive.settings.settings_files import SettingsError, config_folder, parse_yaml

Value = float | str
Tree = dict[str, "Value | Tree"]
MAX_WIDTH: Final = 1000
INSTALLED: Final = ("share", "rover_executive", "config")
"""Last parts of the configuration folder of an installed package."""


@dataclass(frozen=True, slots=True)
class FileEdit:
    """A YAML file that is to get new values.

    Attributes:
        values: by dotted key, in the section `root`.
        sections: the sections with new values as YAML, complete.
        summary: each value that differs, in one line; empty: none.
    """

    path: Path
    values: Mapping[str, Value]
    root: tuple[str, ...]
    sections: str
    summary: str

    def text(self) -> str:
        """Return the new content.

        Raises:
            SettingsError: the file cannot be read, or its YAML is too complex for a value.
        """
        wanted = {".".join((*self.root, key)): value for key, value in self.values.items()}
        text = _text(self.path)
        try:
            return with_values(text, wanted)
        except SettingsError as error:
            raise SettingsError(f"{self.path}: {error}") from error


def edit_file(path: Path, values: Mapping[str, Value], *root: str) -> FileEdit:
    """Return the edit of a file, which is not written yet.

    Args:
        path: the file.
        values: new values, by dotted key.
        root: keys of the section that has all of them.

    Raises:
        SettingsError: the file cannot be read, or is no YAML.
    """
    before: Any = parse_yaml(_text(path), str(path))
    for key in root:
        before = _mapping(before).get(key)
    wanted = _tree(values)
    after = _merged(before, wanted)
    flow: Any = {"default_flow_style": None, "sort_keys": False, "width": MAX_WIDTH}
    lines = str(yaml.safe_dump({name: after[name] for name in wanted}, **flow)) if wanted else ""
    return FileEdit(path, values, root, lines, ", ".join(_changed(before, wanted)))


def write_edits(edits: Sequence[FileEdit]) -> None:
    """Replace each file by its new content; the first one after all could be written.

    Raises:
        OSError: one cannot be written.
        SettingsError: one cannot be edited.
    """
    texts = [each.text() for each in edits]
    targets = [each.path.resolve() for each in edits]  # a symbolic link remains one
    for target in targets:
        if not target.stat().st_mode & 0o222:  # root could write it all the same
            raise PermissionError(EACCES, "it is read-only", str(target))
        target.open("r+b").close()
    written = [target.with_name(f"{target.name}.new") for target in targets]
    for target, new, text in zip(targets, written, texts, strict=True):
        new.write_bytes(text.encode())
        copymode(target, new)
    for target, new in zip(targets, written, strict=True):
        new.replace(target)


def _text(path: Path) -> str:
    """Return the content with its ends of lines."""
    try:
        return path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: cannot be read ({error})") from error


def installed_warning(path: Path) -> str:
    """Return why a file should not be written; empty for a file of the user."""
    folder = config_folder().resolve()
    if folder.parts[-3:] != INSTALLED or not path.resolve().is_relative_to(folder):
        return ""
    return (
        f"{path} belongs to the installed package, and is lost with it: copy all of {folder} to a"
        " folder of yours, and set ROVER_CONFIG to that"
    )


def with_values(text: str, values: Mapping[str, Value]) -> str:
    """Return the text of a YAML file with new values; missing keys are added.

    Raises:
        SettingsError: it is not the YAML of an asset, or a key has another content.
    """
    before = parse_yaml(text, "the asset's file")
    root = yaml.compose(text)
    if not isinstance(root, yaml.MappingNode):
        raise SettingsError("is no YAML of an asset")
    wanted, new = _tree(values), text
    edits = sorted(_edits(text, root, wanted), key=lambda edit: edit.begin, reverse=True)
    for edit in edits:
        new = new[: edit.begin] + edit.text + new[edit.end :]
    # An anchor, a merged section or a trailing comma needs a person.
    if parse_yaml(new, "the asset's file with new values") != _merged(before, wanted):
        raise SettingsError(f"write {', '.join(values)} by hand: it is no simple YAML there")
    return new


@dataclass(frozen=True, slots=True)
class _Edit:
    """A section of the text and its replacement."""

    begin: int
    end: int
    text: str


def _tree(values: Mapping[str, Value]) -> Tree:
    root: Tree = {}
    for key, value in values.items():
        *path, last = key.split(".")
        inner = root
        for name in path:
            deeper = inner.setdefault(name, {})
            assert isinstance(deeper, dict)
            inner = deeper
        inner[last] = value
    return root


def _mapping(data: Any) -> dict[str, Any]:
    return data if isinstance(data, dict) else {}


def _merged(data: Any, wanted: Tree) -> dict[str, Any]:
    old = _mapping(data)
    return old | {
        name: _merged(old.get(name), value) if isinstance(value, dict) else value
        for name, value in wanted.items()
    }


def _changed(data: Any, wanted: Tree, path: str = "") -> Iterator[str]:
    """Yield each value that differs, with the old one."""
    for name, value in wanted.items():
        old, key = _mapping(data).get(name), f"{path}{name}"
        if isinstance(value, dict):
            yield from _changed(old, value, f"{key}.")
        elif old != value:
            before = "" if old is None else f"{_flow(old)} → "
            yield f"{key} {before}{_flow(value)}"


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
                raise SettingsError(f"has another content at {name}")
    if added:
        edits.append(_addition(text, node, added))
    return edits


def _addition(text: str, node: yaml.MappingNode, lines: list[str]) -> _Edit:
    """Return the edit that adds lines at the end of a section."""
    if node.flow_style:
        at = node.end_mark.index - 1
        return _Edit(at, at, ", ".join([""] * bool(node.value) + lines))
    last: Any = node
    # A section in lines ends, for the parser, after the comments of the next one.
    while isinstance(last, yaml.CollectionNode) and not last.flow_style and last.value:
        last = last.value[-1]
        last = last[1] if isinstance(last, tuple) else last
    end_of_line = text.find("\n", len(text[: last.end_mark.index].rstrip()))
    at = len(text) if end_of_line < 0 else end_of_line
    indent = "\n" + " " * node.value[0][0].start_mark.column
    return _Edit(at, at, "".join(indent + line for line in lines))


def _flow(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}: {_flow(each)}" for name, each in value.items()) + "}"
    if isinstance(value, float):
        return f"{value:.10g}"
    # In a list, so that what needs quotes within braces has them.
    return str(yaml.safe_dump([value], default_flow_style=True, width=MAX_WIDTH)).strip()[1:-1]
