"""The import contract `faces`: what a room does not export, nobody outside it imports."""

import re
from pathlib import Path
from typing import Final, cast

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output

RE_EXPORT: Final = re.compile(r"^from \S+ import (\w+) as \1$", re.MULTILINE)
"""How a name is made public, once (PEP 484); the line says in which module it is defined."""


class FacesContract(Contract):
    """A package whose `__init__` has `from … import X as X` is imported from by that face alone.

    Modules inside it import each other directly, never their own face. The packages are read below
    the working directory, where import-linter is started.

    Options:
        public: modules inside such a package that anyone may import: heavy ones, imported late,
            and those with an entry point.
    """

    type_name = "faces"

    public = fields.SetField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Find every import past a face."""
        faces = {module for module in graph.modules if _is_face(module)}
        public = cast(set[str], self.public)  # import-linter puts the value in the field's place
        past = sorted(
            (importer, imported)
            for imported in graph.modules - public
            if (room := _room_of(imported, faces)) is not None
            for importer in graph.find_modules_that_directly_import(imported)
            if _reaches_past(importer, imported, room, faces)
        )
        return ContractCheck(kept=not past, metadata={"past": past})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Name each import past a face."""
        for importer, imported in check.metadata["past"]:
            output.print_error(f"{importer} imports {imported}")


def _is_face(module: str) -> bool:
    init = Path(*module.split("."), "__init__.py")
    return init.is_file() and RE_EXPORT.search(init.read_text(encoding="utf-8")) is not None


def _room_of(module: str, faces: set[str]) -> str | None:
    """Return the innermost package with a face that holds a module, or is it."""
    while module and module not in faces:
        module = module.rpartition(".")[0]
    return module or None


def _reaches_past(importer: str, imported: str, room: str, faces: set[str]) -> bool:
    if imported == room:
        return _room_of(importer, faces) == room
    return not importer.startswith(f"{room}.") and importer != room
