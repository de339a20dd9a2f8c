"""Which bundles go to a neighbour next, and which of them are on their way."""

import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from adapters.bundle.codec.bundle import Bundle, decode_bundle, encode_bundle
from adapters.bundle.codec.report import Assertion, ReportReason
from adapters.bundle.node.bundle_factory import forwarded, fragments
from adapters.bundle.node.database import Database, Transaction
from adapters.bundle.node.outbox import Outbox, Stored
from adapters.bundle.node.port import DeliveryStatus, Notice
from adapters.bundle.node.receiving import Reporting
from adapters.bundle.node.settings import NodeSettings

_LOG = logging.getLogger(__name__)
_FETCHED = 32


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A bundle, or a fragment of it, as it goes to a neighbour."""

    stored: Stored
    octets: bytes


class _Queue:
    """What goes to one neighbour.

    Attributes:
        ready: what was read from the outbox or came back, and waits for the link.
        last_id: up to which row the outbox has been read.
    """

    def __init__(self) -> None:
        self.ready: deque[Outgoing] = deque()
        self.last_id = 0


class Sending:
    """Reads the outbox a little ahead of the links and hears from them what became of it."""

    def __init__(
        self,
        settings: NodeSettings,
        database: Database,
        outbox: Outbox,
        transaction: Transaction,
        reporting: Reporting,
        utc_ms: Callable[[], int],
        notify: Callable[[Notice], None],
    ) -> None:
        """Send what is in the outbox of a node."""
        self._settings = settings
        self._database = database
        self._outbox = outbox
        self._transaction = transaction
        self._reporting = reporting
        self._utc_ms = utc_ms
        self._notify = notify
        self._queues = {neighbour.name: _Queue() for neighbour in settings.neighbours}
        self._parts: dict[int, int] = {}

    def outgoing(self, neighbour: str, octets: int, bundle_octets: int) -> list[Outgoing]:
        """Return what goes to a neighbour next; it counts as on its way.

        Only what is committed goes out: what a crash undoes must not have been seen by anybody.

        Args:
            neighbour: its name.
            octets: how much of it; at least one bundle comes, if any waits.
            bundle_octets: what is longer is fragmented.
        """
        if self._database.gathering:
            return []
        queue, taken = self._queues[neighbour], list[Outgoing]()
        while queue.ready or self._fetch(neighbour, queue, bundle_octets):
            octets -= len(queue.ready[0].octets)
            if taken and octets < 0:
                break
            taken.append(queue.ready.popleft())
        return taken

    def handed_on(self, sent: Sequence[Outgoing]) -> None:
        """Note that the neighbour has these."""
        whole = []
        for outgoing in sent:
            row_id = outgoing.stored.id
            self._parts[row_id] -= 1
            if not self._parts[row_id]:
                del self._parts[row_id]
                whole.append(outgoing.stored)
        if whole:
            self._transaction.mark(lambda: self._write_handed_on(whole))

    def came_back(self, neighbour: str, sent: Sequence[Outgoing]) -> None:
        """Send again, before all else, what the neighbour did not get."""
        self._queues[neighbour].ready.extendleft(reversed(sent))

    def forget(self, outgoing: Outgoing) -> None:
        """Send this no more; what becomes of its row is decided elsewhere."""
        self._parts.pop(outgoing.stored.id, None)

    def read_again(self) -> None:
        """Look through the outbox from its beginning: bundles that were sent wait again."""
        for queue in self._queues.values():
            queue.last_id = 0

    def _fetch(self, neighbour: str, queue: _Queue, bundle_octets: int) -> bool:
        while not queue.ready:
            rows = self._outbox.waiting(neighbour, queue.last_id, _FETCHED, self._utc_ms())
            if not rows:
                return False
            queue.last_id = rows[-1].id
            for stored in rows:
                if stored.id not in self._parts:
                    queue.ready.extend(self._cut(stored, bundle_octets))
        return True

    def _cut(self, stored: Stored, bundle_octets: int) -> list[Outgoing]:
        octets = stored.octets
        if not stored.own:
            stayed_ms = max(0, self._utc_ms() - stored.put_utc_ms)
            octets = encode_bundle(forwarded(decode_bundle(octets), self._settings.node, stayed_ms))
        parts = [octets]
        if len(octets) > bundle_octets:
            bundle = decode_bundle(octets)
            cut = fragments(bundle, bundle_octets)
            if cut is None:
                self._give_up(stored, bundle, bundle_octets)
                return []
            parts = cut
        self._parts[stored.id] = len(parts)
        return [Outgoing(stored, part) for part in parts]

    def _give_up(self, stored: Stored, bundle: Bundle, bundle_octets: int) -> None:
        _LOG.warning(
            "bundle %s cannot be cut to %d octets, which is bundle_octets of the link to %s",
            stored.identity, bundle_octets, stored.neighbour,
        )  # fmt: skip
        self._reporting.deleted(bundle, ReportReason.TRANSMISSION_CANCELLED)
        self._outbox.remove([stored.id])
        if stored.own:
            self._notify(Notice(stored.identity, DeliveryStatus.DELETED))

    def _pause_ms(self, stored: Stored) -> int:
        return round(1000 * self._settings.link_to(stored.neighbour).confirm_after_s)

    def _write_handed_on(self, whole: Sequence[Stored]) -> None:
        self._outbox.handed_on(whole, self._utc_ms(), self._pause_ms)
        for stored in whole:
            if stored.own:
                self._notify(Notice(stored.identity, DeliveryStatus.HANDED_ON))
            else:
                self._reporting.about(decode_bundle(stored.octets), Assertion.FORWARDED)
