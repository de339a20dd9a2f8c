"""The tables of the README name tests that there are, and every test file is in them."""

import re
from pathlib import Path

FOLDER = Path(__file__).parent
README = (FOLDER / "README.md").read_text(encoding="utf-8")


def test_every_attack_of_the_tables_has_its_tests() -> None:
    rows = [line for line in README.splitlines() if line.startswith("| ") and "::test_" in line]
    assert len(rows) > 20
    for row in rows:
        file, missing = "", []
        for named in re.findall(r"`(?:([./\w]+\.py)::)?(test_\w+)`", row.split("|")[3]):
            file = named[0] or file
            if f"def {named[1]}(" not in (FOLDER / file).read_text(encoding="utf-8"):
                missing.append("::".join((file, named[1])))
        assert missing == [], row


def test_every_file_is_in_the_tables() -> None:
    files = {path.name for path in FOLDER.glob("test_*.py")} - {Path(__file__).name}
    assert files == {name for name in files if f"`{name}" in README}
