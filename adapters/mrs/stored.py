"""What is to be said of a command that an orbiter stores until there is contact."""

from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final

from adapters.mal.errors import MalError
from adapters.mrs.types import ParameterValue

NEXT_CONTACT: Final = "DTN_NEXT_CONTACT"
"""The parameter by which a relay is known: time until the next contact, 0 during one."""


async def stored(get_value: Callable[[str], Awaitable[Sequence[ParameterValue]]]) -> str | None:
    """Return where a command is that was taken and not heard of; None if the rover itself took it.

    Args:
        get_value: asks the other end for a parameter.

    Raises:
        ConnectionError: the other end does not come back.
    """
    try:
        (value,) = await get_value(NEXT_CONTACT)
    except MalError:
        return None
    left_s = inf if value.value is None else float(value.value.value)
    return f"at the orbiter; {next_contact(left_s, value.timestamp / 1e9)}"


def next_contact(left_s: float, utc_s: float) -> str:
    """Return in words when there is contact: in so many seconds from a time on."""
    if isinf(left_s):
        return "no contact is planned"
    if left_s <= 0.0:
        return "there is contact now"
    return f"next contact at {datetime.fromtimestamp(utc_s + left_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
