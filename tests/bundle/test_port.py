"""What an application may rely on, whoever carries the bundles."""

import asyncio
from pathlib import Path

import pytest

from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import AgentClosed, StoreFull
from adapters.bundle.links.contact import ContactOverride
from adapters.bundle.node.database import StoreLimits
from adapters.bundle.node.reporting import DeliveryStatus
from tests.bundle.worlds import (
    ATTACHED_BY_PAYLOAD,
    CONFIRMING,
    ONE,
    TWO,
    Kind,
    payloads_of,
    send_all,
    world,
)

every_kind = pytest.mark.parametrize("kind", [Kind.EMBEDDED, Kind.ION])


@pytest.mark.parametrize("kind", Kind)
async def test_a_sent_message_arrives_once_with_its_sender_and_both_are_notified(
    kind: Kind, tmp_path: Path
) -> None:
    async with world(kind, tmp_path) as there, there.both() as (one, two):
        await there.repeat()
        payloads = payloads_of(40)
        await asyncio.gather(send_all(one, TWO, payloads), send_all(two, ONE, payloads))
        assert sorted(await two.take(40)) == payloads
        assert sorted(await one.take(40)) == payloads
        await one.agent.send(TWO, b"last")
        last = await two.take_one()
        assert (last.payload, last.source, last.endpoint) == (b"last", ONE, TWO)
        await one.until(lambda: one.agent.health().queued == 0)
        await one.until(lambda: len(one.notices) == 41)
        assert {notice.status for notice in one.notices} == {DeliveryStatus.HANDED_ON}
        (neighbour,) = two.agent.health().neighbours
        assert neighbour.contact
        assert neighbour.last_received_s is not None
        (to_two,) = one.agent.health().neighbours
        traffic = to_two.traffic
        assert (traffic.sent, traffic.acknowledged) == (41, 41)
        assert traffic.received >= 40
        assert (traffic.round_trip_s is not None) == (kind is Kind.EMBEDDED)
        assert one.agent.queued_octets(to_two.node) == 0


@every_kind
async def test_payloads_are_octets_of_any_kind_and_length(kind: Kind, tmp_path: Path) -> None:
    async with world(kind, tmp_path) as there, there.both() as (one, two):
        for payload in (b"\0", bytes(range(256)), b"\xff" * 100_000):
            await one.agent.send(TWO, payload)
            assert await two.take(1) == [payload]


@every_kind
async def test_a_message_sent_without_contact_outlives_its_agent_and_arrives_later(
    kind: Kind, tmp_path: Path
) -> None:
    payloads = payloads_of(20)
    async with world(kind, tmp_path) as there, there.agent(2) as two:
        await there.darken()
        async with there.agent(1) as one:
            await send_all(one, TWO, payloads[:10])
        async with there.agent(1) as one:
            await send_all(one, TWO, payloads[10:])
            assert one.agent.health().queued == 20
            await there.darken(False)
            assert sorted(await two.take(20)) == payloads
            await one.until(lambda: one.agent.health().queued == 0)
        async with there.agent(1) as one:
            await one.agent.send(TWO, b"nothing between")
            assert await two.take(1) == [b"nothing between"]


@every_kind
async def test_a_message_not_retained_by_an_application_is_delivered_again(
    kind: Kind, tmp_path: Path
) -> None:
    async with world(kind, tmp_path) as there, there.agent(1) as one:
        async with there.agent(2) as two:
            await one.agent.send(TWO, b"x")
            with pytest.raises(ZeroDivisionError):
                async with two.agent.receive() as first:
                    raise ZeroDivisionError
        async with there.agent(2) as two:
            assert await two.take_one() == first
            await one.agent.send(TWO, b"y")
            assert await two.take(1) == [b"y"]


