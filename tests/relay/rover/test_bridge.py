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
from adapters.mops import LinkHealth, fingerprint, health_message, load_dictionary
from adapters.relay.rover.bridge import (
    MAX_PAYLOAD_OCTETS,
    MAX_QUEUED_REPORTS,
    BundleBridge,
    ReportBatch,
    SendQueue,
)
from executive.commands.catalogue import Stop
from executive.values.reports import Identity
from tests.relay.rover.ends import (
    DICTIONARY,
    ROVER,
    SPELLING,
    Ends,
    bridge_of,
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


def unread(link: BundleBridge) -> int | None:
    return link.health.undelivered if link.health else None


async def test_commands_arrive_in_order_and_once_for_any_bundle(
    ends: Ends, link: BundleBridge
) -> None:
    async with ends.orbiter() as orbiter:
        await orbiter.send(ROVER, octets(command(1), command(2)))
        await orbiter.send(ROVER, b"FLY#" + octets(command(3)) + b"half")
        await orbiter.send(ROVER, b"\xff\x00 nothing at all")
        await orbiter.send(ROVER, b"x" * (MAX_PAYLOAD_OCTETS + 1))
        await orbiter.send(ROVER, octets(command(4)))
        await until(lambda: str(command(4)) in "".join(ends.rover.commands))
        await until(lambda: link.refused == 4)
    assert "".join(ends.rover.commands) == f"{command(1)}{command(2)}{command(3)}{command(4)}"


async def test_reports_arrive_and_are_acknowledged_in_their_order(
    ends: Ends, link: BundleBridge
) -> None:
    for number in range(1, 301):
        link.notify(str(event(number)))

    async with ends.orbiter():
        await until(lambda: len(ends.reports) == 300)
    assert sorted(ends.reports, key=number_in) == [event(number) for number in range(1, 301)]
    assert ends.rover.confirmed == [fingerprint(str(event(number))) for number in range(1, 301)]


def test_a_command_waits_until_its_acknowledgement_and_survives_a_restart(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    ends.rover.there.clear()
    link = ends.link()
    link.start()

    async def send() -> None:
        async with ends.orbiter() as orbiter:
            await orbiter.send(ROVER, octets(command(1)))
            await until(lambda: link.health is not None and link.health.undelivered == 1)

    asyncio.run(send())
    link.close()
    assert ends.rover.commands == []
    assert [each for each in caplog.messages if "no subscriber" in each] == caplog.messages != []
    ends.rover.there.set()
    again = ends.link()
    again.start()
    try:
        asyncio.run(until(lambda: ends.rover.commands == [str(command(1))]))
        asyncio.run(until(lambda: again.health is not None and again.health.undelivered == 0))
    finally:
        again.close()
    third = ends.link()
    third.start()
    third.close()
    assert ends.rover.commands == [str(command(1))]


def test_an_unacknowledged_command_is_published_again_by_the_next_process(ends: Ends) -> None:
    ends.rover.confirms = False
    first = ends.link()
    first.start()

    async def send() -> None:
        async with ends.orbiter() as orbiter:
            for number in (1, 2):
                await orbiter.send(ROVER, octets(command(number)))
            await until(lambda: len(ends.rover.commands) > 0)
            await until(lambda: first.health is not None and first.health.undelivered == 2)

    asyncio.run(send())
    first.close()
    assert str(command(1)) in ends.rover.commands[0]
    ends.rover.commands.clear()
    ends.rover.confirms = True
    second = ends.link()
    second.start()
    try:
        asyncio.run(until(lambda: second.health is not None and second.health.undelivered == 0))
    finally:
        second.close()
    assert "".join(ends.rover.commands) == f"{command(1)}{command(2)}"


async def test_one_confirmation_is_for_the_same_stop_twice(
    ends: Ends, link: BundleBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adapters.relay.rover.bridge.REPUBLISH_S", 5.0)
    ends.rover.confirms_stops = False
    stop = DICTIONARY.command(Stop(), Identity("MOE", 7), "JACKAL")
    async with ends.orbiter() as orbiter:
        await orbiter.send(ROVER, octets(stop), expedited=True)
        await until(lambda: len(ends.rover.stops) == 1)
        await orbiter.send(ROVER, octets(stop), expedited=True)
        await until(lambda: len(ends.rover.stops) == 2)
        before = link.health
        link.on_confirmed(fingerprint(str(stop)))
        await until(lambda: not link.alive or (link.health is not before and unread(link) == 0))
    assert link.alive
    assert ends.rover.stops == [str(stop)] * 2


def test_without_contact_reports_are_stored_and_the_newest_telemetry(ends: Ends) -> None:
    link = ends.link()
    link.start()
    for number in range(1, 21):
        link.notify(str(event(number)))
    asyncio.run(until(lambda: len(ends.rover.confirmed) == 20))
    asyncio.run(until(lambda: link.health is not None and link.health.queued >= 20))
    for number in range(10):
        link.notify(str(telemetry(float(number))))

    async def session() -> None:
        async with ends.orbiter():
            await until(lambda: any(message.command == "TELEMETRY" for message in ends.received))

    try:
        asyncio.run(session())
    finally:
        link.close()
    assert sorted(ends.reports, key=number_in) == [event(number) for number in range(1, 21)]
    reported = [message for message in ends.received if message.command == "TELEMETRY"]
    assert reported == [telemetry(9.0)]


def test_what_ends_with_its_lifetime_is_logged_once(
    ends: Ends, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    settings = replace(settings_of(*ends.ports), lifetime_s=0.2)
    link = bridge_of(settings, ends.folder / "relay.db", ends.rover)
    link.start()
    link.notify(str(event(1)))
    asyncio.run(until(lambda: len(ends.rover.confirmed) == 1))
    asyncio.run(until(lambda: "LIFETIME_EXPIRED" in caplog.text))
    link.close()
    (line,) = [each for each in caplog.messages if "ipn:2.1" in each]
    assert line.endswith("to ipn:1.1 deleted: LIFETIME_EXPIRED")


async def test_the_ground_receives_the_state_of_the_relay(ends: Ends, link: BundleBridge) -> None:
    async with ends.orbiter():
        await until(lambda: any(message.command == "LINK" for message in ends.received))
    assert link.alive


def test_a_used_address_is_reported(ends: Ends, link: BundleBridge) -> None:
    second = BundleBridge(
        settings_of(*ends.ports), ends.folder / "second.db", None, load_dictionary(), ends.rover
    )
    assert link.alive
    with pytest.raises((OSError, BundleError)):
        second.start()
    second.close()


@given(st.lists(st.integers(1, 50)), st.integers(0, 100), st.integers(1, 10))
def test_all_reports_arrive_in_order_and_once_each(
    numbers: list[int], queued: int, maximum: int
) -> None:
    whole = SendQueue(DICTIONARY, QUEUE)
    for number in numbers:
        assert whole.put(str(event(number)), pytest.fail)
    taken: list[ReportBatch] = []
    while some := whole.pop(queued, maximum)[0]:
        assert len(some) <= maximum
        taken += some
    reported = [str(event(number)) for number in dict.fromkeys(numbers)]
    assert taken == [ReportBatch(text, fingerprint(text)) for text in reported]


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.integers(0, 10))
def test_the_newest_telemetry_arrives_once_and_little_waits(
    values: list[float], queued: int
) -> None:
    some = SendQueue(DICTIONARY, QUEUE)
    for value in values:
        some.put(str(telemetry(value)), pytest.fail)
    assert some.pop(QUEUE + 1, 10) == ([], [])
    expected = [telemetry(values[-1])] if queued <= QUEUE else []
    assert some.pop(queued, 10) == ([], expected)
    assert some.pop(0, 10) == ([], [] if expected else [telemetry(values[-1])])


def test_a_string_is_confirmed_by_its_reports_for_any_further_content() -> None:
    some, refused = SendQueue(DICTIONARY, QUEUE), list[str]()
    health = health_message(LinkHealth(1.0, 0, 0.0, None, None, 0, 0), SPELLING.link, "JACKAL")
    text = f"{telemetry(1.0)}{health}{event(1)}FLY#{event(2)}"
    assert some.put(text, refused.append)
    assert len(refused) == 1
    reports = ReportBatch(f"{event(1)}{event(2)}", fingerprint(text))
    assert some.pop(0, 10) == ([reports], [telemetry(1.0), health])


def test_more_reports_than_the_capacity_are_refused() -> None:
    some = SendQueue(DICTIONARY, QUEUE)
    assert all(
        some.put(str(event(number)), pytest.fail) for number in range(1, MAX_QUEUED_REPORTS + 1)
    )
    assert not some.put(str(event(MAX_QUEUED_REPORTS + 1)), pytest.fail)
    assert some.put(str(telemetry(1.0)), pytest.fail)
