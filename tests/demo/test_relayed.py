"""Sessions through an orbiter: real sockets and bundles, a rover that answers, a clock of ours."""

import asyncio
import re
from dataclasses import replace

import pytest
from rich.console import Console

from adapters.bundle.links.contact import Contact, ContactPlan
from adapters.mrs.spec.types import Stage
from executive.commands.catalogue import MoveForward, SetTravelSpeed
from sim.demo.display import LineDisplay
from sim.demo.outcome import by_both, late
from sim.demo.script import RELAY, AtOnce, Ending, Link, Step, WhenDark, WhenDone
from sim.demo.session import Session, Told
from sim.demo.timeline import lane_of, waited
from tests.relay.orbiter.sky import Clock, Sky, ground, landed, orbiting, until

STEPS = (
    Step(MoveForward(5.0), WhenDark(), Ending.EXPIRED, link=Link.RELAY, lifetime_s=0.5),
    Step(SetTravelSpeed(0.5), AtOnce(), link=Link.RELAY),
    Step(SetTravelSpeed(0.5), WhenDone(), Ending.DUPLICATE, repeats=True, link=Link.RELAY),
)
DAY_S = 86_400.0


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, str]:
    """Play the steps in an eclipse that lasts for an hour; give what was printed, too."""
    folder, console = tmp_path_factory.mktemp("relayed"), Console(width=110)

    async def run() -> Session:
        relay, clock = Sky(folder, "jackal"), Clock()
        dawn_s = clock.utc_s() + 3600.0
        plan = ContactPlan((Contact(dawn_s, dawn_s + 600.0, 1, 2, 100_000),))
        async with (
            orbiting(relay, clock, plan) as (_, (station,)),
            landed(relay, "jackal") as rover,
            await ground(station) as client,
        ):
            with LineDisplay(console) as shown:
                session = Session({Link.RELAY: client}, shown.audience(RELAY), Link.RELAY)
                playing = asyncio.create_task(session.play(STEPS))
                await until(lambda: len(session.lives) == 2 and session.lives[1].stored)
                await until(lambda: session.lives[0].ending is Ending.EXPIRED)
                await until(lambda: session.relay_history[-1][1].queued == 1)
                assert rover.commands == []
                clock.shift_s = 3601.0
                await playing
            assert [message.command for message in rover.commands] == ["SET_TRAVEL_SPEED"]
            return session

    with console.capture() as printed:
        session = asyncio.run(run())
    return session, printed.get()


def test_what_is_sent_in_the_dark_is_stored_and_carried_out_after_it(
    played: tuple[Session, str],
) -> None:
    session, text = played
    assert [life.ending for life in session.lives] == [step.expected for step in STEPS]
    expired, waiting, again = session.lives
    stages = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]
    assert [told.notification.stage for told in waiting.told] == stages
    assert expired.stored
    assert expired.told == []
    assert expired.text == "its lifetime ended at the orbiter"
    assert not again.stored
    assert again.told == [], "it is known by the same link: the first one's report is no life"
    assert re.search(r"no contact, next in \d+ s +queue \d", text), text
    assert re.search(r"^ 2 setTravelSpeed.* relay +0\.\d\d .*EXECUTED", text, re.MULTILINE), text


def test_a_lane_tells_where_a_command_was(played: tuple[Session, str]) -> None:
    session, _ = played
    start_utc_s = session.lives[0].sent_utc_s
    expired, waiting, again = (lane_of(life, start_utc_s) for life in session.lives)
    assert expired.sent_s == 0.0
    assert expired.stored_s is not None
    assert expired.lost_s is not None
    assert 0.0 < expired.stored_s < expired.lost_s
    assert expired.received is None
    assert waiting.ended is not None
    assert waiting.ended.told_s >= waiting.ended.made_s > waiting.sent_s
    assert again.again
    assert again.stored_s is None
    (at_the_orbiter, commands), (aboard, _) = waited(session)
    assert at_the_orbiter == "commands that waited at the orbiter"
    assert aboard == "reports that waited aboard"
    assert commands.startswith("2 of 2"), "the one that was given up there waited too"
    assert list(by_both(session)) == [], "it was sent again by the same link"


def test_odometry_that_was_late_is_known_afterwards(played: tuple[Session, str]) -> None:
    session, _ = played
    assert not late(session)
    stood = replace(session.reports[Link.RELAY][-1].notification, code=902)
    session.reports[Link.RELAY].append(Told(stood, 0.0))
    assert late(session)
