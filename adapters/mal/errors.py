"""Errors of the MAL: those that travel as a reply, and those of the codec."""

from enum import Enum
from typing import Any

from adapters.mal.values import AttributeType, TypedAttribute


class StandardError(Enum):
    """The error numbers of MAL area version 3 (CCSDS 521.0-B-3)."""

    DELIVERY_FAILED = 65536
    DELIVERY_TIMEDOUT = 65537
    DELIVERY_DELAYED = 65538
    DESTINATION_UNKNOWN = 65539
    DESTINATION_TRANSIENT = 65540
    DESTINATION_LOST = 65541
    AUTHENTICATION_FAILED = 65542
    AUTHORISATION_FAIL = 65543
    ENCRYPTION_FAIL = 65544
    UNSUPPORTED_AREA = 65545
    UNSUPPORTED_AREA_VERSION = 65546
    UNSUPPORTED_SERVICE = 65547
    UNSUPPORTED_OPERATION = 65548
    BAD_ENCODING = 65549
    INTERNAL = 65550
    UNKNOWN = 65551
    INCORRECT_STATE = 65552
    TOO_MANY = 65553
    SHUTDOWN = 65554
    TRANSACTION_TIMEOUT = 65555


class MalError(Exception):
    """An interaction ends with an error; a handler raises it, and so does the consumer's call.

    Attributes:
        number: A `StandardError` value, or a number of the service's own area.
        extra: The extra information: None, or any Element (attributes as `TypedAttribute`, lists as
            `TypedList`); a text that was given is a `TypedAttribute` String.
    """

    def __init__(self, number: int | StandardError, extra: Any = None) -> None:
        self.number = number.value if isinstance(number, StandardError) else number
        self.extra: Any = (
            TypedAttribute(AttributeType.STRING, extra) if isinstance(extra, str) else extra
        )
        super().__init__(self.number, self.extra)

    def __str__(self) -> str:
        """Name the number where it is a standard one, then the extra information."""
        names = [f" {error.name}" for error in StandardError if error.value == self.number]
        head = f"MAL error {self.number}{''.join(names)}"
        return head if self.extra is None else f"{head}: {getattr(self.extra, 'value', self.extra)}"


def too_many(text: str) -> MalError:
    """Make the error that names the bound that was reached."""
    return MalError(StandardError.TOO_MANY, text)


class DecodeError(ValueError):
    """Octets are not what the specification and the encoding say they should be."""


class EncodeError(ValueError):
    """A value does not fit the type that the specification gives it."""


class SpecificationError(ValueError):
    """A service specification cannot be used: unreadable, incomplete or contradicting itself."""
