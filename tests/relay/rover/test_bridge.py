"""The rover's end of the relay: strings become bundles, and bundles strings on the topics."""

import asyncio
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.bundle import BundleError
from adapters.mops import LinkHealth, Message, health_message, load_dictionary, refusal_of, reply_of
from adapters.relay.rover.bridge import LONGEST_PAYLOAD, MOST_QUEUED, BundleBridge, SendQueue
from executive.commands.catalogue import Stop
from executive.reports import Identity, Kind, Report, Severity, Stage
from tests.relay.rover.ends import (
    DICTIONARY,
    ROVER,
    SPELLING,
    Ends,
    command,
    event,
    number_in,
    octets,
    settings_of,
    telemetry,
    until,
)

QUEUE = 3


@pytest.fixture
def ends(tmp_path: Path) -> Ends:
    return Ends(tmp_path)


@pytest.fixture
def link(ends: Ends) -> Iterator[BundleBridge]:
    link = ends.link()
    link.start()
    yield link
    link.close()
    assert not link.alive


async def test_commands_arrive_in_order_and_once_whatever_is_in_a_bundle(
    ends: Ends, link: BundleBridge
) -> None:
    stop = DICTIONARY.command(Stop(), Identity("MOE", 3), "JACKAL")

    async with ends.orbiter() as orbiter:
        await orbiter.send(ROVER, octets(command(1), command(2)))
        await orbiter.send(ROVER, b"FLY#" + octets(stop) + b"half")
        await orbiter.send(ROVER, b"\xff\x00 nothing at all")
        await orbiter.send(ROVER, b"x" * (LONGEST_PAYLOAD + 1))
        await orbiter.send(ROVER, octets(command(4)))
        await until(lambda: len(ends.rover.commands) == 3)
        await until(lambda: link.refused == 4)
    assert ends.rover.commands == [f"{command(1)}{command(2)}", str(stop), str(command(4))]


async def test_reports_arrive_and_are_said_to_be_kept_in_their_order(
    ends: Ends, link: BundleBridge
) -> None:
    for number in range(1, 301):
        link.notify(str(event(number)))

    async with ends.orbiter():
        await until(lambda: len(ends.reports) == 300)
    assert sorted(ends.reports, key=number_in) == [event(number) for number in range(1, 301)]
    assert ends.rover.numbers == list(range(1, 301))


