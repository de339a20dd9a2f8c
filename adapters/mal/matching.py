"""Which updates a subscription is for: the broker's rules, as mo-services-java 12 reads them."""

from collections.abc import Sequence
from typing import Final

from adapters.mal.mal_area import Subscription, SubscriptionFilter
from adapters.mal.values import AttributeType, Typed

_ANY: Final = "*"
_TEXTS: Final = (AttributeType.IDENTIFIER, AttributeType.STRING, AttributeType.URI)
_SIGNED: Final = (
    AttributeType.OCTET,
    AttributeType.SHORT,
    AttributeType.INTEGER,
    AttributeType.LONG,
    AttributeType.FLOAT,
    AttributeType.DOUBLE,
)

Keys = dict[str, Typed | None]
"""The key values of an update by the names of the keys, in their order."""


def matches(subscription: Subscription, domain: tuple[str, ...] | None, keys: Keys) -> bool:
    """Whether an update is for a subscription: its domain and all of its filters match."""
    return domain_matches(subscription.domain, domain) and all(
        _filter_matches(key_filter, keys) for key_filter in subscription.filters or ()
    )


def domain_matches(wanted: Sequence[str] | None, domain: Sequence[str] | None) -> bool:
    """Whether a domain is wanted.

    A wanted domain that is NULL takes every domain, an empty one every domain but NULL. A `*`
    stands for one part, at the beginning or the end for any number of parts.
    """
    if wanted is None or domain is None:
        return wanted is None
    if not wanted:
        return True
    open_front, open_end = wanted[0] == _ANY, wanted[-1] == _ANY
    inner = wanted[open_front : len(wanted) - open_end]
    slack = len(domain) - len(inner)
    if slack < 0 or (slack and not open_front and not open_end):
        return False
    first = slack if open_front and not open_end else 0
    last = slack if open_front else 0
    return any(
        all(part in (_ANY, there) for part, there in zip(inner, domain[start:], strict=False))
        for start in range(first, last + 1)
    )


def _filter_matches(key_filter: SubscriptionFilter, keys: Keys) -> bool:
    if key_filter.name not in keys:
        return False
    value = keys[key_filter.name]
    return not key_filter.values or any(
        _value_matches(wanted, value) for wanted in key_filter.values
    )


def _value_matches(wanted: Typed | None, value: Typed | None) -> bool:
    if wanted is None:
        return value is None
    if wanted.type in _TEXTS:
        return wanted.value == _ANY or (
            value is not None and value.type in _TEXTS and wanted.value == value.value
        )
    return (wanted.type in _SIGNED and wanted.value == 0) or wanted == value
