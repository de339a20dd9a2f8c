"""Loss, repeats, disorder, black-outs, deaths: everything arrives, and once.

`BUNDLE_MESSAGES=50000` makes it as many as the relay has to bear; that takes minutes."""

import logging
import os
import random
from pathlib import Path

import pytest

from adapters.bundle.node.settings import Address, LtpLink
from tests.bundle.weather import Mortal, Side, Weather, World, dark_times

BLOCKS = LtpLink(Address("nowhere", 0), block_octets=4000)


def feed(world: World, side: Side, count: int, *, until_s: float, octets: int = 100) -> list[bytes]:
    """Have a side send messages, all numbered, at random times."""
    payloads = [b"%d-%06d" % (side.number, number) for number in range(count)]
    payloads = [payload.ljust(octets, b".") for payload in payloads]
    times = sorted(world.chance.uniform(0.0, until_s) for _ in payloads)
    for payload, time_s in zip(payloads, times, strict=True):
        world.at(time_s, lambda payload=payload: side.put(payload))  # type: ignore[misc]
    return payloads


def complete(side: Side, payloads: list[bytes]) -> bool:
    return len(side.application.had) >= len(payloads)


def check_complete(world: World, to_one: list[bytes], to_two: list[bytes]) -> None:
    assert sorted(world.one.application.had.values()) == sorted(to_one)
    assert sorted(world.two.application.had.values()) == sorted(to_two)


def test_many_fragments_of_a_long_unit_arrive(tmp_path: Path) -> None:
    world = World(tmp_path, 6, Weather(0.1, 0.1, 0.0, 0.01, 0.2))
    payload = world.chance.randbytes(1_000_000)
    world.one.put(payload)
    assert world.run(200.0, lambda: bool(world.two.application.had))
    assert list(world.two.application.had.values()) == [payload]


def test_a_disk_that_fills_in_mid_commit_is_reported_and_nothing_is_lost(tmp_path: Path) -> None:
    world = World(tmp_path, 8, Weather(0.05), BLOCKS)
    world.two.database.read("PRAGMA max_page_count = 60")
    to_two = feed(world, world.one, 300, until_s=1.0, octets=1000)
    world.two.reads = False
    world.run(60.0)
    assert 0 < world.two.node.inbox.depth() < 300
    world.two.database.read("PRAGMA max_page_count = 100000")
    world.two.reads = True
    assert world.run(200.0, lambda: complete(world.two, to_two))
    check_complete(world, [], to_two)


def test_what_waited_in_the_dark_is_through_soon_after(tmp_path: Path) -> None:
    weather = Weather(0.1, 0.0, 0.0, 0.02, 0.05, dark=((0.0, 60.0),))
    world = World(tmp_path, 9, weather)
    to_two = feed(world, world.one, 300, until_s=50.0)
    world.run(60.0)
    assert not world.two.application.had
    assert world.run(65.0, lambda: complete(world.two, to_two))
    check_complete(world, [], to_two)


def test_while_it_is_dark_little_is_sent(tmp_path: Path) -> None:
    world = World(tmp_path, 10, Weather(dark=((0.0, 1000.0),)))
    feed(world, world.one, 300, until_s=1.0)
    world.run(1.0)
    before = world.datagrams
    world.run(101.0)
    assert world.datagrams - before <= 8 * 100 / 0.5


MESSAGES = int(os.environ.get("BUNDLE_MESSAGES", "500"))
DEATHS = 50
LASTS_S = 1800.0


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_many_messages_arrive_once_despite_all_faults(
    tmp_path: Path, loss: float, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.CRITICAL)
    chance = random.Random(loss)
    dark = tuple(dark_times(chance, 1.5 * LASTS_S, 60.0))
    weather = Weather(loss, 0.05, 0.01, 0.01, 0.5, dark)
    world = World(tmp_path, round(10 * loss), weather, LtpLink(Address("nowhere", 0)))
    feeds = [Mortal(world, side, MESSAGES, LASTS_S) for side in (world.one, world.two)]
    for _ in range(DEATHS):
        world.at(chance.uniform(0.0, LASTS_S), lambda: chance.choice((world.one, world.two)).kill())
    world.at(LASTS_S / 2, lambda: world.two.step_clock(-7200.0))
    world.run(LASTS_S)
    there = ((world.one, feeds[1]), (world.two, feeds[0]))
    world.run(
        3 * LASTS_S, lambda: all(len(side.application.had) >= len(fed.put) for side, fed in there)
    )
    world.run(world.now_s + 200.0)
    assert world.one.deaths + world.two.deaths >= DEATHS - 10
    for side, fed in there:
        assert len(fed.put) > MESSAGES - DEATHS
        had = list(side.application.had.values())
        assert len(had) == len(set(had))
        assert set(fed.put) <= set(had)
        assert side.application.again == 0
        assert side.node.outbox.depth() == 0
