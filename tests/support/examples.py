"""How many examples hypothesis draws: half as many in `rover test` as in `--stress`."""

import os


def examples(full: int) -> int:
    """Return the number of examples to draw; all with EXAMPLES=all, as `--stress` does."""
    return full if os.environ.get("EXAMPLES") == "all" else full // 2
