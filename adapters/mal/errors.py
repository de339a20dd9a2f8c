"""Errors of the MAL as exceptions: error replies, and errors of the codec."""

from enum import Enum
from typing import Any

from adapters.mal.values import AttributeType, TypedAttribute


class StandardError(Enum):
    """Error numbers of MAL area version 3 (CCSDS 521.0-B-3)."""

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
    """An interaction ended with an error; raised by handlers and by the consumer's calls.

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
        """Return number, name of a standard error, and extra information."""
        names = [f" {error.name}" for error in StandardError if error.value == self.number]
        head = f"MAL error {self.number}{''.join(names)}"
        return head if self.extra is None else f"{head}: {getattr(self.extra, 'value', self.extra)}"


def too_many(text: str) -> MalError:
    """Return the TOO_MANY error; the text names the bound."""
    return MalError(StandardError.TOO_MANY, text)


class DecodeError(ValueError):
    """Octets do not match the specification and the encoding."""


class EncodeError(ValueError):
    """A value does not match its type in the specification."""


class SpecificationError(ValueError):
    """A service specification is unreadable, incomplete or contradictory."""
