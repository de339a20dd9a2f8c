"""What is to be said of a command that an orbiter stores until there is contact."""

from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final

from adapters.mal import MalError
from adapters.mrs.types import ParameterValue

NEXT_CONTACT: Final = "DTN_NEXT_CONTACT"
"""The parameter by which a relay is known: time until the next contact, 0 during one."""
LAST_HEARD: Final = "DTN_LAST_HEARD"
"""Time since something was heard of the rover."""
OVERRIDE: Final = "DTN_OVERRIDE"
"""What the operator says of contact: 1 up, -1 down, 0 as planned."""


async def stored(get_value: Callable[..., Awaitable[Sequence[ParameterValue]]]) -> str | None:
    """Return where a command is that was taken and not heard of; None if the rover itself took it.

    Args:
        get_value: asks the other end for parameters, by their names.

    Raises:
        ConnectionError: the other end does not come back.
    """
    try:
        values = await get_value(NEXT_CONTACT, LAST_HEARD, OVERRIDE)
    except MalError:
        return None
    left, heard, override = (None if each.value is None else each.value.value for each in values)
    when = next_contact(inf if left is None else float(left), values[0].timestamp / 1e9)
    if override is not None and override < 0:
        when = "the way is held closed by the operator until CONTACT PLAN"
    elif heard is None:
        when += "; nothing was heard of the rover yet"
    return f"at the orbiter; {when}"


def next_contact(left_s: float, utc_s: float) -> str:
    """Return in words when there is contact: in so many seconds from a time on."""
    if isinf(left_s):
        return "there is no contact, and none is planned"
    if left_s <= 0.0:
        return "there is contact now"
    return f"next contact at {datetime.fromtimestamp(utc_s + left_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
