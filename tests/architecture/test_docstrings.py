"""Docstrings describe attributes and arguments that exist: a rename reaches them, too."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from tests.docs.pages import CHECKOUT

PRODUCT = ("adapters", "executive", "sim", "trees")
SECTION = re.compile(r"^(?:Attributes|Args):\n((?:    .*\n?|\n)+)", re.MULTILINE)
DESCRIBED = re.compile(r"^    (\w[\w, ]*):", re.MULTILINE)


def unknown_names(path: Path) -> Iterator[str]:
    """Yield the names in sections of docstrings that the class or function does not have."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        described = "".join(SECTION.findall(ast.get_docstring(node) or ""))
        names = {each for line in DESCRIBED.findall(described) for each in line.split(", ")}
        if names:
            yield from (f"{path}: {node.name}: {each}" for each in names - set(_names_in(node)))


def _names_in(node: ast.AST) -> Iterator[str]:
    for each in ast.walk(node):
        match each:
            case ast.arg(arg=name) | ast.Attribute(attr=name) | ast.Name(id=name):
                yield name
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name
            case _:
                pass


def test_names_described_by_a_docstring_exist() -> None:
    files = [path for each in PRODUCT for path in (CHECKOUT / each).rglob("*.py")]
    assert [name for path in files for name in unknown_names(path)] == []
