"""The broker's matching rules, one by one."""

import pytest

from adapters.mal.mal_area import Subscription, SubscriptionFilter
from adapters.mal.matching import Keys, domain_matches, matches
from adapters.mal.values import AttributeType, Typed


def domain(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(part for part in text.split(".") if part)


@pytest.mark.parametrize(
    ("wanted", "there", "match"),
    [
        (None, "esa.rover", True),
        (None, None, True),
        ("", "esa.rover", True),
        ("", None, False),
        ("esa", None, False),
        ("*", None, False),
        ("*", "esa.rover", True),
        ("*", "", True),
        ("esa.rover", "esa.rover", True),
        ("esa.rover", "esa.crane", False),
        ("esa.rover", "esa", False),
        ("esa", "esa.rover", False),
        ("esa.*", "esa", True),
        ("esa.*", "esa.rover.arm", True),
        ("esa.*", "nasa.rover", False),
        ("*.rover", "rover", True),
        ("*.rover", "esa.mars.rover", True),
        ("*.rover", "esa.rover.arm", False),
        ("esa.*.arm", "esa.rover.arm", True),
        ("esa.*.arm", "esa.arm", False),
        ("*.rover.*", "esa.rover.arm", True),
        ("*.rover.*", "rover", True),
        ("*.rover.*", "esa.crane", False),
        ("*.a.*.c.*", "x.a.b.c", True),
        ("*.a.*.c.*", "x.a.b.d", False),
        ("*.*", "", True),
    ],
)
def test_domains(wanted: str | None, there: str | None, match: bool) -> None:
    assert domain_matches(domain(wanted), domain(there)) is match


def identifier(value: str) -> Typed:
    return Typed(AttributeType.IDENTIFIER, value)


KEYS: Keys = {
    "parameter": identifier("POS_X"),
    "commandId": Typed(AttributeType.LONG, 7),
    "stage": Typed(AttributeType.UOCTET, 3),
    "source": None,
}


@pytest.mark.parametrize(
    ("filters", "match"),
    [
        (None, True),
        ({}, True),
        ({"parameter": []}, True),
        ({"parameter": [identifier("POS_X")]}, True),
        ({"parameter": [Typed(AttributeType.STRING, "POS_X")]}, True),
        ({"parameter": [identifier("POS_Y")]}, False),
        ({"parameter": [identifier("POS_Y"), identifier("POS_X")]}, True),
        ({"parameter": [identifier("*")]}, True),
        ({"source": [identifier("*")]}, True),
        ({"source": [identifier("MOE")]}, False),
        ({"source": [None]}, True),
        ({"parameter": [None]}, False),
        ({"commandId": [Typed(AttributeType.LONG, 7)]}, True),
        ({"commandId": [Typed(AttributeType.INTEGER, 7)]}, False),
        ({"commandId": [Typed(AttributeType.LONG, 8)]}, False),
        ({"commandId": [Typed(AttributeType.LONG, 0)]}, True),
        ({"stage": [Typed(AttributeType.UOCTET, 0)]}, False),
        ({"stage": [Typed(AttributeType.UOCTET, 3)]}, True),
        ({"colour": []}, False),
        ({"parameter": [identifier("POS_X")], "stage": [Typed(AttributeType.UOCTET, 4)]}, False),
    ],
)
def test_filters(filters: dict[str, list[Typed]] | None, match: bool) -> None:
    subscription = Subscription(
        subscriptionId="s",
        filters=None
        if filters is None
        else tuple(SubscriptionFilter(name=n, values=tuple(v)) for n, v in filters.items()),
    )
    assert matches(subscription, ("esa",), KEYS) is match
