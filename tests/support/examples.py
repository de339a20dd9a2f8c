"""How many similar cases `rover test` runs: a part of them; all of them with `--stress`."""

import os
from typing import Final

ALL: Final = os.environ.get("EXAMPLES") == "all"
"""Set by `--stress`, which runs each file that imports this module or hypothesis."""


def examples(full: int) -> int:
    """Return the number of examples that hypothesis draws: half of them here."""
    return full if ALL else full // 2
