"""What every link has: its interface, the back-off and the lookup of names."""

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Final, Protocol

from adapters.bundle.links.contact import ContactState
from adapters.bundle.node.settings import Address

_LOG: Final = logging.getLogger(__name__)
_LONGEST_S: Final = 30.0


class Backoff:
    """Pauses that double while nothing goes well.

    Args:
        name: of what is tried, for the log.
        shortest_s: the first pause.

    Attributes:
        pause_s: the next pause.
    """

    def __init__(self, name: str, shortest_s: float) -> None:
        """Begin with the shortest pause."""
        self._name, self._shortest_s = name, shortest_s
        self.pause_s = shortest_s
        self._said = ""

    def went_well(self) -> None:
        """Begin anew with the shortest pause."""
        self.pause_s, self._said = self._shortest_s, ""

    def failed(self, failure: BaseException) -> float:
        """Log a failure, unless it is that of last time; return how long to wait, in seconds."""
        text = text_of(failure)
        if text != self._said:
            _LOG.warning("%s: %s", self._name, text)
        self._said = text
        return self.next_pause_s()

    def next_pause_s(self) -> float:
        """Return how long to wait, in seconds; longer the next time."""
        pause_s, self.pause_s = self.pause_s, min(2 * self.pause_s, _LONGEST_S)
        return pause_s


def text_of(failure: BaseException) -> str:
    """Return what an exception says; some say nothing but their name."""
    return str(failure) or type(failure).__name__


AGAIN_S: Final = 1.0
"""The shortest pause before a name that is not found is looked up again; it doubles up to 30 s."""
SocketAddress = tuple[str, int]


class AddressLookup:
    """The other end of a link by datagrams.

    Args:
        name: of the neighbour.
        address: of it, as the settings say it.
        family: of the socket that sends there.

    Attributes:
        where: its host in numbers, and its port; None while that is not known.
    """

    def __init__(self, name: str, address: Address, family: socket.AddressFamily) -> None:
        """Know at once what is said in numbers."""
        self._address, self._family = address, family
        self._backoff = Backoff(f"{name} at {address.host}", AGAIN_S)
        self._looking: asyncio.Task[None] | None = None
        self.where: SocketAddress | None = None
        try:
            found = socket.getaddrinfo(
                address.host, address.port, family, socket.SOCK_DGRAM, 0, socket.AI_NUMERICHOST
            )
        except OSError:
            return
        self.where = _where(found[0][4])

    def find(self, found: Callable[[SocketAddress], None]) -> None:
        """Tell where it is as soon as that is known."""
        if self.where is not None:
            found(self.where)
        else:
            self._looking = asyncio.get_running_loop().create_task(self._look(found))

    def close(self) -> None:
        """Look no more."""
        if self._looking is not None:
            self._looking.cancel()

    async def _look(self, found: Callable[[SocketAddress], None]) -> None:
        loop, address = asyncio.get_running_loop(), self._address
        while self.where is None:
            try:
                answer = await loop.getaddrinfo(
                    address.host, address.port, family=self._family, type=socket.SOCK_DGRAM
                )
                self.where = _where(answer[0][4])
            except OSError as error:
                await asyncio.sleep(self._backoff.failed(error))
        found(self.where)


def _where(
    address: tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes],
) -> SocketAddress:
    host, port = address[:2]
    return str(host), int(port)


class Link(Protocol):
    """One neighbour, over one protocol. It moves bundles between a node and the network.

    Whatever it puts into the node's transaction is committed by the agent, which then lets it
    pump.
    """

    @property
    def up(self) -> bool:
        """Whether it could send now, as far as it knows; what has no connection always could."""
        ...

    @property
    def last_heard_s(self) -> float | None:
        """When something came from the neighbour, in monotonic time; None for never."""
        ...

    @property
    def next_s(self) -> float | None:
        """When `tick` has something to do, in monotonic time."""
        ...

    def heed(self, outlook: ContactState) -> None:
        """Take note of whether there is contact."""
        ...

    def pump(self) -> None:
        """Send what waits, as far as the link takes it now.

        Raises:
            StoreError: the store cannot be read.
        """
        ...

    def tick(self) -> None:
        """Do what time asks for."""
        ...

    def close(self) -> None:
        """End; what was on its way waits again."""
        ...
