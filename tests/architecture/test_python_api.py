"""The Python API has all that a script on the ground needs, and the pages use it."""

import pytest

from adapters import api
from executive.commands import all_declarations
from tests.docs.pages import CHECKOUT, blocks

PAGES = ("python-api", "command-a-rover", "fetch-a-picture")


def test_every_request_is_in_it() -> None:
    assert {each.kind.__name__ for each in all_declarations()} <= set(vars(api))


@pytest.mark.parametrize("page", PAGES)
def test_the_pages_import_nothing_beside_it(page: str) -> None:
    imports = [
        line.split()[1]
        for block in blocks(CHECKOUT / "docs" / f"{page}.md", "python")
        for line in block.splitlines()
        if line.startswith("from ")
    ]
    ours = [each for each in imports if each.split(".")[0] in {"adapters", "executive", "sim"}]
    assert ours
    assert set(ours) == {"adapters.api"}
