"""`Link` and `Endpoint`, base classes of all links; their pacing; the back-off after failures."""

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
_MAX_BACKOFF_S: Final = 30.0  # chosen, not measured
WHOLE_BUNDLES: Final = 1 << 62
"""Maximum bundle size on links that do not fragment."""


@dataclass(frozen=True, slots=True)
class LinkContext:
    """Context shared by all links of an agent.

    Attributes:
        node: node that sends and receives over them.
        now_s: returns monotonic time in seconds.
        wake: schedules a commit of the node's transaction, then `send_waiting` of the links.
        system: the port to the computer, which opens sockets.
    """

    node: BundleNode
    now_s: Callable[[], float]
    wake: Callable[[], None]
    system: System = OPERATING_SYSTEM


class Link(ABC):
    """Link to one neighbour over one protocol. It moves bundles between a node and the network.

    The agent commits the link's changes to the node's transaction, then calls `send_waiting`.

    Attributes:
        name: name of the neighbour.
        up: whether it can send now, as far as is known; always true without connections.
        last_received_s: time of the last reception from the neighbour, monotonic; None for never.
    """

    def __init__(self, context: LinkContext, neighbour: Neighbour) -> None:
        self.name, self.up = neighbour.name, True
        self.last_received_s: float | None = None
        self._node, self._now_s, self._wake = context.node, context.now_s, context.wake
        self._traffic = context.node.traffic[neighbour.name]
        self._contact = True

    @property
    @abstractmethod
    def next_s(self) -> float:
        """Monotonic due time of `tick` or `send_waiting`; infinity for never."""

    def on_contact(self, state: ContactState) -> None:
        """Update the state of contact."""
        self._contact = state.contact

    def send_waiting(self) -> None:
        """Send waiting bundles, expedited ones first, as far as the link accepts them now.

        Raises:
            StoreError: the store cannot be read.
        """
        for expedited in (True, False):
            self._send_waiting(expedited)

    @abstractmethod
    def _send_waiting(self, expedited: bool) -> None:
        """Send waiting bundles: all expedited ones, or others as far as the link accepts them."""

    def tick(self) -> None:  # noqa: B027 - a link may have no timers
        """Run the timers that are due; a link may have none."""

    def close(self) -> None:  # noqa: B027 - a link may hold nothing
        """Close; bundles in flight are requeued."""

    def note_received(self) -> None:
        """Record a reception from the neighbour."""
        self.last_received_s = self._now_s()


class Endpoint(ABC):
    """Resource shared by the links of one protocol: a socket, or the client of a daemon.

    Attributes:
        address: listen address with the actual port; None if it does not listen.
        malformed: received transmissions that could not be decoded.
    """

    address: Address | None = None
    malformed = 0

    @abstractmethod
    def link(self, neighbour: Neighbour) -> Link:
        """Return the link to a neighbour; called before `open`."""

    @abstractmethod
    async def open(self) -> None:
        """Start listening.

        Raises:
            OSError: a socket cannot be opened.
            BundleError: the daemon can be used neither now nor later.
        """

    @abstractmethod
    async def close(self) -> None:
        """Close the socket; links are closed separately."""


class Pacer:
    """Limits the data rate, and enforces pauses.

    Attributes:
        rate_octets_s: maximum data rate, octets/s.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self.rate_octets_s = inf
        self._now_s, self._not_before_s = now_s, -inf

    @property
    def ready(self) -> bool:
        """Whether sending is allowed now."""
        return self._now_s() >= self._not_before_s

    @property
    def next_s(self) -> float:
        """Monotonic end of the pause; infinity if sending is allowed now."""
        return inf if self.ready else self._not_before_s

    def add_sent(self, octets: int) -> None:
        """Account for octets that were sent."""
        begin_s = max(self._now_s(), self._not_before_s)
        self._not_before_s = begin_s + octets / self.rate_octets_s

    def pause(self, pause_s: float) -> None:
        """Forbid sending for `pause_s` seconds."""
        self._not_before_s = self._now_s() + pause_s

    def reset(self) -> None:
        """Allow sending at once."""
        self._not_before_s = -inf


class Backoff:
    """Pauses between attempts, doubling up to 30 s; repetitions of a failure are not logged.

    Attributes:
        pause_s: next pause in seconds.
    """

    def __init__(self, name: str, min_pause_s: float) -> None:
        self._name, self._min_pause_s = name, min_pause_s
        self.reset()

    def reset(self) -> None:
        """Reset the pause to its minimum."""
        self.pause_s, self._last_error = self._min_pause_s, ""

    def next_pause_s(self, failure: BaseException | str | None = None) -> float:
        """Log a failure that differs from the last one; return the pause in seconds."""
        text = str(failure) or type(failure).__name__
        if failure is not None and text != self._last_error:
            _LOG.warning("%s: %s", self._name, text)
            self._last_error = text
        pause_s, self.pause_s = self.pause_s, min(2 * self.pause_s, _MAX_BACKOFF_S)
        return pause_s
