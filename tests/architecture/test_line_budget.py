"""The lines of each package stay within a budget that a commit raises on purpose.

Lines of Python, JavaScript, HTML and CSS count, blank ones and docstrings included; vendored and
generated files do not.
"""

import tomllib
from collections import Counter
from itertools import chain
from pathlib import Path

from tests.suite import CHECKOUT

BUDGET = Path(__file__).with_name("line_budget.toml")
PRODUCT = ("adapters", "executive", "sim", "trees")
COUNTED = {".py", ".js", ".html", ".css"}
NOT_OURS = ("/vendor/", "/mrs/spec/types.py")
SLACK_RATIO = 0.03
"""A package that becomes smaller by more than this lowers its budget: what is saved stays saved."""


def package_of(path: Path) -> str:
    """Return the package that a file is counted for: `adapters/mrs`, `sim/rover`, `trees`."""
    return "/".join(path.parent.parts[:2])


def lines_by_package(checkout: Path = CHECKOUT) -> Counter[str]:
    found = Counter[str]()
    for path in chain.from_iterable((checkout / top).rglob("*") for top in PRODUCT):
        name = path.relative_to(checkout)
        if path.suffix in COUNTED and not any(part in f"/{name}" for part in NOT_OURS):
            found[package_of(name)] += len(path.read_text("utf-8").splitlines())
    return found


def test_each_package_is_within_its_budget() -> None:
    budget = tomllib.loads(BUDGET.read_text())["lines"]
    found = lines_by_package()
    assert found.keys() == budget.keys(), "line_budget.toml has a row for each package"
    wrong = {
        f'"{name}" = {lines}'
        for name, lines in found.items()
        if not budget[name] * (1 - SLACK_RATIO) <= lines <= budget[name]
    }
    assert not wrong, "if that is on purpose, write into line_budget.toml"


def test_a_line_more_is_found(tmp_path: Path) -> None:
    (tmp_path / "sim" / "rover").mkdir(parents=True)
    (tmp_path / "sim" / "rover" / "body.py").write_text("a = 1\nb = 2\n")
    assert lines_by_package(tmp_path) == {"sim/rover": 2}
