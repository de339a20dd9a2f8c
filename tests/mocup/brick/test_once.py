"""Whatever is sent by both links in whatever order, and whoever is killed: once, and told."""

from collections.abc import Callable
from random import Random

import pytest

from adapters.mocup.brick.record import BrickLink
from adapters.mops import is_last
from executive.values.reports import Stage
from tests.mocup.brick.both_links import Desk
from tests.mocup.brick.models import STOPS

DAYS = 60
ACTS = 40
NUMBERS = range(1, 5)
UNFINISHED = ("interrupted", "stopped")


class Day:
    """What may happen to a desk, each with how often it does."""

    def __init__(self, desk: Desk, random: Random) -> None:
        self.desk, self.random = desk, random
        self.acts: dict[Callable[[], None], float] = {
            self.by_the_direct_link: 3,
            self.by_the_relay: 3,
            desk.direct: 12,
            desk.usb_in: 8,
            desk.usb_out: 8,
            desk.sync: 8,
            self.deliver: 8,
            desk.brick.end: 4,
            self.time_passes: 2,
        }
        troubles: tuple[Callable[[], None], ...] = (
            self.stop,
            self.kill_nxt_soon,
            desk.cut_power,
            desk.start_nxt,
            desk.start_executive,
            self.kill_the_executive_before_it_claims,
            desk.start_relay,
            self.plug,
        )
        for trouble in random.sample(troubles, random.randrange(4)):
            self.acts[trouble] = 1

    def live(self) -> None:
        for act in self.random.choices(list(self.acts), list(self.acts.values()), k=ACTS):
            act()
            self.desk.check_once()

    def by_the_direct_link(self) -> None:
        self.desk.executive.submit(self.random.choice(NUMBERS))

    def by_the_relay(self) -> None:
        self.desk.relay(self.random.choice(NUMBERS), self.random.choice([None, 1, 2]))

    def deliver(self) -> None:
        self.desk.deliver(self.random.choice(list(BrickLink)))

    def time_passes(self) -> None:
        self.desk.clock.advance(self.random.choice([1.0, 4.0]))
        self.desk.discover()
        self.desk.executive.tick()
        self.desk.killed(self.desk.router.poll)

    def stop(self) -> None:
        if self.random.random() < 0.5:
            self.desk.executive.stop()
        else:
            self.desk.relay(self.random.choice(STOPS), None)

    def kill_nxt_soon(self) -> None:
        self.desk.fuse.left = self.random.randint(1, 20)

    def kill_the_executive_before_it_claims(self) -> None:
        self.desk.executive.submit(self.random.choice(NUMBERS), dies=True)
        self.desk.start_executive()

    def plug(self) -> None:
        self.desk.plug(not self.desk.plugged)


def check_reported(desk: Desk) -> None:
    assert desk.executive.active is None
    assert not desk.executive.waiting
    for number in desk.relay_sent.keys() - set(STOPS):
        received, reported = desk.relay_received[number], desk.outcomes(number)
        assert len(reported) <= 1, received
        assert any(map(is_last, received)), f"no end of {number} was heard: {received}"
        direct = desk.executive.last.get(number)
        if direct is not None and direct.text not in UNFINISHED and reported:
            assert (reported == {"EXECUTED"}) == (direct.stage is Stage.EXECUTED), (
                direct,
                received,
            )


@pytest.mark.parametrize("seed", range(4))
def test_a_command_by_both_links_is_executed_once_and_reported_on_both(seed: int) -> None:
    for day in range(DAYS):
        desk = Desk()
        desk.discover()
        Day(desk, Random(1000 * seed + day)).live()
        desk.settle()
        desk.retransmit()
        desk.settle()
        desk.check_once()
        check_reported(desk)
