"""The link to neighbours that a daemon on this machine reaches."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, Protocol

from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    PAYLOAD_NUMBER,
    Block,
    BlockType,
    Bundle,
    Crc,
    Creation,
    Primary,
    decode_bundle,
    encode_bundle,
)
from adapters.bundle.codec.eid import NONE, Eid, node_of
from adapters.bundle.codec.errors import StoreError
from adapters.bundle.links.contact import ContactState
from adapters.bundle.node.node import Node
from adapters.bundle.node.sending import Outgoing
from adapters.bundle.node.settings import DaemonLink, Neighbour


@dataclass(frozen=True, slots=True)
class Outbound:
    """Application data for a daemon, which makes a bundle of its own of it."""

    destination: Eid
    lifetime_s: float
    payload: bytes


@dataclass(frozen=True, slots=True)
class Inbound:
    """Application data from a daemon, with what it says of the bundle that brought it."""

    source: Eid
    destination: Eid
    creation: Creation
    payload: bytes


OnResult = Callable[[str | None], None]
"""Is told once what became of something: None for taken, or why it was not, as far as is known."""

OnInbound = Callable[[Inbound, OnResult], None]
"""Takes what a daemon delivers, and tells when it is on the disk, or why it is not."""


class Daemon(Protocol):
    """A client of a daemon; everything happens on the loop of `open`."""

    @property
    def up(self) -> bool:
        """Whether the daemon answers."""
        ...

    async def open(self, hear: OnInbound, wake: Callable[[], None]) -> None:
        """Attach, or go on trying: a daemon may be started later, and again.

        Args:
            hear: takes what arrives.
            wake: is called when `up` has changed.

        Raises:
            BundleError: it will not do so either later; the text says what is missing or wrong.
        """
        ...

    def post(self, data: Outbound, told: OnResult) -> None:
        """Hand something to the daemon, and tell of it in some later turn of the loop."""
        ...

    async def close(self) -> None:
        """Detach; what is under way is waited for a while, and its end told."""
        ...


_LOG: Final = logging.getLogger(__name__)
_ON_WAY: Final = 32
_SHORTEST_PAUSE_S: Final = 0.5
_LONGEST_PAUSE_S: Final = 30.0
_UNCUT: Final = 1 << 62


class DaemonNeighbour:
    """Hands what is for a neighbour to the daemon, some at a time, and again what it did not take.

    Args:
        node: whose bundles.
        neighbour: to whom.
        link: whether bundles are carried whole.
        daemon: who carries them.
        now_s: monotonic time.
        wake: is called when there is something to commit.

    Attributes:
        name: of the neighbour.
        last_heard_s: when something came from it, in monotonic time; None for never.
    """

    def __init__(
        self,
        node: Node,
        neighbour: Neighbour,
        link: DaemonLink,
        daemon: Daemon,
        now_s: Callable[[], float],
        wake: Callable[[], None],
    ) -> None:
        """Begin with contact."""
        self.name = neighbour.name
        self.last_heard_s: float | None = None
        self.whole = link.whole
        self._node, self._link, self._daemon = node, link, daemon
        self._now_s, self._wake = now_s, wake
        self._contact = True
        self._on_way = 0
        self._not_taken: list[Outgoing] = []
        self._again_s: float | None = None
        self._pause_s = _SHORTEST_PAUSE_S
        self._said = ""

    @property
    def up(self) -> bool:
        """Whether the daemon answers."""
        return self._daemon.up

    @property
    def next_s(self) -> float | None:
        """When what was not taken is offered again."""
        return self._again_s

    def heed(self, outlook: ContactState) -> None:
        """Hand over only while there is contact; how much the link takes the daemon knows."""
        self._contact = outlook.contact

    def pump(self) -> None:
        """Hand over what waits."""
        while self._contact and self._daemon.up and self._on_way < _ON_WAY:
            batch = self._node.sending.outgoing(self.name, 1, _UNCUT)
            if not batch:
                return
            for outgoing in batch:
                self._post(outgoing)

    def tick(self) -> None:
        """Offer again what was not taken."""
        if self._again_s is not None and self._now_s() >= self._again_s:
            self._again_s = None
            self._node.sending.came_back(self.name, self._not_taken)
            self._not_taken = []

    def close(self) -> None:
        """What the daemon has not said to have is in the store, and waits there."""

    def _post(self, outgoing: Outgoing) -> None:
        bundle = decode_bundle(outgoing.octets)
        primary = bundle.primary
        ends_utc_ms = DTN_EPOCH_UTC_MS + primary.creation.time_ms + primary.lifetime_ms
        left_ms = ends_utc_ms - self._node.utc_ms()
        if left_ms <= 0:
            self._node.sending.forget(outgoing)
            return
        self._on_way += 1
        data = (
            Outbound(self._link.endpoint, left_ms / 1000, outgoing.octets)
            if self.whole
            else Outbound(primary.destination, left_ms / 1000, bundle.payload)
        )
        self._daemon.post(data, partial(self._told, outgoing))

    def _told(self, outgoing: Outgoing, failure: str | None) -> None:
        self._on_way -= 1
        self._wake()
        if failure is None:
            self._pause_s = _SHORTEST_PAUSE_S
            self._node.sending.handed_on([outgoing])
            return
        self._not_taken.append(outgoing)
        if failure != self._said:
            self._said = failure
            _LOG.warning("%s waits: %s", outgoing.stored.identity, failure)
        if self._again_s is None:
            self._again_s = self._now_s() + self._pause_s
            self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)


class Attachment:
    """Brings what a daemon delivers into the node, and says when it is on the disk.

    Args:
        node: takes it.
        neighbours: by the names of their nodes.
        now_s: monotonic time.
        wake: is called when there is something to commit.
    """

    def __init__(
        self,
        node: Node,
        neighbours: dict[str, DaemonNeighbour],
        now_s: Callable[[], float],
        wake: Callable[[], None],
    ) -> None:
        """Wait for what comes."""
        self._node, self._neighbours, self._now_s, self._wake = node, neighbours, now_s, wake

    def hear(self, data: Inbound, told: OnResult) -> None:
        """Take in what has arrived; what cannot be read is counted and counts as taken."""
        name = str(node_of(data.source))
        neighbour = self._neighbours.get(name)
        octets = data.payload
        if neighbour is None or not neighbour.whole:
            octets = encode_bundle(self._bundle(data))
        if neighbour is not None:
            neighbour.last_heard_s = self._now_s()
        try:
            self._node.receiving.arrived(name, octets)
        except StoreError as error:
            told(str(error))
        else:
            self._node.transaction.then(lambda failure: told(str(failure) if failure else None))
        self._wake()

    def _bundle(self, data: Inbound) -> Bundle:
        """Return the bundle as it may have been.

        Daemons keep its lifetime to themselves, and it has not ended: the identity is remembered
        for as long as one of ours would live, from now on.
        """
        now_ms = self._node.utc_ms() - DTN_EPOCH_UTC_MS
        age_ms = max(0, now_ms - data.creation.time_ms) if data.creation.time_ms else 0
        lifetime_ms = age_ms + round(1000 * self._node.settings.lifetime_s)
        primary = Primary(data.destination, data.source, NONE, data.creation, lifetime_ms)
        payload = Block(BlockType.PAYLOAD, PAYLOAD_NUMBER, data.payload, crc=Crc.NONE)
        return Bundle(primary, (payload,))
