"""How much is transferred, and in what pieces, by the MAL and by plain TCP alike."""

from typing import Final

TRANSFER_OCTETS: Final = 50_000_000
CHUNK_OCTETS: Final = 64 * 1024
