"""What a handler gets and gives."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from adapters.mal.connection import Connection
from adapters.mal.mal_area import NamedValue

Parts = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Call:
    """What a handler is told beside the parts of the message.

    Attributes:
        service: Name of the service.
        operation: Name of the operation.
        from_uri: Who calls.
        transaction_id: The interaction, as the caller numbered it.
        supplements: Named attributes that came with the header.
        connection: The connection it came on.
    """

    service: str
    operation: str
    from_uri: str | None
    transaction_id: int
    supplements: tuple[NamedValue, ...]
    connection: Connection


Handler = Callable[..., Awaitable[Parts | None] | Parts | None]
"""Called as `handler(call, *parts)`, or `handler(interaction, *parts)` for INVOKE and PROGRESS;
returns None, a tuple of parts, or an awaitable of either."""
