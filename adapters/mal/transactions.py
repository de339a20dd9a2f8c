"""Numbers for transactions."""

import itertools
import secrets
import time
from collections.abc import Iterator
from typing import Final

_EPOCH_MS: Final = 1_283_299_200_000
"""2010-09-01, where the count of ESA's transaction ids begins, in ms since 1970 UTC."""


def transaction_ids() -> Iterator[int]:
    """Signed 64-bit numbers unlike any other consumer's: 40 bits ms, 8 random, 16 counter."""
    salt = secrets.randbits(8)
    for counter in itertools.count(1):
        milliseconds = time.time_ns() // 1_000_000 - _EPOCH_MS
        number = (milliseconds & 0xFFFFFFFFFF) << 24 | salt << 16 | counter & 0xFFFF
        yield number - (1 << 64) if number >> 63 else number
