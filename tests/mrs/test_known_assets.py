"""What is kept of others: the last of what they said, in order, and never too much of it."""

import asyncio
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mal import AttributeType, MalError, NamedValue, TypedAttribute
from adapters.mrs.fleet import known_assets as histories
from adapters.mrs.fleet.fleet_subscriber import FIRST_PAGE, missed_notifications
from adapters.mrs.fleet.known_assets import (
    MAX_ASSETS,
    MAX_NOTIFICATIONS,
    MAX_OCTETS,
    MAX_PARAMETERS,
    KnownAssets,
    NotificationHistory,
)
from adapters.mrs.spec import (
    Notification,
    ParameterValue,
    Validity,
    is_valid_name,
    is_valid_notification,
    is_valid_value,
)
from tests.mrs.aboard import event, raises, reading


def notification_of(sequence: int, text: str = "", figures: int = 0) -> Notification:
    figure = NamedValue(name="x", value=TypedAttribute(AttributeType.DOUBLE, 1.0))
    return event(sequence=sequence, text=text, parameters=(figure,) * figures)


def numbers(
    history: NotificationHistory, first: int = 0, count: int = MAX_NOTIFICATIONS
) -> list[int]:
    return [each.sequence for each in history.since(first, count)]


@given(
    st.lists(
        st.tuples(st.integers(0, 40), st.sampled_from(["", "other"]), st.integers(0, 2)),
        max_size=120,
    )
)
def test_a_history_holds_the_last_reports_in_order(
    reported: list[tuple[int, str, int]],
) -> None:
    bounds = pytest.MonkeyPatch()
    bounds.setattr(histories, "MAX_NOTIFICATIONS", 10)
    bounds.setattr(histories, "MAX_OCTETS", 8000)
    try:
        history = NotificationHistory()
        stored: list[Notification] = []
        for one in (notification_of(number, text, figures) for number, text, figures in reported):
            known = one in stored
            assert history.add(one) is not known
            if not known:
                stored = [one] if stored and one.sequence <= stored[-1].sequence else [*stored, one]
            held = list(history.since(0, 100))
            assert held == stored[len(stored) - len(held) :]
            stored = held
            assert history.last == one or known
            assert 1 <= len(held) <= 10
        for first in (0, 7, 41):
            assert (
                numbers(history, first, 3)
                == [k.sequence for k in stored if k.sequence >= first][:3]
            )
    finally:
        bounds.undo()


def test_a_thousand_short_ones_fit_and_long_ones_are_fewer() -> None:
    history = NotificationHistory()
    for number in range(1, 3 * MAX_NOTIFICATIONS):
        history.add(notification_of(number, "executed"))
    assert numbers(history) == list(range(2 * MAX_NOTIFICATIONS, 3 * MAX_NOTIFICATIONS))
    for number in range(1, MAX_NOTIFICATIONS):
        history.add(notification_of(number, "x" * 4096, figures=32))
    assert 0 < len(numbers(history)) < MAX_OCTETS / 8192
    assert numbers(history)[-1] == MAX_NOTIFICATIONS - 1


def test_a_repeat_is_no_change_and_a_lower_number_is_a_new_ledger() -> None:
    history = NotificationHistory()
    assert [history.add(notification_of(number)) for number in (1, 2, 2, 1, 3)] == [
        True,
        True,
        False,
        False,
        True,
    ]
    assert history.add(notification_of(2, "otherwise"))
    assert numbers(history) == [2]


@given(st.lists(st.text(max_size=3), max_size=3 * MAX_ASSETS))
def test_the_size_of_a_fleet_is_bounded(names: list[str]) -> None:
    fleet = KnownAssets("jackal")
    for name in (*names, *map(str, range(2 * MAX_ASSETS)), "jackal"):
        try:
            other = fleet.find_or_add(name)
        except MalError:
            assert not is_valid_name(name) or name == "jackal"
            continue
        assert fleet.find(name) is other
        assert len(fleet.others) <= MAX_ASSETS
    assert not fleet.knows("jackal")


