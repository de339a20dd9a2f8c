"""How the relay link is doing, as a MOPS message, and back."""

from dataclasses import dataclass

from adapters.mops.dictionary import OtherEntry
from adapters.mops.message import Message, MopsError
from adapters.mops.reports import LATEST_UTC_S, TO_ALL, require_within
from adapters.mops.values import made_of, values_of


@dataclass(frozen=True, slots=True)
class LinkHealth:
    """What the bundle agent at one end of the relay tells of itself.

    Attributes:
        utc_s: when, seconds since 1970-01-01 UTC.
        queued: bundles that wait to be sent.
        oldest_s: how long the oldest of them has waited.
        next_contact_utc_s: when the next contact is planned to begin; None if none is.
        last_heard_s: how long ago something came from the other end; None for never.
        unread: bundles that wait to be published.
        refused: messages that were refused since the start.
    """

    utc_s: float
    queued: int
    oldest_s: float
    next_contact_utc_s: float | None
    last_heard_s: float | None
    unread: int
    refused: int


def health_message(health: LinkHealth, entry: OtherEntry, source: str) -> Message:
    """Return the message that tells it.

    Raises:
        MopsError: a number is not finite.
    """
    outputs = tuple(values_of(health))
    return Message(entry.code, source, TO_ALL, entry.command, outputs=outputs, received=True)


def health_of(message: Message, entry: OtherEntry) -> LinkHealth:
    """Return what a message tells.

    Raises:
        MopsError: it is none of a link, or a value does not fit.
    """
    if (message.code, message.command) != (entry.code, entry.command) or message.inputs:
        raise MopsError(f"{message.code:03X} {message.command} tells nothing of a link")
    if len(message.outputs) != len(LinkHealth.__slots__):
        raise MopsError(f"outputs: {len(message.outputs)}, not {len(LinkHealth.__slots__)}")
    health: LinkHealth = made_of(LinkHealth, message.outputs)
    require_within("utc_s", health.utc_s, 0, LATEST_UTC_S)
    return health
