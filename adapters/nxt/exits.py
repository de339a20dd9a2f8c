"""Where messages leave the router, and how many did."""

from dataclasses import dataclass
from typing import Protocol

from adapters.mops.message import Message
from adapters.nxt.record import Link


class Exits(Protocol):
    """Where messages leave the router. None of them may block."""

    def to_brick(self, octets: bytes) -> bool:
        """Send octets to the brick; return False where it cannot take them."""
        ...

    def notify(self, link: Link, message: Message) -> None:
        """Give a link a notification."""
        ...

    def telemetry(self, message: Message) -> None:
        """Publish what the brick measures."""
        ...


@dataclass(slots=True)
class Counts:
    """What passed since the start, and what did not."""

    commands: int = 0
    repeats: int = 0
    replies: int = 0
    unasked: int = 0
    telemetry: int = 0
    refused: int = 0
