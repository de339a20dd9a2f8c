"""What the agent is to an application: the thesis's four methods, whatever agent is behind them."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from adapters.bundle.codec.bundle import BundleId
from adapters.bundle.codec.eid import Eid


class DeliveryStatus(Enum):
    """What has become of something that was sent."""

    HANDED_ON = "handed on to the next node"
    DELIVERED = "delivered to its receiver"
    EXPIRED = "deleted, its lifetime is over"
    DELETED = "deleted by a node on its way"


@dataclass(frozen=True, slots=True)
class Notice:
    """A fate, and whose it is. May come more than once; DELIVERED may come before HANDED_ON."""

    identity: BundleId
    fate: DeliveryStatus


@dataclass(frozen=True, slots=True)
class Delivery:
    """Application data that has arrived.

    Attributes:
        endpoint: to whom it was sent.
        payload: what was sent.
    """

    identity: BundleId
    endpoint: Eid
    payload: bytes

    @property
    def source(self) -> Eid:
        """Who sent it."""
        return self.identity.source


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


class BundleAgent(Protocol):
    """An agent with a session, an endpoint to send from and endpoints to receive at (thesis 6.3).

    Which EIDs these are is part of how the agent was made.
    """

    async def open(self, heed: Callable[[Notice], None]) -> None:
        """Open the session and the sending and receiving endpoints.

        Args:
            heed: is told what becomes of what was sent.

        Raises:
            StoreError: the store cannot be used.
            OSError: the network cannot.
        """
        ...

    async def send(
        self,
        destination: Eid,
        payload: bytes,
        *,
        lifetime_s: float | None = None,
        confirm: bool = False,
    ) -> BundleId:
        """Take responsibility for a payload; return when it survives whatever happens here.

        Args:
            destination: to whom.
            payload: what; one receive there returns all of it.
            lifetime_s: when it is no longer wanted; None for the agent's own.
            confirm: whether it is kept, and sent again, until its receiver has it.

        Raises:
            StoreFull: there is no room; nothing was taken.
            StoreError: the store cannot be written; nothing was taken.
            AgentClosed: the agent is not open.
            ValueError: no neighbour reaches the destination, or nothing that goes there is
                confirmed.
        """
        ...

    def must_confirm(self, destination: Eid) -> bool:
        """Return whether what goes there has to be sent with `confirm`, or may get lost."""
        ...

    def receive(self) -> AbstractAsyncContextManager[Delivery]:
        """Wait for what has arrived next, and have it for the time of a `with`.

        When the `with` ends it counts as delivered and does not come again; when it raises it
        stays. After a crash within the `with`, or before that is on the disk (`settle`), the same
        identity comes again.

        Raises:
            AgentClosed: the agent is not open, or was closed meanwhile.
        """
        ...

    async def settle(self) -> None:
        """Return when what was delivered until now does not come again, whatever happens here.

        Raises:
            StoreError: that could not be written; it is tried again.
            AgentClosed: the agent is not open.
        """
        ...

    async def close(self) -> None:
        """End the session; what waits is kept."""
        ...
