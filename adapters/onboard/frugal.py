"""What the process does without, to stay small: what others import only if it is there."""

import sys
from typing import Final

SPARED: Final = ("ssl",)
"""asyncio offers TLS with it (1.5 MB); the direct link is plain TCP."""


def do_without() -> None:
    """Let the imports to come miss what is not needed."""
    for module in SPARED:
        sys.modules.setdefault(module, None)  # type: ignore[arg-type]
