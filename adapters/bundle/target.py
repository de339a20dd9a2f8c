"""Where an address leads: a name is looked up beside the loop, and again until it is found."""

import asyncio
import socket
from collections.abc import Callable
from typing import Final

from adapters.bundle.backoff import Backoff
from adapters.bundle.settings import Address

AGAIN_S: Final = 1.0
"""The shortest pause before a name that is not found is looked up again; it doubles up to 30 s."""
Where = tuple[str, int]


class Target:
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
        self.where: Where | None = None
        try:
            found = socket.getaddrinfo(
                address.host, address.port, family, socket.SOCK_DGRAM, 0, socket.AI_NUMERICHOST
            )
        except OSError:
            return
        self.where = _where(found[0][4])

    def find(self, found: Callable[[Where], None]) -> None:
        """Tell where it is as soon as that is known."""
        if self.where is not None:
            found(self.where)
        else:
            self._looking = asyncio.get_running_loop().create_task(self._look(found))

    def close(self) -> None:
        """Look no more."""
        if self._looking is not None:
            self._looking.cancel()

    async def _look(self, found: Callable[[Where], None]) -> None:
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


def _where(address: tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes]) -> Where:
    host, port = address[:2]
    return str(host), int(port)
