"""How many similar cases `rover test` runs: a part of them; all of them with `--stress`."""

import os
from typing import Any, Final

import pytest

ALL: Final = os.environ.get("EXAMPLES") == "all"
"""Set by `--stress`, which runs each file that imports this module or hypothesis."""


def examples(full: int) -> int:
    """Return the number of examples that hypothesis draws: half of them here."""
    return full if ALL else full // 2


def in_full(*values: Any) -> Any:
    """Return a case of a parametrised test that is left out here: its like are run."""
    return pytest.param(*values, marks=pytest.mark.skipif(not ALL, reason="with --stress"))
