"""What `rover mal check` and `rover bundle check` do with files, whatever is in them."""

import json
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from tests.conformance.bundle import bundle
from tests.conformance.mal import mal
from tests.mal.wiretest import FILE


def check(command: click.Group, path: Path, *options: str) -> Result:
    return CliRunner().invoke(command, ["check", str(path), *options])


def check_data(command: click.Group, folder: Path, data: Any) -> Result:
    path = folder / "vectors.json"
    path.write_text(json.dumps(data))
    return check(command, path)


def specified(**members: Any) -> str:
    """The captured file without vectors, with members of its specification replaced."""
    return json.dumps({"vectors": [], "testSpecification": FILE["testSpecification"] | members})


ANY = ["", "{", "[]", "{}", '{"vectors": 1}', '{"vectors": {}}', '{"vectors": [7]}', "[" * 100_000]
BUNDLES = [
    '{"vectors": [{"hex": "0"}]}', '{"vectors": [{"hex": "", "fields": []}]}',
    '{"vectors": [{"hex": "", "fields": {"blocks": [1]}}]}',
]  # fmt: skip
MESSAGES = [
    "\xff", '{"vectors": []}', '{"vectors": [], "testSpecification": {}}',
    specified(area=3), specified(enumerations={}),
]  # fmt: skip


@pytest.mark.parametrize(
    ("command", "content"),
    [
        *((command, content) for command in (bundle, mal) for content in ANY),
        *((bundle, content) for content in BUNDLES),
        *((mal, content) for content in MESSAGES),
    ],
)
def test_an_invalid_vector_file_is_refused_in_a_line(
    tmp_path: Path, command: click.Group, content: str
) -> None:
    path = tmp_path / "vectors.json"
    path.write_text(content, encoding="latin-1")
    result = check(command, path)
    assert result.exit_code == 2
    assert result.output.startswith("Error: ")
    assert result.output.count("\n") == 1


@pytest.mark.parametrize("command", [bundle, mal])
def test_nothing_to_check_is_no_agreement(tmp_path: Path, command: click.Group) -> None:
    result = check_data(command, tmp_path, {**FILE, "vectors": []})
    assert (result.exit_code, result.output) == (1, "0 of 0 agree\n")
    missing = check(command, tmp_path / "missing.json")
    assert (missing.exit_code, missing.output.count("\n")) == (2, 1)
