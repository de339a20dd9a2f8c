"""Mutants: one small change each of the rules by which the core decides, made in its source."""

import ast
import copy
import difflib
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum, unique
from itertools import chain, islice, zip_longest
from pathlib import Path
from random import Random
from typing import Final

PACKAGES: Final = ("executive", "trees")
NO_RULES: Final = (
    "executive/record/",  # the ledger, and what else is kept
    "executive/values/clock.py",  # time and the order of arrivals are inputs
    "executive/core/inbox.py",
    "executive/record/notifications.py",
    "executive/state/files.py",
    "executive/settings",  # those of a run are in its recording, with the rows of its faults
    "executive/faults",
    "executive/motion/minimum_time.py",  # the solver, whose plans are inputs of the core
    "executive/motion/motion_model.py",
    "executive/motion/obstacle_constraints.py",
    "executive/motion/optimal_control.py",
    "executive/values/reasons.py",  # their numbers, by which they are known to the ground
    "executive/core/recording.py",  # the recorder
    "executive/core/recorder.py",
    "trees/cli.py",
    "trees/screen.py",
    "trees/snapshot.py",
)
"""What decides nothing in a run: files, and folders."""
WITHOUT_EFFECT: Final = ("_LOG.", "assert_never(")
"""Calls that no decision depends on."""
GREATER: Final = 1.2
PROBE: Final = "_compared"
"""A function that a probe calls: it is told where it is, how is compared, and both sides."""
CLOSED: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
}  # fmt: skip
NEGATED: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


@unique
class MutantKind(Enum):
    """What is changed."""

    FLIP = "comparison or truth negated"
    CASE = "case of a match dropped"
    JUNCTION = "and for or"
    BOUND = "number 20 % greater"
    CALL = "call dropped"
    IF = "if never so"
    EDGE = "bound itself on the other side"


@dataclass(frozen=True, slots=True)
class Mutant:
    """A change of one file.

    Attributes:
        path: of the file, below the checkout.
        scope: qualified name of the function or class in which that is; empty outside of them.
        first, last: lines without which nothing changes: of the statement, or of the head of one,
            that is changed; of what would be done no more.
        within: whether that is within a function: it decides only where it is run.
        constant: the name that a module gives to it; empty where it gives none.
        start, end: octets of the source that are replaced.
        text: what replaces them.
        probe: what replaces them to find out whether the bound itself is ever met, without which
            nothing changes; empty where that is not the question.
    """

    kind: MutantKind
    path: str
    scope: str
    first: int
    last: int
    within: bool
    constant: str
    start: int
    end: int
    text: str
    probe: str = ""

    def __str__(self) -> str:
        return f"{self.path}:{self.first}: {self.kind.value}"

    @property
    def location(self) -> str:
        """Where the first octet that is replaced is; what its probe tells."""
        return f"{self.path}:{self.start}"

    def applied(self, source: bytes) -> bytes:
        """Return the source of the file, changed."""
        return source[: self.start] + self.text.encode() + source[self.end :]

    def diff(self, source: bytes) -> list[str]:
        """Return the lines that are changed, as `-` and `+`."""
        before, after = source.decode().splitlines(), self.applied(source).decode().splitlines()
        lines = list(difflib.unified_diff(before, after, n=0, lineterm=""))[3:]
        return [f"{line[0]} {line[1:].strip()}" for line in lines if line[0] in "-+"]


def sample(checkout: Path, number: int, seed: int) -> list[Mutant]:
    """Return so many mutants of a checkout, as many of each kind, by the seed."""
    found: defaultdict[MutantKind, list[Mutant]] = defaultdict(list)
    for mutant in mutants(checkout):
        found[mutant.kind].append(mutant)
    random = Random(seed)
    for each in found.values():
        random.shuffle(each)
    turns = zip_longest(*(found[kind] for kind in MutantKind))
    return list(islice(filter(None, chain.from_iterable(turns)), number))


def probes(checkout: Path) -> dict[str, tuple[bytes, list[str]]]:
    """Return sources with probes in them, by file, and which places have none.

    Of two that lie in each other only the inner one is there.
    """
    of_files: defaultdict[str, list[Mutant]] = defaultdict(list)
    for mutant in mutants(checkout):
        if mutant.probe:
            of_files[mutant.path].append(mutant)
    found = {}
    for path, there in of_files.items():
        source = (checkout / path).read_bytes()
        begun, left_out = len(source), []
        for each in sorted(there, key=lambda each: each.start, reverse=True):
            if each.end > begun:
                left_out.append(each.location)
                continue
            source = source[: each.start] + each.probe.encode() + source[each.end :]
            begun = each.start
        found[path] = source, left_out
    return found


