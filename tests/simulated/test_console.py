"""A console, its archive and a page, in simulated processes."""

from functools import partial

from executive.commands import MoveForward, Resume, SetTravelSpeed, Stop
from tests.simulated.console import BROWSER_HOST, HOST, Browser, PageJournal, start_console
from tests.simulated.processes import (
    Address,
    RoverBelow,
    start_executive,
    start_orbiter,
    start_relay,
)
from tests.simulated.storm import patient_settings
from tests.simulated.world import World


def test_a_page_commands_and_learns_the_ends() -> None:
    address, journal, below = Address(), PageJournal(), RoverBelow()
    browser = Browser(address.asset, journal)
    settings = patient_settings(address.asset)
    with World(1) as world:
        for name, host, start in (
            ("orbiter", address.orbiter, partial(start_orbiter, [address])),
            ("relay", address.relay, partial(start_relay, address)),
            ("executive", address.executive, partial(start_executive, address, below, settings)),
            ("console", HOST, partial(start_console, address)),
            ("browser", BROWSER_HOST, browser.start),
        ):
            world.process(name, host, start).begin()
        requests = (SetTravelSpeed(0.2), MoveForward(0.2), SetTravelSpeed(0.3), SetTravelSpeed(0.4))
        for number, request in enumerate(requests):
            world.at(10.0 + number, browser.send, request, number)
        world.at(20.0, browser.send, Stop(), 10)
        world.at(25.0, browser.send, Resume(), 12)
        world.at(25.5, world.processes["console"].kill)
        world.at(26.0, world.processes["console"].begin)
        world.run(60.0)
        assert world.errors == []
    assert {each for answers in journal.answers.values() for each in answers} == {202}
    assert len(journal.acknowledged) == 5
    assert len(journal.stops) == 1
    for identity in (*journal.acknowledged.values(), *journal.stops):
        assert journal.ends[identity] == ["executed"]
