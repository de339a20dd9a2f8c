"""The product is written in the terms of its field: words that they replace become no more."""

import tomllib
from pathlib import Path

from tests.architecture.vocabulary import CEILINGS, counts, files, names_in_tests, occurrences
from tests.suite import CHECKOUT


def test_no_file_has_more_replaced_terms_than_its_ceiling() -> None:
    ceilings = tomllib.loads(CEILINGS.read_text("utf-8"))["words"]
    found = {
        str(path.relative_to(CHECKOUT)): total
        for path in files()
        if (total := counts(path).total())
    }
    more = {name: total for name, total in found.items() if total > ceilings.get(name, 0)}
    assert not more, "use the terms that python -m tests.architecture.vocabulary FILES prints"
    assert found == ceilings, "it has become fewer: run python -m tests.architecture.vocabulary"


def test_names_of_tests_are_within_their_ceilings() -> None:
    ceilings = tomllib.loads(CEILINGS.read_text("utf-8"))["names_in_tests"]
    found = names_in_tests()
    more = {name: total for name, total in found.items() if total > ceilings.get(name, 0)}
    assert not more, "use the terms that python -m tests.architecture.vocabulary FILES prints"
    assert found == ceilings, "it has become fewer: run python -m tests.architecture.vocabulary"


def test_replaced_terms_are_found_in_names_docstrings_and_messages(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        'LONGEST_S = 3\n"""How long nobody heard it."""\n\n\n'
        "def tell_who() -> str:\n    return 'it was told'  # once more\n"
    )
    found = " ".join(occurrences(path))
    assert counts(path).total() == 7
    assert "'longest' -> MAX, MIN, maximum" in found
    assert "'tell' -> report, publish, notify" in found
    assert "'once more' -> again, retransmit" in found
