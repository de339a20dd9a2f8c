"""Bundles that are to be sent, until the next node, or the receiver, has them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from adapters.bundle.codec.bundle import (
    BundleId,
    Primary,
    bundle_id_from_key,
    decode_bundle,
    identity_of,
)
from adapters.bundle.codec.eid import Eid, decode_eid, encode_eid
from adapters.bundle.node.database import Database

_GREATEST: Final = 2**62


class State(IntEnum):
    """How far a bundle has come: not yet with the next node, or there and not yet confirmed."""

    WAITING = 0
    HANDED_ON = 1


@dataclass(frozen=True, slots=True)
class Stored:
    """A bundle in the outbox.

    Attributes:
        neighbour: to whom it goes.
        own: whether it was made here, not received to be forwarded.
        confirm: whether it stays until its receiver says that it was delivered.
        put_utc_ms: when it came in here.
    """

    id: int
    neighbour: str
    identity: BundleId
    own: bool
    confirm: bool
    put_utc_ms: int
    octets: bytes


@dataclass(frozen=True, slots=True)
class Queued:
    """Application data that was sent from here and is still in the store.

    Attributes:
        payload: what was sent.
        expires_utc_s: when its lifetime ends.
    """

    identity: BundleId
    payload: bytes
    expires_utc_s: float


class Outbox:
    """The bundles to send, in the order they came in, for each neighbour."""

    def __init__(self, database: Database) -> None:
        self._db = database

    def add(
        self, primary: Primary, neighbour: str, octets: bytes, *,
        own: bool, confirm: bool, now_utc_ms: int, expires_utc_ms: int,
    ) -> None:  # fmt: skip
        """Add a bundle within the transaction, by its primary block and its octets."""
        self._db.write(
            "INSERT INTO outbox (key, destination, neighbour, state, confirm, put_utc_ms,"
            " expires_utc_ms, own, octets) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                identity_of(primary).key, encode_eid(primary.destination), neighbour,
                State.WAITING.value, confirm, now_utc_ms, min(expires_utc_ms, _GREATEST), own,
                octets,
            ),
        )  # fmt: skip

    def waiting(self, neighbour: str, after: int, count: int, now_utc_ms: int) -> list[Stored]:
        """Return bundles that wait for a neighbour, with ids greater than one, in their order.

        One whose lifetime is over is not among them: the next node would delete it without a word.
        """
        rows = self._db.read_some(
            "SELECT id, key, own, confirm, put_utc_ms, octets FROM outbox"
            " WHERE neighbour = ? AND state = ? AND id > ? AND expires_utc_ms > ?"
            " ORDER BY id LIMIT ?",
            (neighbour, State.WAITING.value, after, now_utc_ms, count),
        )
        return [
            Stored(
                row_id, neighbour, bundle_id_from_key(key), bool(own), bool(confirm), put_utc_ms,
                octets,
            )
            for row_id, key, own, confirm, put_utc_ms, octets in rows
        ]  # fmt: skip

    def handed_on(
        self, bundles: Sequence[Stored], now_utc_ms: int, pause_ms: Callable[[Stored], int]
    ) -> None:
        """Note that the next node has bundles: done with, or kept until they are confirmed.

        Args:
            bundles: which.
            now_utc_ms: the time now.
            pause_ms: after which one that is not confirmed is to be sent again; it doubles.
        """
        self.remove(stored.id for stored in bundles if not stored.confirm)
        self._db.write_all(
            "UPDATE outbox SET state = ?, again_utc_ms = ? + ? * (1 << min(tries, 10)),"
            " tries = tries + 1 WHERE id = ?",
            [
                (State.HANDED_ON.value, now_utc_ms, pause_ms(stored), stored.id)
                for stored in bundles
                if stored.confirm
            ],
        )

    def remove(self, ids: Iterable[int]) -> None:
        """Remove bundles."""
        self._db.write_all("DELETE FROM outbox WHERE id = ?", [(row_id,) for row_id in ids])

    def ids(self, identity: BundleId) -> list[int]:
        """Return the rows of the bundle with this identity; at most one, unless it was cut."""
        rows = self._db.read("SELECT id FROM outbox WHERE key = ? AND own", (identity.key,))
        return [row_id for (row_id,) in rows]

    def queued(self, destination: Eid) -> Iterator[Queued]:
        """Yield the payloads that were sent from here to a destination, the newest first."""
        before = _GREATEST
        while rows := self._db.read(
            "SELECT id, key, expires_utc_ms, octets FROM outbox WHERE own AND destination = ?"
            " AND id < ? ORDER BY id DESC LIMIT 32",
            (encode_eid(destination), before),
        ):
            for _, key, expires_utc_ms, octets in rows:
                payload = decode_bundle(octets).payload
                yield Queued(bundle_id_from_key(key), payload, expires_utc_ms / 1000)
            before = rows[-1][0]

    def unconfirmed(self, now_utc_ms: int) -> int:
        """Requeue what was handed on and should have been confirmed by now; return how many."""
        found = self._db.read(
            "SELECT id FROM outbox WHERE again_utc_ms <= ? AND state = ? LIMIT 1000",
            (now_utc_ms, State.HANDED_ON.value),
        )
        if found:
            self._db.write_all(
                "UPDATE outbox SET state = 0, again_utc_ms = NULL WHERE id = ?", found
            )
        return len(found)

    def expired(self, now_utc_ms: int, count: int) -> list[tuple[int, BundleId, bytes]]:
        """Return bundles whose lifetime has ended: id, identity, octets."""
        rows = self._db.read_some(
            "SELECT id, key, octets FROM outbox WHERE expires_utc_ms <= ?"
            " ORDER BY expires_utc_ms LIMIT ?",
            (now_utc_ms, count),
        )
        return [(row_id, bundle_id_from_key(key), octets) for row_id, key, octets in rows]

    def reroute(self, neighbour_of: Callable[[Eid], str]) -> None:
        """Assign each destination to its neighbour of now, and commit."""
        rows = self._db.read("SELECT DISTINCT destination, neighbour FROM outbox")
        for destination, neighbour in rows:
            if (now := neighbour_of(decode_eid(destination))) != neighbour:
                self._db.write(
                    "UPDATE outbox SET neighbour = ? WHERE destination = ? AND neighbour = ?",
                    (now, destination, neighbour),
                )
        self._db.commit()

    def depth(self, neighbour: str | None = None) -> int:
        """Return how many bundles wait, for one neighbour or for all."""
        where, values = ("", ()) if neighbour is None else (" WHERE neighbour = ?", (neighbour,))
        ((count,),) = self._db.read(f"SELECT count(*) FROM outbox{where}", values)
        return int(count)

    def oldest_utc_ms(self) -> int | None:
        """Return when the oldest of all came in, if there is one."""
        rows = self._db.read("SELECT put_utc_ms FROM outbox ORDER BY id LIMIT 1")
        return int(rows[0][0]) if rows else None
