"""What another asset may say: bounded in size, so that nobody can fill this one's memory."""

from math import isfinite
from typing import Any, Final

from adapters.mal import AttributeType
from adapters.mrs.spec.headers import LONGEST_SOURCE
from adapters.mrs.spec.types import Notification, ParameterValue, Validity

LONGEST_NAME: Final = 64
LONGEST_TEXT: Final = 4096
MOST_FIGURES: Final = 32
"""Of a notification from outside, so that getNotifications can return a thousand at once."""
LONGEST_FIGURE: Final = 256
"""Characters or octets of what is no number among the figures of a notification."""

NUMBER_TYPES: Final = {
    AttributeType.FLOAT,
    AttributeType.DOUBLE,
    AttributeType.DURATION,
    AttributeType.OCTET,
    AttributeType.UOCTET,
    AttributeType.SHORT,
    AttributeType.USHORT,
    AttributeType.INTEGER,
    AttributeType.UINTEGER,
    AttributeType.LONG,
    AttributeType.ULONG,
}


def is_valid_name(name: str) -> bool:
    """Whether an asset, a parameter or a service may be called so: short, printable, no spaces."""
    return 0 < len(name) <= LONGEST_NAME and name.isprintable() and " " not in name


def is_valid_value(value: ParameterValue) -> bool:
    """Whether it is a finite Double that is VALID, or nothing that is not."""
    if not is_valid_name(value.name):
        return False
    if value.value is None:
        return value.validity is not Validity.VALID
    return value.value.type is AttributeType.DOUBLE and isfinite(value.value.value)


def is_valid_notification(notification: Notification) -> bool:
    """Whether a notification is no larger than those of an executive."""
    figures = notification.parameters or ()
    return (
        len(notification.text or "") <= LONGEST_TEXT
        and len(notification.source or "") <= LONGEST_SOURCE
        and len(figures) <= MOST_FIGURES
        and all(
            len(figure.name) <= LONGEST_SOURCE
            and (figure.value is None or _size(figure.value.value) <= LONGEST_FIGURE)
            for figure in figures
        )
    )


def _size(value: Any) -> int:
    return len(value) if isinstance(value, str | bytes) else 0
