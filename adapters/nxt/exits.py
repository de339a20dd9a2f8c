"""Where messages leave the router, and how many did."""

from dataclasses import dataclass
from typing import Protocol

from adapters.mops.message import Message
from adapters.nxt.record import Link


class Exits(Protocol):
    """Where messages leave the router. None of them may block."""

    def to_brick(self, octets: bytes, visit: int | None) -> bool:
        """Send octets to the brick; return False where it cannot take them.

        Args:
            octets: a whole message.
            visit: the time that the brick is there for which they are meant; None does not care.
        """
        ...

    def notify(self, link: Link, message: Message) -> None:
        """Give a link a notification."""
        ...

    def telemetry(self, message: Message) -> None:
        """Publish what the brick measures."""
        ...


@dataclass(slots=True)
class Counts:
    """What passed since the start, and what did not.

    Attributes:
        commands, repeats: from the links; what comes again is not passed on.
        replies, unasked, telemetry: from the brick.
        refused: messages, and pieces that are none, that went nowhere.
        dropped_octets, dropped_pieces: what was no message, from the links and the brick.
        waiting: commands of the relay that wait for the brick now.
    """

    commands: int = 0
    repeats: int = 0
    replies: int = 0
    unasked: int = 0
    telemetry: int = 0
    refused: int = 0
    dropped_octets: int = 0
    dropped_pieces: int = 0
    waiting: int = 0
