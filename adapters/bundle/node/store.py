"""The parts of the store: `Outbox` of bundles to send, `BundleInbox` of received data."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from adapters.bundle.codec.bundle import (
    BundleId,
    FragmentRange,
    Primary,
    bundle_id_from_key,
    decode_bundle,
    identity_of,
)
from adapters.bundle.codec.eid import NONE, Eid, decode_eid, encode_eid
from adapters.bundle.node.database import BundleDatabase

_MAX_ID: Final = 2**62
_MAX_DOUBLINGS: Final = 5
"""Maximum doublings of the retransmission pause: a link that lost many may have been back long."""
_FORGET_BATCH: Final = 1000
"""Maximum number of incomplete units removed in one transaction."""


class OutboxState(IntEnum):
    """Progress of a bundle: not yet with the next node, or there and not yet confirmed."""

    WAITING = 0
    HANDED_ON = 1


@dataclass(frozen=True, slots=True)
class OutboxEntry:
    """A bundle in the outbox.

    Attributes:
        neighbour: name of the neighbour it is sent to.
        own: whether it was created here, not received for forwarding.
        confirm: whether it is retained until its receiver reports the delivery.
        put_utc_ms: time of its entry into the store.
        expedited: whether it is sent before others.
    """

    id: int
    neighbour: str
    identity: BundleId
    own: bool
    confirm: bool
    put_utc_ms: int
    octets: bytes
    expedited: bool = False


@dataclass(frozen=True, slots=True)
class Queued:
    """Application data sent from here that are still in the store.

    Attributes:
        payload: the application data.
        expires_utc_s: end of the lifetime.
    """

    identity: BundleId
    payload: bytes
    expires_utc_s: float


class Outbox:
    """Bundles to send, for each neighbour in order of arrival; expedited ones first.

    Args:
        pause_ms: delay of the first retransmission of an unconfirmed bundle, by neighbour name.
            It doubles at each repetition, up to 32 times this value.
    """

    def __init__(self, database: BundleDatabase, pause_ms: Mapping[str, int]) -> None:
        self._db, self._pause_ms = database, pause_ms
        self._read_to_the_end: dict[tuple[str, bool], tuple[int, int]] = {}
        self._checked_utc_ms = _MAX_ID

    def add(
        self, primary: Primary, neighbour: str, octets: bytes, *,
        own: bool, confirm: bool, now_utc_ms: int, expires_utc_ms: int, expedited: bool = False,
    ) -> None:  # fmt: skip
        """Add a bundle, given by its primary block and octets, within the transaction."""
        self._read_to_the_end.pop((neighbour, expedited), None)
        self._db.write(
            "INSERT INTO outbox (key, destination, neighbour, state, confirm, put_utc_ms,"
            " expires_utc_ms, own, expedited, octets) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                identity_of(primary).key, encode_eid(primary.destination), neighbour,
                OutboxState.WAITING.value, confirm, now_utc_ms, min(expires_utc_ms, _MAX_ID), own,
                expedited, octets,
            ),
        )  # fmt: skip

    def waiting(
        self, neighbour: str, after: int, count: int, now_utc_ms: int, *, expedited: bool = False
    ) -> list[OutboxEntry]:
        """Return bundles that wait for a neighbour, with ids above `after`, in order.

        Expired bundles are omitted: the next node would delete them without a report. Only
        expedited ones do not wait for the disk.
        """
        bounds = after, _MAX_ID if expedited else self._db.durable["outbox"]
        if self._read_to_the_end.get((neighbour, expedited)) == bounds:
            return []  # links query at each segment that they receive
        rows = self._db.read_some(
            "SELECT id, key, own, confirm, put_utc_ms, octets FROM outbox"
            " WHERE neighbour = ? AND state = ? AND id > ? AND id <= ? AND expires_utc_ms > ?"
            f" AND {'' if expedited else 'NOT '}expedited ORDER BY id LIMIT ?",
            (neighbour, OutboxState.WAITING.value, *bounds, now_utc_ms, count),
        )
        if not rows:
            self._read_to_the_end[neighbour, expedited] = bounds
        return [
            OutboxEntry(
                row_id, neighbour, bundle_id_from_key(key), bool(own), bool(confirm), put_utc_ms,
                octets, expedited,
            )
            for row_id, key, own, confirm, put_utc_ms, octets in rows
        ]  # fmt: skip

    def mark_forwarded(self, bundles: Sequence[OutboxEntry], now_utc_ms: int) -> None:
        """Record that the next node has these: remove them, or retain them until confirmed."""
        self.remove(stored.id for stored in bundles if not stored.confirm)
        self._db.write_all(
            "UPDATE outbox SET state = ?,"
            f" again_utc_ms = ? + ? * (1 << min(tries, {_MAX_DOUBLINGS})),"
            " tries = tries + 1 WHERE id = ?",
            [
                (
                    OutboxState.HANDED_ON.value,
                    now_utc_ms,
                    self._pause_ms[stored.neighbour],
                    stored.id,
                )
                for stored in bundles
                if stored.confirm
            ],
        )

    def remove(self, ids: Iterable[int]) -> None:
        """Remove the bundles with these row ids."""
        self._db.write_all("DELETE FROM outbox WHERE id = ?", [(row_id,) for row_id in ids])

    def ids(self, identity: BundleId) -> list[int]:
        """Return the row ids of an own bundle; more than one only if it was fragmented."""
        rows = self._db.read("SELECT id FROM outbox WHERE key = ? AND own", (identity.key,))
        return [row_id for (row_id,) in rows]

    def queued(self, destination: Eid) -> Iterator[Queued]:
        """Yield the payloads sent from here to a destination, the newest first."""
        before = _MAX_ID
        while rows := self._db.read(
            "SELECT id, key, expires_utc_ms, octets FROM outbox WHERE own AND destination = ?"
            " AND id < ? ORDER BY id DESC LIMIT 32",
            (encode_eid(destination), before),
        ):
            for _, key, expires_utc_ms, octets in rows:
                payload = decode_bundle(octets).payload
                yield Queued(bundle_id_from_key(key), payload, expires_utc_ms / 1000)
            before = rows[-1][0]

    def requeue_unconfirmed(self, now_utc_ms: int) -> list[str]:
        """Requeue bundles with an overdue confirmation.

        If the clock was set back, even while no process ran, each waits at most for its pause from
        now on.

        Returns:
            The neighbour of each.
        """
        if now_utc_ms < self._checked_utc_ms and self._db.read(
            "SELECT 1 FROM outbox WHERE again_utc_ms IS NOT NULL LIMIT 1"
        ):
            self._db.write_all(
                "UPDATE outbox SET again_utc_ms = min(again_utc_ms,"
                f" ? + ? * (1 << min(tries - 1, {_MAX_DOUBLINGS})))"
                " WHERE again_utc_ms IS NOT NULL AND neighbour = ?",
                [(now_utc_ms, pause, neighbour) for neighbour, pause in self._pause_ms.items()],
            )
        self._checked_utc_ms = now_utc_ms
        found = self._db.read(
            "SELECT id, neighbour FROM outbox WHERE again_utc_ms <= ? AND state = ? LIMIT 1000",
            (now_utc_ms, OutboxState.HANDED_ON.value),
        )
        if found:
            self._db.write_all(
                "UPDATE outbox SET state = 0, again_utc_ms = NULL WHERE id = ?",
                [(row_id,) for row_id, _ in found],
            )
            self._read_to_the_end.clear()
        return [neighbour for _, neighbour in found]

    def expired(self, now_utc_ms: int, count: int) -> list[tuple[int, BundleId, bytes]]:
        """Return expired bundles as (row id, identity, octets)."""
        rows = self._db.read_some(
            "SELECT id, key, octets FROM outbox WHERE expires_utc_ms <= ?"
            " ORDER BY expires_utc_ms LIMIT ?",
            (now_utc_ms, count),
        )
        return [(row_id, bundle_id_from_key(key), octets) for row_id, key, octets in rows]

    def reroute(self, neighbour_of: Callable[[Eid], str]) -> None:
        """Assign each destination to its neighbour by the present settings, and commit."""
        rows = self._db.read("SELECT DISTINCT destination, neighbour FROM outbox")
        for destination, neighbour in rows:
            if (now := neighbour_of(decode_eid(destination))) != neighbour:
                self._db.write(
                    "UPDATE outbox SET neighbour = ? WHERE destination = ? AND neighbour = ?",
                    (now, destination, neighbour),
                )
        self._db.commit()

    def depth(self, neighbour: str | None = None) -> int:
        """Return the number of bundles that wait, for one neighbour or for all."""
        where, values = ("", ()) if neighbour is None else (" WHERE neighbour = ?", (neighbour,))
        ((count,),) = self._db.read(f"SELECT count(*) FROM outbox{where}", values)
        return int(count)

    def octets(self, neighbour: str) -> int:
        """Return the octets that wait for a neighbour, or for a confirmation."""
        ((octets,),) = self._db.read(
            "SELECT total(length(octets)) FROM outbox WHERE neighbour = ?", (neighbour,)
        )
        return int(octets)

    def earliest_utc_ms(self) -> int | None:
        """Return the arrival time of the first bundle in the outbox, or None."""
        rows = self._db.read("SELECT put_utc_ms FROM outbox ORDER BY id LIMIT 1")
        return int(rows[0][0]) if rows else None


@dataclass(frozen=True, slots=True)
class Delivery:
    """Received application data.

    Attributes:
        endpoint: destination EID.
        payload: the application data.
        expedited: whether it is delivered before others.
        report_to: EID that status reports go to.
        flags: status reports that are requested, a sum of `Flag`s.
        id: its row in the store; 0 before it is stored.
    """

    identity: BundleId
    endpoint: Eid
    payload: bytes
    expedited: bool = False
    report_to: Eid = NONE
    flags: int = 0
    expires_utc_ms: int = 0
    id: int = 0

    @property
    def source(self) -> Eid:
        """Source EID."""
        return self.identity.source


class BundleInbox:
    """Units received for the endpoints of this node."""

    def __init__(self, database: BundleDatabase) -> None:
        self._db = database
        self._has_expedited = True
        self._held: Counter[bytes] = Counter()
        self._count_fragments()

    def add(self, delivery: Delivery) -> bool:
        """Add a complete unit within the transaction; return False for a duplicate."""
        key = delivery.identity.key
        until = min(delivery.expires_utc_ms, _MAX_ID)
        noted = self._db.write("INSERT OR IGNORE INTO seen VALUES (?, ?)", (key, until))
        if not noted.rowcount:
            return False
        self._db.write(
            "INSERT INTO inbox (key, endpoint, report_to, flags, expires_utc_ms, expedited,"
            " payload) VALUES (?, ?, ?, ?, ?, ?, ?)",
            (
                key, encode_eid(delivery.endpoint), encode_eid(delivery.report_to),
                delivery.flags, until, delivery.expedited, delivery.payload,
            ),
        )  # fmt: skip
        self._has_expedited |= delivery.expedited
        return True

    def has_seen(self, identity: BundleId) -> bool:
        """Return whether a unit was received before."""
        return bool(self._db.read("SELECT 1 FROM seen WHERE key = ?", (identity.key,)))

    def holds(self, identity: BundleId) -> bool:
        """Return whether a unit waits for the application."""
        return bool(self._db.read("SELECT 1 FROM inbox WHERE key = ?", (identity.key,)))

    @property
    def max_fragment_octets(self) -> int:
        """Space that the fragments of one source may use: a quarter of the store."""
        return self._db.capacity_octets // 4

    def evict_fragments(self, identity: BundleId, octets: int) -> list[BundleId]:
        """Evict incomplete units by age if a fragment would exceed its source's share.

        Fragments of one source may use a quarter of the store, those of all sources half of it.

        Returns:
            The units that were evicted.
        """
        source, limit = encode_eid(identity.source), self.max_fragment_octets
        dropped: list[BundleId] = []
        if self._held[source] + octets > limit:
            dropped += self._drop_first(source, identity.key, octets)
        if self._held.total() + octets > 2 * limit:
            (fullest, _), *_ = self._held.most_common(1)
            dropped += self._drop_first(fullest, identity.key, octets)
        return dropped

    def _drop_first(self, source: bytes, last: bytes, octets: int) -> list[BundleId]:
        """Evict incomplete units of a source: an eighth of its share, so that this is rare.

        The unit of the new fragment is evicted last: only overlapping fragments make it so long.
        """
        wanted, dropped = octets + self.max_fragment_octets // 8, list[BundleId]()
        rows = self._db.read(
            "SELECT key, sum(length) FROM fragments WHERE key BETWEEN ? AND ?"
            " GROUP BY key ORDER BY key = ?, min(rowid)",
            (source, source + b"\xff" * 9, last),
        )
        for key, length in rows:
            if wanted <= 0:
                break
            wanted -= length
            self._held[source] -= length
            self._db.write("DELETE FROM fragments WHERE key = ?", (key,))
            dropped.append(bundle_id_from_key(key))
        return dropped

    def _count_fragments(self) -> None:
        self._held.clear()
        for key, length in self._db.read("SELECT key, sum(length) FROM fragments GROUP BY key"):
            self._held[encode_eid(bundle_id_from_key(key).source)] += length

    def add_fragment(
        self, identity: BundleId, part: FragmentRange, payload: bytes, expires_utc_ms: int
    ) -> bytes | None:
        """Add a fragment within the transaction; return the payload once it is complete."""
        key = identity.key
        added = self._db.write(
            "INSERT OR IGNORE INTO fragments VALUES (?, ?, ?, ?, ?, ?)",
            (
                key, part.total, part.offset, len(payload),
                min(expires_utc_ms, _MAX_ID), payload,
            ),
        )  # fmt: skip
        self._held[encode_eid(identity.source)] += added.rowcount * len(payload)
        where = "FROM fragments WHERE key = ? AND total = ?"
        ((there,),) = self._db.read(f"SELECT sum(length) {where}", (key, part.total))
        if there < part.total:
            return None
        parts = self._db.read(f"SELECT offset, payload {where}", (key, part.total))
        whole = _reassemble(part.total, parts)
        if whole is not None:
            self._db.write("DELETE FROM fragments WHERE key = ?", (key,))
            self._held[encode_eid(identity.source)] -= there
        return whole

    def deliveries(self, after: int, count: int, *, expedited: bool = False) -> list[Delivery]:
        """Return units with ids above `after`, in order of arrival.

        Only expedited ones do not wait for the disk: a node upstream repeats those that are lost.
        """
        if expedited and not self._has_expedited:
            return []
        rows = self._db.read_some(
            "SELECT id, key, endpoint, report_to, flags, expires_utc_ms, payload FROM inbox"
            f" WHERE id > ? AND id <= ? AND {'' if expedited else 'NOT '}expedited"
            " ORDER BY id LIMIT ?",
            (after, _MAX_ID if expedited else self._db.durable["inbox"], count),
        )
        self._has_expedited = bool(rows) if expedited else self._has_expedited
        return [
            Delivery(
                bundle_id_from_key(key), decode_eid(endpoint), payload, expedited,
                decode_eid(report_to), flags, expires_utc_ms, row_id,
            )
            for row_id, key, endpoint, report_to, flags, expires_utc_ms, payload in rows
        ]  # fmt: skip

    def remove(self, ids: Iterable[int]) -> None:
        """Remove units that were delivered; their identities stay for deduplication."""
        self._db.write_all("DELETE FROM inbox WHERE id = ?", [(row_id,) for row_id in ids])

    def expired(self, now_utc_ms: int, count: int) -> list[tuple[int, bool, BundleId]]:
        """Return expired units as (row id, expedited, identity)."""
        rows = self._db.read(
            "SELECT id, expedited, key FROM inbox WHERE expires_utc_ms <= ? LIMIT ?",
            (now_utc_ms, count),
        )
        return [(row_id, bool(first), bundle_id_from_key(key)) for row_id, first, key in rows]

    def forget(self, now_utc_ms: int) -> list[BundleId]:
        """Remove expired identities and fragments; return the units that stayed incomplete.

        At most `_FORGET_BATCH` units are removed; the next call continues.
        """
        old = "WHERE expires_utc_ms <= ?"
        rows = self._db.read(
            f"SELECT DISTINCT key FROM fragments {old} LIMIT ?", (now_utc_ms, _FORGET_BATCH)
        )
        if rows:
            self._db.write_all(
                f"DELETE FROM fragments {old} AND key = ?", [(now_utc_ms, key) for (key,) in rows]
            )
            self._count_fragments()
        if self._db.read("SELECT 1 FROM seen WHERE until_utc_ms <= ? LIMIT 1", (now_utc_ms,)):
            self._db.write("DELETE FROM seen WHERE until_utc_ms <= ?", (now_utc_ms,))
        return [bundle_id_from_key(key) for (key,) in rows]

    def depth(self) -> int:
        """Return the number of units that wait for the application."""
        ((count,),) = self._db.read("SELECT count(*) FROM inbox")
        return int(count)


def _reassemble(total: int, parts: Iterable[tuple[int, bytes]]) -> bytes | None:
    """Join (offset, octets) parts to a payload; return None while octets are missing."""
    whole = bytearray()
    for offset, octets in sorted(parts):
        if offset > len(whole):
            return None
        whole += octets[len(whole) - offset :]
    return bytes(whole) if len(whole) == total else None
