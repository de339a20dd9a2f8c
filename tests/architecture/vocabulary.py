"""Counts words replaced by the terms of the field: in each file, and in the names of tests.

`python -m tests.architecture.vocabulary` writes the counts to vocabulary.toml, which
`test_vocabulary.py` holds; with paths as arguments it lists the occurrences in these files.
"""

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import Final

from tests.suite import CHECKOUT

CEILINGS: Final = Path(__file__).with_name("vocabulary.toml")


class Kind(Enum):
    """Where a word stands."""

    NAME = "name"
    DOCSTRING = "docstring or comment"
    MESSAGE = "message"
    PAGE = "page or YAML"
    UI = "JavaScript or HTML"


_SUFFIXES: Final = {
    ".py": None,
    ".md": Kind.PAGE,
    ".yaml": Kind.PAGE,
    ".js": Kind.UI,
    ".html": Kind.UI,
}
_NOT_COUNTED: Final = re.compile(
    r"^tests/|/vendor/|/migrations/|spec/types\.py$|^CHANGELOG|^changelog\.d/|^docs/mrs\.md$"
)
_FROM_OUTSIDE: Final = {"tell"}
"""Whole names that interfaces from outside require: `io.IOBase.tell`."""
REPLACED: Final = {
    "report, publish, notify": r"\b(told|tells?|telling)\b",
    "receive, last contact": r"\b(heard|hears?|hearing)\b",
    "report, state, give": r"\b(said|says?|saying)\b",
    "request, query": r"\b(asks?|asked|asking)\b",
    "the noun": r"\bwhat (is|was|are|were|has|had|it|they|comes?|goes|a|an|the|of|others?"
    r"|nobody|somebody)\b",
    "operator, sender, client": r"\bwho(ever|se|m)?\b",
    "no operator, no subscriber": r"\b(nobody|somebody|anybody|everybody)\b",
    "obstacle, value, object": r"\b(something|anything)\b",
    "arrives, is received": r"\b(comes?(?! to)|came|coming)\b",
    "reaches, ends at": r"\b(leads?|led|leading) "
    r"(to|there|from|on|through|around|out|into|too|nowhere)\b",
    "receive, add, merge": r"\b(takes?|took|taken|taking) in\b",
    "treated as, recover": r"\b(takes?|took|taken|taking) (for|over|up|off|back|on)\b",
    "is stationary, is stored": r"\b(stands?|stood)\b",
    "result": r"\b(becomes?|became|become) of\b",
    "store, retain, save": r"\b(kept|keeps?|keeping)\b(?! ?-?(in|out|alive))",
    "poll, check, read": r"\blook(s|ed|ing)?\b(?! up|-up|-around|-at/)",
    "continue": r"\b(go|goes|went|going|gone) on\b",
    "abort, expire, lost": r"\b(gives?|given|gave|giving) (up|way|back)\b",
    "release": r"\blets? go\b",
    "closed, disconnected": r"\bgone\b",
    "except": r"\bbut (for|of|in|by)\b",
    "two sentences": r"\b(of|by|in|to|for|from|with|under|at|on) (which|whom)\b",
    "the figure": r"\bso (many|much|long|far|little|often)\b",
    "again, retransmit": r"\b(once more|again and again|anew|over again)\b",
    "no longer": r"\b(any ?more|no more)\b",
    "any, regardless of": r"\b(whatever|whichever|wherever)\b",
    "during, recently": r"\b(meanwhile|lately|betimes|afterwards)\b",
    "over the relay, on another host": r"\b(elsewhere|by another way|another way)\b",
    "human-readable": r"\bfor people\b",
    "Raise ... unless": r"\bDo nothing (where|if|while)\b",
    "package, public API, space": r"\b(rooms?|faces?)\b",
    "text, format": r"\bwords\b",
    "change, new": r"\bnews\b",
    "unknown, avoid, predict": r"\b(doubt\w*|unsure|heed\w*|evad\w*|amiss|abreast|foret(ell|old)\w*"
    r"|(?<!dead )(?<!dead-)reckon\w*|chronicles?|journeys?|souvenirs?)\b",
    "path, distance, direction": r"(?<!one-)(?<!two-)(?<!one )\bways?\b",
    "position, waypoint, location": r"(?<!in )(?<!takes )(?<!take )(?<!decimal )\bplaces?\b",
    "contact, heartbeat": r"\bsigns? (of|from|that)\b",
    "MAX, MIN, maximum": r"(?<!at )\b(most|fewest|longest(?! tick)|shortest(?! (path|form|detour))"
    r"|farthest|greatest|highest|largest|smallest|steepest|finest|oldest(?! (first|age)))\b",
    "life cycle, run, start": r"\b(life|lives|lived)\b(?![ -]cycle)",
    "British spelling": r"\b(behavior|centered|honor|(label|cancel|travel|model)(ed|ing)"
    r"|(?<!not )initializ\w+|(recogn|synchron)iz\w+)\b",
}
_PATTERNS: Final = {use: re.compile(pattern, re.I) for use, pattern in REPLACED.items()}


