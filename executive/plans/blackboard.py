"""`CellTable` numbers the variables of a plan when it is read; `Scope` resolves their names.

Each tree has names of its own. A `SubTree` sets some of them to literals, remaps others to the tree
above, or with `_autoremap` all that it does not set. `@name` is a name of the root.
"""

from executive.plans.dialect import TELEMETRY
from executive.plans.model import Blackboard
from executive.plans.scripting import NUMBER, Types, type_of, value_of
from executive.plans.syntax import CONSTANTS, ArgumentError, Value

_MAX_NAME_LENGTH = 64


class CellTable:
    """The cells of one plan.

    Attributes:
        names: name of each cell, after the path of its tree.
        texts: text of each cell that begins with a value.
        telemetry: name of the telemetry in a cell.
        created: cells that a node or a script creates, beside their initial value.
    """

    def __init__(self) -> None:
        self.texts: list[str | None] = []
        self.telemetry: dict[int, str] = {}
        self.created: set[int] = set()
        self.changed: set[int] = set()
        self.names: list[str] = []

    def add(self, name: str, text: str | None = None) -> int:
        """Add a cell, with its initial text if any; return its number."""
        self.names.append(name)
        self.texts.append(text)
        return len(self.names) - 1

    @property
    def initial(self) -> tuple[Value | None, ...]:
        """The value of each cell when the plan begins."""
        return tuple(None if text is None else value_of(text) for text in self.texts)

    def constant(self, cell: int) -> str | None:
        """Return the text of a cell that nothing changes; None for all others."""
        return None if cell in self.changed else self.texts[cell]

    def has_value(self, cell: int) -> bool:
        """Return whether a literal, a node or telemetry sets a cell."""
        return self.texts[cell] is not None or cell in self.created or cell in self.telemetry

    def types(self) -> Types:
        """Return the types of the cells as far as their initial values determine them."""
        found: Types = [None if value is None else type_of(value) for value in self.initial]
        for cell in self.telemetry:
            found[cell] = NUMBER
        return found

    def blackboard(self, types: Types) -> Blackboard:
        """Return the cells as the plan begins, with their types."""
        numbers = frozenset(cell for cell, type_ in enumerate(types) if type_ is NUMBER)
        telemetry = tuple(sorted(self.telemetry.items()))
        return Blackboard(tuple(self.names), self.initial, telemetry, numbers)


class Scope:
    """The names of one tree.

    Args:
        label: prefix of the names of its cells.
        above: the scope of the tree above; None for the root.
        autoremap: whether names that it does not set are those of the tree above.
    """

    def __init__(
        self,
        cells: CellTable,
        label: str = "",
        above: "Scope | None" = None,
        autoremap: bool = False,
    ) -> None:
        self.cells = cells
        self._root: Scope = self if above is None else above._root
        self.used: set[str] = set()
        self.measured: set[str] = set()
        self._label = label
        self._above = above
        self._autoremap = autoremap
        self._own: dict[str, int] = {}
        self._remapped: dict[str, str] = {}

    def set(self, name: str, text: str) -> None:
        """Set a name to a literal, or remap it to a name `{outer}` of the tree above."""
        outer = variable(text, name)
        if outer is not None and self._above is not None:
            self._remapped[name] = outer
        else:
            self._own[name] = self.cells.add(f"{self._label}{name}", text)

    def resolve(self, name: str) -> int:
        """Return the cell of a name.

        Raises:
            ArgumentError: no variable can have this name.
        """
        if name.startswith("@"):
            self._root.measured.add(name[1:])
            return self._root.resolve(name[1:])
        if not name or len(name) > _MAX_NAME_LENGTH or not name.isprintable():
            raise ArgumentError(f"{name[:40]!r} is no name of a variable")
        if name in CONSTANTS:
            raise ArgumentError(f"{name} is a constant, and no name of a variable")
        self.used.add(name)
        if name in self._own:
            return self._own[name]
        if self._above is not None:
            if name in self._remapped:
                return self._above.resolve(self._remapped[name])
            if self._autoremap and not name.startswith("_"):
                return self._above.resolve(name)
        cell = self._own[name] = self.cells.add(f"{self._label}{name}")
        if self._above is None and name in TELEMETRY:
            self.cells.telemetry[cell] = name
        return cell

    def cell_of(self, attribute: str, name: str) -> int:
        """Return the cell of a name in an attribute, which an error names.

        Raises:
            ArgumentError: no variable can have this name.
        """
        try:
            return self.resolve(name)
        except ArgumentError as error:
            raise ArgumentError(f"{attribute}: {error}") from error


def variable(text: str, attribute: str) -> str | None:
    """Return the name in braces that an attribute refers to; None for a literal."""
    if not (text.startswith("{") and text.endswith("}") and len(text) > 1):
        return None
    return attribute if text == "{=}" else text[1:-1]
