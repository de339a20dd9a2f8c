"""What an agent asks of the daemon that carries for it, whichever daemon that is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from adapters.bundle.eid import Eid
from adapters.bundle.values import Creation


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


Told = Callable[[str | None], None]
"""Is told once what became of something: None for taken, or why it was not, as far as is known."""

Hear = Callable[[Inbound, Told], None]
"""Takes what a daemon delivers, and tells when it is on the disk, or why it is not."""


class Daemon(Protocol):
    """A client of a daemon; everything happens on the loop of `open`."""

    @property
    def up(self) -> bool:
        """Whether the daemon answers."""
        ...

    async def open(self, hear: Hear, wake: Callable[[], None]) -> None:
        """Attach, or go on trying: a daemon may be started later, and again.

        Args:
            hear: takes what arrives.
            wake: is called when `up` has changed.

        Raises:
            BundleError: it will not do so either later; the text says what is missing or wrong.
        """
        ...

    def post(self, data: Outbound, told: Told) -> None:
        """Hand something to the daemon, and tell of it in some later turn of the loop."""
        ...

    async def close(self) -> None:
        """Detach; what is under way is waited for a while, and its end told."""
        ...
