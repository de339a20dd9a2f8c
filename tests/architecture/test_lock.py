"""requirements.lock: pinned, hashed, of no particular host, and in step with pyproject.toml."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

CHECKOUT = Path(__file__).resolve().parents[2]
LOCK = (CHECKOUT / "requirements.lock").read_text()
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
WANTED = [
    *PROJECT["dependencies"],
    *(line for extra in PROJECT["optional-dependencies"].values() for line in extra),
]


def entries() -> list[str]:
    """Return one string for each requirement, with the lines that belong to it."""
    text = "".join(line for line in LOCK.splitlines(keepends=True) if not line.startswith("#"))
    return re.split(r"\n(?=\S)", text.strip())


def test_every_entry_is_pinned_and_hashed() -> None:
    assert len(entries()) > 50
    for entry in entries():
        assert re.match(r"[a-z0-9-]+==\S+ (; .+ )?\\\n", entry), entry
        assert re.fullmatch(r"(\s+--hash=sha256:[0-9a-f]{64}( \\\n)?)+", entry[entry.index("\n") :])


def test_names_no_host() -> None:
    assert not re.search(r"https?:|file:|index-url|find-links|trusted-host", LOCK)


@pytest.mark.parametrize("wanted", WANTED)
def test_holds_what_pyproject_asks_for(wanted: str) -> None:
    requirement = Requirement(wanted)
    pinned = [Requirement(entry.split("\\")[0]) for entry in entries()]
    versions = [
        next(iter(pin.specifier)).version
        for pin in pinned
        if canonicalize_name(pin.name) == canonicalize_name(requirement.name)
    ]
    assert versions
    assert all(requirement.specifier.contains(version) for version in versions)
