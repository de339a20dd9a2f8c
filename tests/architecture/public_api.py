"""The import contract `public_api`: a package is imported through the names that it exports."""

import re
from pathlib import Path
from typing import Final, cast

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output

RE_EXPORT: Final = re.compile(r"^from \S+ import (\w+) as \1$", re.MULTILINE)
"""How a name is made public, once (PEP 484); the line says in which module it is defined."""


class PublicApiContract(Contract):
    """A package with `from … import X as X` in its `__init__` is imported by these names alone.

    Modules inside it import each other directly, never through them. The packages are read below
    the working directory, where import-linter is started.

    Options:
        public: modules inside such a package that anyone may import: heavy ones, imported late,
            and those with an entry point.
    """

    type_name = "public_api"

    public = fields.SetField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Find every import past a public API."""
        packages = {module for module in graph.modules if _exports(module)}
        public = cast(set[str], self.public)  # import-linter puts the value in the field's place
        past = sorted(
            (importer, imported)
            for imported in graph.modules - public
            if (package := _package_of(imported, packages)) is not None
            for importer in graph.find_modules_that_directly_import(imported)
            if _is_past(importer, imported, package, packages)
        )
        return ContractCheck(kept=not past, metadata={"past": past})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print each import past a public API."""
        for importer, imported in check.metadata["past"]:
            output.print_error(f"{importer} imports {imported}")


def _exports(module: str) -> bool:
    init = Path(*module.split("."), "__init__.py")
    return init.is_file() and RE_EXPORT.search(init.read_text(encoding="utf-8")) is not None


def _package_of(module: str, packages: set[str]) -> str | None:
    """Return the innermost package with a public API that contains a module, or is it."""
    while module and module not in packages:
        module = module.rpartition(".")[0]
    return module or None


def _is_past(importer: str, imported: str, package: str, packages: set[str]) -> bool:
    if imported == package:
        return _package_of(importer, packages) == package
    return not importer.startswith(f"{package}.") and importer != package