@every_kind
async def test_an_expired_message_is_reported_and_not_delivered(kind: Kind, tmp_path: Path) -> None:
    async with world(kind, tmp_path) as there, there.both() as (one, two):
        one.agent.override(Ipn(2, 0), ContactOverride.DOWN)
        assert not one.agent.health().neighbours[0].contact
        await one.agent.send(TWO, b"too late", lifetime_s=0.2)
        await one.until(lambda: bool(one.notices))
        assert [notice.status for notice in one.notices] == [DeliveryStatus.EXPIRED]
        assert one.agent.health().neighbours[0].traffic.expired == 1
        one.agent.override(Ipn(2, 0), ContactOverride.BY_PLAN)
        await one.agent.send(TWO, b"in time")
        assert await two.take(1) == [b"in time"]


@every_kind
async def test_a_store_that_is_full_refuses_and_takes_again_when_it_is_not(
    kind: Kind, tmp_path: Path
) -> None:
    limits = {1: StoreLimits(max_octets=150_000)}
    async with world(kind, tmp_path, limits) as there, there.both() as (one, two):
        one.agent.override(Ipn(2, 0), ContactOverride.DOWN)
        sent = 0
        while not one.agent.health().full_text:
            await one.agent.send(TWO, bytes(2000))
            sent += 1
        with pytest.raises(StoreFull):
            await one.agent.send(TWO, b"x")
        one.agent.override(Ipn(2, 0), ContactOverride.UP)
        assert len(await two.take(sent)) == sent
        await one.until(lambda: not one.agent.health().full_text)
        await one.agent.send(TWO, b"again")
        assert await two.take(1) == [b"again"]


@every_kind
async def test_a_receiver_that_is_full_loses_nothing(kind: Kind, tmp_path: Path) -> None:
    limits = {2: StoreLimits(max_octets=100_000)}
    async with world(kind, tmp_path, limits) as there, there.both() as (one, two):
        payloads = [b"%04d" % number + bytes(8000) for number in range(15)]
        await send_all(one, TWO, payloads)
        await two.until(lambda: bool(two.agent.health().full_text))
        assert sorted(await two.take(15)) == payloads


@every_kind
async def test_a_closed_agent_reports_it(kind: Kind, tmp_path: Path) -> None:
    async with world(kind, tmp_path) as there, there.agent(1) as one:
        waiting = asyncio.create_task(one.take(1))
        await asyncio.sleep(0)
        await one.agent.close()
        with pytest.raises(AgentClosed):
            await waiting
        with pytest.raises(AgentClosed):
            await one.agent.send(TWO, b"x")


@every_kind
async def test_only_neighbours_are_reached(kind: Kind, tmp_path: Path) -> None:
    async with world(kind, tmp_path) as there, there.agent(1) as one:
        for absent in (Ipn(3, 1), Ipn(1, 2), Ipn(0, 0)):
            with pytest.raises(ValueError, match="no neighbour reaches"):
                await one.agent.send(absent, b"x")


@pytest.mark.parametrize("kind", CONFIRMING)
async def test_a_message_to_be_confirmed_is_retained_until_its_receiver_has_it(
    kind: Kind, tmp_path: Path
) -> None:
    async with world(kind, tmp_path) as there, there.both() as (one, two):
        identity = await one.agent.send(TWO, b"x", confirm=True)
        await one.until(lambda: bool(one.notices))
        assert one.agent.health().queued == 1
        assert (await two.take_one()).identity == identity
        both = {DeliveryStatus.HANDED_ON, DeliveryStatus.DELIVERED}
        await one.until(lambda: {notice.status for notice in one.notices} == both)
        assert one.agent.health().queued == 0


@pytest.mark.parametrize("kind", ATTACHED_BY_PAYLOAD)
async def test_a_message_that_cannot_be_confirmed_is_refused(kind: Kind, tmp_path: Path) -> None:
    async with world(kind, tmp_path) as there, there.agent(1) as one:
        with pytest.raises(ValueError, match="offers no confirmation"):
            await one.agent.send(TWO, b"x", confirm=True)
