"""What every link has: what the agent asks of it, its pace, and the back-off after failures."""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Final

from adapters.bundle.links.contact import ContactState
from adapters.bundle.node.node import BundleNode
from adapters.bundle.node.settings import Address, Neighbour
from adapters.system import OPERATING_SYSTEM, System

_LOG: Final = logging.getLogger(__name__)
_LONGEST_PAUSE_S: Final = 30.0
WHOLE_BUNDLES: Final = 1 << 62
"""The size of bundles for links that fragment none."""


@dataclass(frozen=True, slots=True)
class LinkContext:
    """What all links of an agent share.

    Attributes:
        node: whose bundles they move.
        now_s: monotonic time.
        wake: has what was put into the node's transaction committed, and the links pump.
        system: where they bind sockets.
    """

    node: BundleNode
    now_s: Callable[[], float]
    wake: Callable[[], None]
    system: System = OPERATING_SYSTEM


class Link(ABC):
    """One neighbour, over one protocol. It moves bundles between a node and the network.

    Whatever it puts into the node's transaction is committed by the agent, which then lets it
    pump.

    Attributes:
        name: of the neighbour.
        up: whether it could send now, as far as it knows; what has no connection always could.
        last_heard_s: when something came from the neighbour, in monotonic time; None for never.
    """

    def __init__(self, context: LinkContext, neighbour: Neighbour) -> None:
        self.name, self.up = neighbour.name, True
        self.last_heard_s: float | None = None
        self._node, self._now_s, self._wake = context.node, context.now_s, context.wake
        self._traffic = context.node.traffic[neighbour.name]
        self._contact = True

    @property
    @abstractmethod
    def next_s(self) -> float:
        """When `tick` or `pump` has something to do, in monotonic time; infinity for never."""

    def on_contact(self, state: ContactState) -> None:
        """Take note of the state of contact."""
        self._contact = state.contact

    def pump(self) -> None:
        """Send what waits, expedited bundles first, as far as the link takes it now.

        Raises:
            StoreError: the store cannot be read.
        """
        for expedited in (True, False):
            self._send_waiting(expedited)

    @abstractmethod
    def _send_waiting(self, expedited: bool) -> None:
        """Send what waits of the expedited bundles, whatever their number, or of the others."""

    def tick(self) -> None:  # noqa: B027 - a link may have no timers
        """Run the timers that are due."""

    def close(self) -> None:  # noqa: B027 - a link may hold nothing
        """Close; bundles that were on their way wait again."""

    def heard(self) -> None:
        """Note that something came from the neighbour."""
        self.last_heard_s = self._now_s()


class Endpoint(ABC):
    """What the links of one protocol share: a socket, or the client of a daemon.

    Attributes:
        address: where it listens, with the port that was free; None for nowhere.
        malformed: how much came that nothing could be read from.
    """

    address: Address | None = None
    malformed = 0

    @abstractmethod
    def link(self, neighbour: Neighbour) -> Link:
        """Return the link to a neighbour; before `open`."""

    @abstractmethod
    async def open(self) -> None:
        """Begin to listen.

        Raises:
            OSError: a socket cannot be had.
            BundleError: a daemon cannot be used, now or later.
        """

    @abstractmethod
    async def close(self) -> None:
        """Close the socket; the links are closed apart."""


class Pacer:
    """Says when something may be sent again, at a rate or after a pause.

    Attributes:
        rate_octets_s: how much may be sent.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self.rate_octets_s = inf
        self._now_s, self._not_before_s = now_s, -inf

    @property
    def ready(self) -> bool:
        """Whether something may be sent now."""
        return self._now_s() >= self._not_before_s

    @property
    def next_s(self) -> float:
        """When something may be sent again; infinity if that is now."""
        return inf if self.ready else self._not_before_s

    def sent(self, octets: int) -> None:
        """Note how much was sent."""
        begin_s = max(self._now_s(), self._not_before_s)
        self._not_before_s = begin_s + octets / self.rate_octets_s

    def pause(self, pause_s: float) -> None:
        """Send nothing for some time."""
        self._not_before_s = self._now_s() + pause_s

    def reset(self) -> None:
        """Send at once."""
        self._not_before_s = -inf


class Backoff:
    """Pauses between attempts that double up to 30 s; a failure is logged once.

    Attributes:
        pause_s: the next pause.
    """

    def __init__(self, name: str, shortest_s: float) -> None:
        self._name, self._shortest_s = name, shortest_s
        self.succeeded()

    def succeeded(self) -> None:
        """Start again with the shortest pause."""
        self.pause_s, self._said = self._shortest_s, ""

    def failed(self, failure: BaseException | str | None = None) -> float:
        """Log a failure, unless it is that of last time; return how long to wait, in seconds."""
        text = str(failure) or type(failure).__name__
        if failure is not None and text != self._said:
            _LOG.warning("%s: %s", self._name, text)
            self._said = text
        pause_s, self.pause_s = self.pause_s, min(2 * self.pause_s, _LONGEST_PAUSE_S)
        return pause_s
