"""The whole of it: many messages each way, bad weather, a hundred deaths, a clock that steps.

`BUNDLE_MESSAGES=50000` makes it as many as the relay has to bear; that takes minutes.
"""

import logging
import os
import random
from pathlib import Path

import pytest

from adapters.bundle.node.settings import Address, LtpLink
from tests.bundle.mortal import Mortal
from tests.bundle.weather import Weather, World, dark_times

MESSAGES = int(os.environ.get("BUNDLE_MESSAGES", "1500"))
DEATHS = 100
LASTS_S = 3600.0


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_many_messages_arrive_once_whatever_happens(
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
        3 * LASTS_S,
        lambda: all(len(side.application.had) >= len(fed.put) for side, fed in there),
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