def test_a_command_waits_until_somebody_takes_it_and_survives_a_restart(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    ends.rover.there.clear()
    link = ends.link()
    link.start()

    async def send() -> None:
        async with ends.orbiter() as orbiter:
            await orbiter.send(ROVER, octets(command(1)))
            await until(lambda: link.health is not None and link.health.unread == 1)

    asyncio.run(send())
    link.close()
    assert ends.rover.commands == []
    assert [each for each in caplog.messages if "nobody listens" in each] == caplog.messages != []
    ends.rover.there.set()
    again = ends.link()
    again.start()
    try:
        asyncio.run(until(lambda: ends.rover.commands == [str(command(1))]))
        asyncio.run(until(lambda: again.health is not None and again.health.unread == 0))
    finally:
        again.close()
    third = ends.link()
    third.start()
    third.close()
    assert ends.rover.commands == [str(command(1))]


def test_what_nobody_is_known_to_have_is_published_again_by_the_next_process(ends: Ends) -> None:
    ends.rover.confirms = False
    first = ends.link()
    first.start()

    async def send() -> None:
        async with ends.orbiter() as orbiter:
            for number in (1, 2):
                await orbiter.send(ROVER, octets(command(number)))
            await until(lambda: len(ends.rover.commands) > 0)
            await until(lambda: first.health is not None and first.health.unread == 2)

    asyncio.run(send())
    first.close()
    assert set(ends.rover.commands) == {str(command(1))}
    ends.rover.commands.clear()
    ends.rover.confirms = True
    second = ends.link()
    second.start()
    try:
        asyncio.run(until(lambda: second.health is not None and second.health.unread == 0))
    finally:
        second.close()
    assert ends.rover.commands == [str(command(1)), str(command(2))]


async def test_a_command_that_is_answered_has_been_taken(ends: Ends, link: BundleBridge) -> None:
    ends.rover.there.clear()

    def unread() -> int:
        return -1 if link.health is None else link.health.unread

    async with ends.orbiter() as orbiter:
        await orbiter.send(ROVER, octets(command(1), command(2)))
        await until(lambda: unread() == 1)
        for number in (1, 2):
            link.notify(str(refusal_of(command(number), "JACKAL", "no")))
        await until(lambda: unread() == 0)


def test_in_the_dark_reports_are_kept_and_of_telemetry_the_newest(ends: Ends) -> None:
    link = ends.link()
    link.start()
    for number in range(1, 21):
        link.notify(str(event(number)))
    asyncio.run(until(lambda: len(ends.rover.numbers) == 20))
    asyncio.run(until(lambda: link.health is not None and link.health.queued >= 20))
    for number in range(10):
        link.notify(str(telemetry(float(number))))

    async def session() -> None:
        async with ends.orbiter():
            await until(lambda: any(message.command == "TELEMETRY" for message in ends.heard))

    try:
        asyncio.run(session())
    finally:
        link.close()
    assert sorted(ends.reports, key=number_in) == [event(number) for number in range(1, 21)]
    told = [message for message in ends.heard if message.command == "TELEMETRY"]
    assert told == [telemetry(9.0)]


def test_what_ends_with_its_lifetime_is_logged_once(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    settings = replace(settings_of(*ends.ports), lifetime_s=0.2)
    link = BundleBridge(settings, ends.folder / "relay.db", None, DICTIONARY, ends.rover)
    link.start()
    link.notify(str(event(1)))
    asyncio.run(until(lambda: ends.rover.numbers == [1]))
    asyncio.run(until(lambda: "LIFETIME_EXPIRED" in caplog.text))
    link.close()
    (line,) = [each for each in caplog.messages if "ipn:2.1" in each]
    assert line.endswith("to ipn:1.1 deleted: LIFETIME_EXPIRED")


async def test_the_ground_hears_how_the_relay_is(ends: Ends, link: BundleBridge) -> None:
    async with ends.orbiter():
        await until(lambda: any(message.command == "LINK" for message in ends.heard))
    assert link.alive


def test_an_address_that_is_taken_is_told(ends: Ends, link: BundleBridge) -> None:
    second = BundleBridge(
        settings_of(*ends.ports), ends.folder / "second.db", None, load_dictionary(), ends.rover
    )
    assert link.alive
    with pytest.raises((OSError, BundleError)):
        second.start()
    second.close()


@given(st.lists(st.integers(1, 50)), st.integers(0, 100), st.integers(1, 10))
def test_reports_come_all_in_order_and_once_each(
    numbers: list[int], queued: int, most: int
) -> None:
    whole = SendQueue(DICTIONARY, QUEUE)
    for number in numbers:
        assert whole.put(event(number))
    taken: list[Message] = []
    while some := whole.take(queued, most):
        assert len(some) <= most
        taken += some
    assert taken == [event(number) for number in dict.fromkeys(numbers)]


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.integers(0, 10))
def test_of_telemetry_the_newest_comes_once_little_waits(values: list[float], queued: int) -> None:
    some = SendQueue(DICTIONARY, QUEUE)
    for value in values:
        some.put(telemetry(value))
    assert list(some.take(QUEUE + 1, 10)) == []
    expected = [telemetry(values[-1])] if queued <= QUEUE else []
    assert list(some.take(queued, 10)) == expected
    assert list(some.take(0, 10)) == ([] if expected else [telemetry(values[-1])])


def test_reports_go_before_telemetry_and_health_is_telemetry() -> None:
    some = SendQueue(DICTIONARY, QUEUE)
    health = health_message(LinkHealth(1.0, 0, 0.0, None, None, 0, 0), SPELLING.link, "JACKAL")
    for message in (telemetry(1.0), health, event(1)):
        some.put(message)
    assert list(some.take(0, 10)) == [event(1), telemetry(1.0), health]


def test_more_reports_than_there_is_room_for_are_refused() -> None:
    some = SendQueue(DICTIONARY, QUEUE)
    assert all(some.put(event(number)) for number in range(1, MOST_QUEUED + 1))
    assert not some.put(event(MOST_QUEUED + 1))
    assert some.put(telemetry(1.0))


def test_what_has_a_number_can_be_taken_over() -> None:
    command = DICTIONARY.command(Stop(), Identity("MOE", 7), "JACKAL")
    report = Report(
        12,
        1.0,
        Kind.COMMAND,
        Severity.INFORMATIONAL,
        "Stop",
        identity=Identity("MOE", 7),
        stage=Stage.STARTED,
    )
    some = SendQueue(DICTIONARY, QUEUE)
    assert some.number_of(event(5)) == 5
    assert some.number_of(reply_of(report, DICTIONARY.commands["stop"], "JACKAL")) == 12
    assert some.number_of(refusal_of(command, "JACKAL", "no")) is None
    assert some.number_of(replace(event(5), code=0xFFF)) is None
    assert some.number_of(telemetry(1.0)) is None
