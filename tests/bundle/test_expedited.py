"""Expedited bundles go before all others, at every queue, and into room that is kept for them."""

from contextlib import suppress
from pathlib import Path

import pytest

from adapters.bundle.codec.bundle import BlockType, decode_bundle, is_expedited
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import StoreFull
from adapters.bundle.node.database import StoreLimits
from adapters.bundle.node.settings import Listen, UdpLink
from tests.bundle.nodes import Clock, Pair, TestedNode, carry, settings_of
from tests.bundle.weather import Weather, World
from tests.bundle.worlds import ANY, ONE, TWO, payloads_of, port_of, running, send_all

STOP = b"stop"


def test_it_overtakes_in_the_outbox_on_the_link_and_in_the_inbox(pair: Pair) -> None:
    one, two = pair
    for payload in payloads_of(100):
        one.put(Ipn(2, 1), payload)
    first = one.node.sending.outgoing("ipn:2.0", 1000, 10_000)
    one.put(Ipn(2, 1), STOP, expedited=True)
    (stop,) = one.node.sending.outgoing("ipn:2.0", 1000, 10_000, expedited=True)
    for outgoing in (*first, stop):
        two.node.receiving.receive("ipn:1.0", outgoing.octets)
    two.commit()
    assert two.node.fetch(only_expedited=True) is not None
    assert two.node.fetch(only_expedited=True) is None
    two.restart()
    assert two.take()[:2] == [STOP, b"000000"]


def test_the_expedited_block_is_that_of_ion_and_every_fragment_has_it(pair: Pair) -> None:
    one, _ = pair
    one.put(Ipn(2, 1), bytes(4000), expedited=True)
    sent = one.node.sending.outgoing("ipn:2.0", 10_000, 1400, expedited=True)
    assert len(sent) > 2
    for outgoing in sent:
        bundle = decode_bundle(outgoing.octets)
        assert is_expedited(bundle)
        block = bundle.block(BlockType.QUALITY)
        assert block
        assert block.data.hex() == "8400020000"


def test_it_is_forwarded_first_and_sent_again_after_a_restart(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 3, 1), clock)
    one.put(Ipn(3, 1), b"x")
    one.put(Ipn(3, 1), STOP, expedited=True, confirm=True)
    carry(one, two)
    two.restart()
    (stop,) = two.node.sending.outgoing("ipn:3.0", 1000, 1000, expedited=True)
    assert decode_bundle(stop.octets).payload == STOP
    one.restart()
    clock.utc_ms += 60_000
    one.tick()
    (again,) = one.node.sending.outgoing("ipn:2.0", 1000, 1000, expedited=True)
    assert again.stored.confirm


def test_space_is_reserved_for_it_in_every_store(tmp_path: Path, clock: Clock) -> None:
    limits = StoreLimits(max_octets=100_000)
    one = TestedNode(tmp_path, settings_of(1, 2), clock, limits)
    two = TestedNode(tmp_path, settings_of(2, 1), clock, limits)
    one.put(Ipn(2, 1), STOP, expedited=True)
    (stop,) = one.node.sending.outgoing("ipn:2.0", 1000, 1000, expedited=True)
    for node, destination in ((one, Ipn(2, 1)), (two, Ipn(1, 1))):
        while not node.database.full:
            node.put(destination, bytes(5000))
        with pytest.raises(StoreFull):
            node.put(destination, b"x")
        for _ in range(100):
            node.put(destination, STOP, expedited=True)
    two.node.receiving.receive("ipn:1.0", stop.octets)
    two.commit()
    assert two.take() == [STOP]


def test_its_reservation_is_bounded_too(tmp_path: Path, clock: Clock) -> None:
    one = TestedNode(tmp_path, settings_of(1, 2), clock, StoreLimits(100_000, 0, 200_000))
    with suppress(StoreFull):
        for _ in range(1000):
            one.put(Ipn(2, 1), bytes(4096), expedited=True)
    assert one.node.outbox.depth() < 100
    with pytest.raises(ValueError, match="at most 4096 octets"):
        one.node.put(Ipn(2, 1), bytes(4097), expedited=True)


def test_it_overtakes_thousands_on_a_slow_ltp_link_that_loses(tmp_path: Path) -> None:
    world = World(tmp_path, 3, Weather(0.1, least_delay_s=0.2, max_delay_s=0.4))
    for number in range(3000):
        world.one.node.put(Ipn(2, 1), b"%05d" % number + bytes(200))
    world.run(1.0)
    identity = world.one.node.put(Ipn(2, 1), STOP, expedited=True)
    assert world.run(4.0, lambda: identity in world.two.application.had)
    assert len(world.two.application.had) < 1500


async def test_it_does_not_wait_for_the_pace_of_a_datagram_link(tmp_path: Path) -> None:
    async with running(tmp_path, 2, 1, UdpLink(ANY), Listen(udp=ANY)) as two:
        link = UdpLink(port_of(two.agent.listens.udp), rate_octets_s=1000)
        async with running(tmp_path, 1, 2, link, Listen(udp=ANY)) as one:
            await send_all(one, TWO, payloads_of(200))
            await one.agent.send(TWO, STOP, expedited=True)
            delivery = await two.take_one()
            while not delivery.expedited:
                delivery = await two.take_one()
            assert (delivery.payload, delivery.source) == (STOP, ONE)
            assert one.agent.health().queued > 150


async def test_a_task_of_its_own_takes_it_while_others_are_held(tmp_path: Path) -> None:
    async with running(tmp_path, 2, 1, UdpLink(ANY), Listen(udp=ANY)) as two:
        link = UdpLink(port_of(two.agent.listens.udp))
        async with running(tmp_path, 1, 2, link, Listen(udp=ANY)) as one:
            await one.agent.send(TWO, b"x")
            async with two.agent.receive() as held:
                await one.agent.send(TWO, STOP, expedited=True)
                async with two.agent.receive(only_expedited=True) as stop:
                    assert (held.payload, stop.payload) == (b"x", STOP)
