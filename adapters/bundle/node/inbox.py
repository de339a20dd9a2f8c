"""Application data that has arrived, deduplicated, until the application has it."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from adapters.bundle.codec.bundle import BundleId, Part, bundle_id_from_key
from adapters.bundle.codec.eid import Eid, decode_eid, encode_eid
from adapters.bundle.node.database import Database

_GREATEST: Final = 2**62


@dataclass(frozen=True, slots=True)
class Arrival:
    """An application data unit with what belongs to it.

    Attributes:
        endpoint: to whom it was sent.
        report_to: who wants to hear what becomes of it.
        flags: which reports are wanted.
        id: its row in the store; 0 before it is there.
    """

    identity: BundleId
    endpoint: Eid
    report_to: Eid
    flags: int
    expires_utc_ms: int
    payload: bytes
    id: int = 0


class Inbox:
    """What has arrived for the endpoints of this node."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def add(self, arrival: Arrival) -> bool:
        """Add a whole unit within the transaction; return whether it came for the first time."""
        key = arrival.identity.key
        until = min(arrival.expires_utc_ms, _GREATEST)
        noted = self._db.write("INSERT OR IGNORE INTO seen VALUES (?, ?)", (key, until))
        if not noted.rowcount:
            return False
        self._db.write(
            "INSERT INTO inbox (key, endpoint, report_to, flags, expires_utc_ms, payload)"
            " VALUES (?, ?, ?, ?, ?, ?)",
            (
                key, encode_eid(arrival.endpoint), encode_eid(arrival.report_to),
                arrival.flags, until, arrival.payload,
            ),
        )  # fmt: skip
        return True

    def has_seen(self, identity: BundleId) -> bool:
        """Return whether a unit has come before."""
        return bool(self._db.read("SELECT 1 FROM seen WHERE key = ?", (identity.key,)))

    def holds(self, identity: BundleId) -> bool:
        """Return whether a unit waits for the application."""
        return bool(self._db.read("SELECT 1 FROM inbox WHERE key = ?", (identity.key,)))

    def add_fragment(
        self, identity: BundleId, part: Part, payload: bytes, expires_utc_ms: int
    ) -> bytes | None:
        """Add a fragment within the transaction; return the whole if nothing is missing now."""
        key = identity.key
        self._db.write(
            "INSERT OR IGNORE INTO fragments VALUES (?, ?, ?, ?, ?, ?)",
            (
                key, part.total, part.offset, len(payload),
                min(expires_utc_ms, _GREATEST), payload,
            ),
        )  # fmt: skip
        where = "FROM fragments WHERE key = ? AND total = ?"
        ((there,),) = self._db.read(f"SELECT sum(length) {where}", (key, part.total))
        if there < part.total:
            return None
        parts = self._db.read(f"SELECT offset, payload {where}", (key, part.total))
        whole = _reassemble(part.total, parts)
        if whole is not None:
            self._db.write("DELETE FROM fragments WHERE key = ?", (key,))
        return whole

    def arrivals(self, after: int, count: int) -> list[Arrival]:
        """Return units with ids greater than one, in the order of their coming."""
        rows = self._db.read_some(
            "SELECT id, key, endpoint, report_to, flags, expires_utc_ms, payload FROM inbox"
            " WHERE id > ? ORDER BY id LIMIT ?",
            (after, count),
        )
        return [
            Arrival(
                bundle_id_from_key(key), decode_eid(endpoint), decode_eid(report_to),
                flags, expires_utc_ms, payload, row_id,
            )
            for row_id, key, endpoint, report_to, flags, expires_utc_ms, payload in rows
        ]  # fmt: skip

    def remove(self, ids: Iterable[int]) -> None:
        """Remove units that the application has; their identities are kept for deduplication."""
        self._db.write_all("DELETE FROM inbox WHERE id = ?", [(row_id,) for row_id in ids])

    def expired(self, now_utc_ms: int, count: int) -> list[tuple[int, BundleId]]:
        """Return units that were not fetched in their lifetime."""
        rows = self._db.read(
            "SELECT id, key FROM inbox WHERE expires_utc_ms <= ? LIMIT ?", (now_utc_ms, count)
        )
        return [(row_id, bundle_id_from_key(key)) for row_id, key in rows]

    def forget(self, now_utc_ms: int) -> list[BundleId]:
        """Forget identities and fragments whose lifetime is over; return the incomplete units."""
        old = "WHERE expires_utc_ms <= ?"
        rows = self._db.read(f"SELECT DISTINCT key FROM fragments {old} LIMIT 1000", (now_utc_ms,))
        if rows:
            self._db.write(f"DELETE FROM fragments {old}", (now_utc_ms,))
        if self._db.read("SELECT 1 FROM seen WHERE until_utc_ms <= ? LIMIT 1", (now_utc_ms,)):
            self._db.write("DELETE FROM seen WHERE until_utc_ms <= ?", (now_utc_ms,))
        return [bundle_id_from_key(key) for (key,) in rows]

    def depth(self) -> int:
        """Return how many units wait for the application."""
        ((count,),) = self._db.read("SELECT count(*) FROM inbox")
        return int(count)


def _reassemble(total: int, parts: Iterable[tuple[int, bytes]]) -> bytes | None:
    """Put parts, each with its offset, together; None while octets are missing."""
    whole = bytearray()
    for offset, octets in sorted(parts):
        if offset > len(whole):
            return None
        whole += octets[len(whole) - offset :]
    return bytes(whole) if len(whole) == total else None