def test_those_of_the_service_layer_above_are_not_replaced() -> None:
    fleet = KnownAssets("jackal")
    for number in range(MAX_ASSETS):
        fleet.find_or_add(f"scout{number}").above = True
    with raises(65553):
        fleet.find_or_add("mule")
    assert fleet.find_or_add("scout3").asset == "scout3"


@pytest.mark.parametrize(("name", "number"), [("", 1), ("two words", 1), ("jackal", 3)])
def test_the_reserved_name_is_refused(name: str, number: int) -> None:
    with raises(number):
        KnownAssets("jackal").find_or_add(name)


def test_the_parameters_of_an_asset_are_bounded() -> None:
    scout = KnownAssets("jackal").find_or_add("scout")
    for number in range(MAX_PARAMETERS):
        scout.add_value(reading(f"P{number}"))
    with pytest.raises(MalError):
        scout.add_value(reading("ONE_MORE"))
    scout.add_value(reading("P3", 2.0))
    assert scout.values["P3"] == reading("P3", 2.0)


@pytest.mark.parametrize(
    "value",
    [
        reading(""),
        reading("x" * 65),
        reading("two words"),
        reading("HEAD", float("nan")),
        reading("HEAD", None, validity=Validity.VALID),
        replace(
            reading("HEAD"),
            validity=Validity.INVALID,
            value=TypedAttribute(AttributeType.STRING, "1"),
        ),
    ],
)
def test_a_value_is_a_finite_double_or_invalid(value: ParameterValue) -> None:
    assert not is_valid_value(value)


@pytest.mark.parametrize(
    "notification",
    [
        notification_of(1, "x" * 4097),
        notification_of(1, figures=33),
        replace(notification_of(1), source="x" * 257),
        replace(notification_of(1), parameters=(NamedValue(name="n" * 257),)),
        replace(
            notification_of(1),
            parameters=(
                NamedValue(name="n", value=TypedAttribute(AttributeType.BLOB, bytes(999))),
            ),
        ),
    ],
)
def test_a_notification_is_of_a_sound_size(notification: Notification) -> None:
    assert is_valid_notification(notification_of(1, "x" * 4096, figures=32))
    assert not is_valid_notification(notification)


class Above:
    """What asking for the past needs of a consumer, and how often it was asked."""

    def __init__(self, remembered: list[Notification]) -> None:
        self._remembered = remembered
        self.requested = 0

    async def request(self, _: str, __: str, ___: str, since: int, maximum: int) -> tuple[Any]:
        self.requested += 1
        found = [each for each in self._remembered if each.sequence >= since]
        return (tuple(found[: maximum or 7]),)

    def missed(self, last: Notification | None) -> list[int]:
        async def gather() -> list[int]:
            return [each.sequence async for each in missed_notifications(self, "scout", last)]  # type: ignore[arg-type]

        return asyncio.run(gather())


@given(st.sets(st.integers(1, 100_000), max_size=40))
def test_the_past_of_a_stranger_is_its_last_hundred(sequences: set[int]) -> None:
    remembered = sorted(sequences)
    above = Above([notification_of(number) for number in remembered])
    newest = max(remembered, default=0)
    assert above.missed(None) == [number for number in remembered if number > newest - FIRST_PAGE]
    assert above.requested < 60


@given(st.integers(1, 60), st.integers(1, 60))
def test_missed_reports_are_those_after_the_last_received(received: int, newest: int) -> None:
    above = Above([notification_of(number) for number in range(1, newest + 1)])
    if received <= newest:
        assert above.missed(notification_of(received)) == list(range(received + 1, newest + 1))
    else:
        assert above.missed(notification_of(received)) == list(
            range(max(1, newest - FIRST_PAGE + 1), newest + 1)
        )


def test_after_another_ledger_all_that_is_new_was_missed() -> None:
    above = Above([notification_of(number, "anew") for number in range(1, 31)])
    assert above.missed(notification_of(12)) == list(range(1, 31))
