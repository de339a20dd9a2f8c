"""What the process aboard does without, to stay small."""

import sys
from typing import Final

_OPENSSL: Final = ("ssl", "_hashlib")


def do_without_openssl() -> None:
    """Spare 5 MB where nothing is encrypted: asyncio and hashlib use OpenSSL, and can miss it.

    To be called before either is imported; `ssl` cannot be imported afterwards.
    """
    for module in _OPENSSL:
        sys.modules.setdefault(module, None)  # type: ignore[arg-type]