def _split_name(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).replace("_", " ").lower()


def _names(nodes: list[ast.AST]) -> Iterator[str]:
    for node in nodes:
        match node:
            case (
                ast.ClassDef(name=name)
                | ast.FunctionDef(name=name)
                | ast.AsyncFunctionDef(name=name)
            ) if name not in _FROM_OUTSIDE:
                yield _split_name(name)
            case (
                ast.arg(arg=name)
                | ast.Name(id=name, ctx=ast.Store())
                | ast.Attribute(attr=name, ctx=ast.Store())
            ):
                yield _split_name(name)
            case _:
                pass


def _python_texts(source: str) -> Iterator[tuple[Kind, str]]:
    nodes = list(ast.walk(ast.parse(source)))
    yield from ((Kind.NAME, name) for name in _names(nodes))
    docstrings = set[int]()
    for node in nodes:
        match node:
            case ast.Expr(value=ast.Constant(value=str(text)) as constant):
                docstrings.add(id(constant))
                yield Kind.DOCSTRING, text
            case ast.Constant(value=str(text)) if " " in text and id(node) not in docstrings:
                yield Kind.MESSAGE, text
            case _:
                pass
    # Most time would be spent on tokens: only of files with a word behind a "#".
    behind = "\n".join(line.partition("#")[2] for line in source.splitlines())
    if any(pattern.search(behind) for pattern in _PATTERNS.values()):
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type == tokenize.COMMENT:
                yield Kind.DOCSTRING, token.string


def texts(path: Path) -> Iterator[tuple[Kind, str]]:
    """Yield names, docstrings, messages or the whole text of a file, by kind."""
    source = path.read_text("utf-8")
    kind = _SUFFIXES[path.suffix]
    if kind is None:
        yield from _python_texts(source)
    else:
        yield kind, source


def files(checkout: Path = CHECKOUT) -> Iterator[Path]:
    """Yield the product's files that are counted."""
    for name in subprocess.check_output(["git", "ls-files"], cwd=checkout, text=True).splitlines():
        path = checkout / name
        if path.suffix in _SUFFIXES and not _NOT_COUNTED.search(name) and path.is_file():
            yield path


def counts(path: Path) -> Counter[Kind]:
    """Return how many replaced words a file has, by kind."""
    by_kind: dict[Kind, list[str]] = {}
    for kind, text in texts(path):
        by_kind.setdefault(kind, []).append(text)
    return Counter({kind: hits for kind, found in by_kind.items() if (hits := _hits(found))})


def _hits(found: Iterable[str]) -> int:
    text = "\n".join(found)
    return sum(len(pattern.findall(text)) for pattern in _PATTERNS.values())


def occurrences(path: Path) -> Iterator[str]:
    """Yield each replaced word of a file: its kind, the line, and the terms to use."""
    for kind, text in texts(path):
        for line in text.splitlines():
            for use, pattern in _PATTERNS.items():
                if found := pattern.search(line):
                    yield f"{path}: {kind.value}: {line.strip()!r}: {found[0]!r} -> {use}"


def names_in_tests(checkout: Path = CHECKOUT) -> Counter[str]:
    """Return how many replaced words the names in each folder of tests have."""
    listed = subprocess.check_output(["git", "ls-files", "tests/*.py"], cwd=checkout, text=True)
    found = Counter[str]()
    for path in map(Path, listed.splitlines()):
        if (checkout / path).is_file():
            nodes = ast.walk(ast.parse((checkout / path).read_text("utf-8")))
            found[path.parts[1]] += _hits(_names(list(nodes)))
    return +found


def _main(paths: list[str]) -> None:
    if paths:
        for name in paths:
            print("\n".join(occurrences(Path(name))))
        return
    lines, sums = [], Counter[Kind]()
    for path in files():
        if found := counts(path):
            lines.append(f'"{path.relative_to(CHECKOUT)}" = {found.total()}\n')
            sums += found
    lines.append("\n[names_in_tests]\n")
    lines += (f'"{folder}" = {total}\n' for folder, total in sorted(names_in_tests().items()))
    CEILINGS.write_text("[words]\n" + "".join(lines), encoding="utf-8")
    print(", ".join(f"{kind.value} {sums[kind]}" for kind in Kind), "all", sums.total())


if __name__ == "__main__":
    _main(sys.argv[1:])