def uses(checkout: Path, constant: str) -> dict[str, set[int]] | None:
    """Return the lines of functions that use a constant; None where modules or classes do, too."""
    found: dict[str, set[int]] = {}
    for package in PACKAGES:
        for path in sorted((checkout / package).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            if not re.search(rf"\b{constant}\b", source):
                continue
            finder = _Uses(constant)
            finder.visit(ast.parse(source))
            if finder.at_import:
                return None
            found[path.relative_to(checkout).as_posix()] = finder.lines
    return found


class _Uses(ast.NodeVisitor):
    def __init__(self, constant: str) -> None:
        self.lines: set[int] = set()
        self.at_import = False
        self._constant = constant
        self._depth = 0

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.visit(node.args)
        self._depth += 1
        for part in node.body:
            self.visit(part)
        self._depth -= 1

    def visit_Name(self, node: ast.Name) -> None:
        if node.id == self._constant and isinstance(node.ctx, ast.Load):
            self.lines.add(node.lineno)
            self.at_import = self.at_import or self._depth == 0


def mutants(checkout: Path) -> Iterator[Mutant]:
    """Yield all mutants, file by file."""
    for package in PACKAGES:
        for path in sorted((checkout / package).rglob("*.py")):
            name = path.relative_to(checkout).as_posix()
            if not name.startswith(NO_RULES):
                yield from _Finder(name, path.read_bytes()).found


@dataclass(frozen=True, slots=True)
class _Location:
    """Where a node stands: the lines of its statement, whether in a function, and what it sets."""

    first: int
    last: int
    within: bool
    constant: str = ""


class _Finder(ast.NodeVisitor):
    """Finds the mutants of a file."""

    def __init__(self, path: str, source: bytes) -> None:
        self.found: list[Mutant] = []
        self._path = path
        self._source = source
        self._lines = [0]
        for line in source.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))
        self._location = _Location(1, 1, within=False)
        self._scope: tuple[str, ...] = ()
        self._in_class = False
        self.visit(ast.parse(source))

    def visit(self, node: ast.AST) -> None:
        """Look at a node, and at all below it."""
        if isinstance(node, ast.stmt):
            within = self._location.within
            constant = "" if within or self._in_class else _target(node)
            self._location = _Location(node.lineno, _end_of_head(node), within, constant)
        super().visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Look into a function: what stands in its head is run where it is defined."""
        outer, outer_scope = self._location, self._scope
        self._scope = (*outer_scope, node.name)
        self.visit(node.args)
        self._location = _Location(node.lineno, node.lineno, within=True)
        for part in node.body:
            self.visit(part)
            self._location = _Location(node.lineno, node.lineno, within=True)
        self._location, self._scope = outer, outer_scope

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Look into a class, but not at what makes a dataclass of it."""
        outer, outer_scope = self._in_class, self._scope
        self._in_class, self._scope = True, (*outer_scope, node.name)
        for part in node.body:
            self.visit(part)
        self._in_class, self._scope = outer, outer_scope

    def visit_keyword(self, node: ast.keyword) -> None:
        """Leave out checks of those who wrote the code."""
        if node.arg != "strict":
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Leave out the annotation."""
        if node.value is not None:
            self.visit(node.value)

    def visit_arg(self, node: ast.arg) -> None:
        """Leave out the annotation."""

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Leave out texts: what is in them has no place of its own before Python 3.12."""

    def visit_Raise(self, node: ast.Raise) -> None:
        """Leave out errors of those who wrote the code."""

    def visit_Compare(self, node: ast.Compare) -> None:
        """Negate a comparison; have its bound on the other side."""
        if len(node.ops) == 1:
            kind = type(node.ops[0])
            self._replace(MutantKind.FLIP, node, _with(node, ops=[NEGATED[kind]()]))
            if kind in CLOSED:
                other = ast.unparse(_with(node, ops=[CLOSED[kind]()]))
                self._put(MutantKind.EDGE, node, other, self._probe(node))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """Leave out a `not`."""
        if isinstance(node.op, ast.Not):
            self._put(MutantKind.FLIP, node, f"bool({ast.unparse(node.operand)})")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """Have all where one was enough, and one where it took all."""
        other = ast.And() if isinstance(node.op, ast.Or) else ast.Or()
        self._put(MutantKind.JUNCTION, node, f"({ast.unparse(_with(node, op=other))})")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """Negate a truth, enlarge a number."""
        match node.value:
            case bool(value):
                self._put(MutantKind.FLIP, node, str(not value))
            case float(value) if value != 0.0 and math.isfinite(value):
                self._put(MutantKind.BOUND, node, repr(value * GREATER))
            case int(value) if value > 1:
                self._put(MutantKind.BOUND, node, repr(math.ceil(value * GREATER)))

    def visit_Expr(self, node: ast.Expr) -> None:
        """Leave out a call whose result nobody takes."""
        if isinstance(node.value, ast.Call):
            if ast.unparse(node.value).startswith(WITHOUT_EFFECT):
                return
            self._put(MutantKind.CALL, node, "pass")
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        """Never do what is done under a condition."""
        if ast.unparse(node.test) != "TYPE_CHECKING":
            with self._done_in(node.body):
                self._put(MutantKind.IF, node.test, "False")
        self.generic_visit(node)

    def visit_match_case(self, node: ast.match_case) -> None:
        """Leave out a case."""
        outer = self._location
        self._location = _Location(node.pattern.lineno, node.pattern.end_lineno or 0, outer.within)
        if not ast.unparse(node.body[0]).startswith(WITHOUT_EFFECT):
            with self._done_in(node.body):
                if node.guard is None:
                    end = self._at(node.pattern.end_lineno, node.pattern.end_col_offset)
                    self._add(MutantKind.CASE, end, end, " if False")
                else:
                    self._put(MutantKind.CASE, node.guard, "False")
        self.generic_visit(node)
        self._location = outer

    @contextmanager
    def _done_in(self, body: Sequence[ast.stmt]) -> Iterator[None]:
        outer, first = self._location, body[0]
        self._location = replace(outer, first=first.lineno, last=_end_of_head(first))
        yield
        self._location = outer

    def _replace(self, kind: MutantKind, node: ast.expr, other: ast.expr) -> None:
        self._put(kind, node, ast.unparse(other))

    def _probe(self, node: ast.Compare) -> str:
        start = self._at(node.lineno, node.col_offset)
        left, (right,), (operator,) = node.left, node.comparators, node.ops
        sides = f"{ast.unparse(left)}, {ast.unparse(right)}"
        lines = "\n" * ((node.end_lineno or node.lineno) - node.lineno)
        location = f"{self._path}:{start}"  # as of the mutant
        return f"{PROBE}({location!r}, {type(operator).__name__.lower()!r}, {sides}{lines})"

    def _put(self, kind: MutantKind, node: ast.expr | ast.stmt, text: str, probe: str = "") -> None:
        start = self._at(node.lineno, node.col_offset)
        self._add(kind, start, self._at(node.end_lineno, node.end_col_offset), text, probe)

    def _add(self, kind: MutantKind, start: int, end: int, text: str, probe: str = "") -> None:
        location = self._location
        self.found.append(
            Mutant(
                kind,
                self._path,
                ".".join(self._scope),
                location.first,
                location.last,
                location.within,
                location.constant,
                start,
                end,
                text,
                probe,
            )
        )

    def _at(self, line: int | None, column: int | None) -> int:
        assert line is not None
        assert column is not None
        return self._lines[line - 1] + column


def _with(node: ast.expr, **changed: object) -> ast.expr:
    other = copy.copy(node)
    for name, value in changed.items():
        setattr(other, name, value)
    return other


def _target(node: ast.stmt) -> str:
    """Return the name that a statement gives to what it makes; empty if it gives none."""
    match node:
        case ast.Assign(targets=[ast.Name(name)]) | ast.AnnAssign(target=ast.Name(name)):
            return name
        case _:
            return ""


def _end_of_head(node: ast.stmt) -> int:
    """Return the last line of a statement, or of its head where others are in it."""
    body: Sequence[ast.AST] = getattr(node, "body", ()) or getattr(node, "cases", ())
    if not body:
        return node.end_lineno or node.lineno
    first = body[0]
    inner = first.pattern if isinstance(first, ast.match_case) else first
    return max(node.lineno, getattr(inner, "lineno", node.lineno) - 1)
