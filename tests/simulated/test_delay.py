"""A client and a console over a direct link with light time, in simulated processes."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import pytest

from adapters.console.service import ConsoleOptions, serve
from adapters.mal import MalError
from adapters.mrs.cli import RoverTarget
from adapters.mrs.ground import MrsClient
from adapters.mrs.transport import TransportSettings
from executive.commands import MoveForward, OnlyAt, Precondition, SetTravelSpeed, Stop
from executive.settings import (
    LinkLossAction,
    LinkLossSettings,
    LinkLossStage,
    Settings,
)
from executive.values.reports import Stage
from sim.processes.delayed_link import DelayedLink, LinkConditions
from tests.simulated.console import BROWSER_HOST, HOST, PORT, Browser, PageJournal
from tests.simulated.disk import rows
from tests.simulated.process import Process
from tests.simulated.processes import MRS_PORT, Address, RoverBelow, start_executive
from tests.simulated.storm import patient_settings
from tests.simulated.system import SimSystem
from tests.simulated.world import World

LINK_HOST: Final = "10.0.1.8"
ADDRESS: Final = Address()
HISTORIES: Final = "SELECT body FROM command"
URI: Final = f"maltcp://{LINK_HOST}:{MRS_PORT}/MRS"


def start_link(conditions: LinkConditions, process: Process) -> None:
    async def relay() -> None:
        link = DelayedLink(ADDRESS.executive, MRS_PORT, conditions)
        await link.serve("0.0.0.0", MRS_PORT)
        await asyncio.Event().wait()

    process.run(relay())


def delayed_world(conditions: LinkConditions, below: RoverBelow, settings: Settings) -> World:
    world = World(1)
    world.process(
        "executive", ADDRESS.executive, partial(start_executive, ADDRESS, below, settings)
    )
    world.process("link", LINK_HOST, partial(start_link, conditions))
    for process in world.processes.values():
        process.begin()
    return world


@dataclass
class Session:
    """A client, the times of its actions, and the ends of its commands."""

    round_trip_s: float
    times_s: dict[str, float] = field(default_factory=dict)
    ends: list[Stage | None] = field(default_factory=list)

    def start(self, work: Callable[[MrsClient], Awaitable[None]], process: Process) -> None:
        process.run(self._serve(work, SimSystem(process)))

    async def _serve(self, work: Callable[[MrsClient], Awaitable[None]], system: SimSystem) -> None:
        await asyncio.sleep(1.0)
        self.note("begun")
        terms = TransportSettings(round_trip_s=self.round_trip_s)
        async with await MrsClient.connect(URI, terms=terms, system=system) as client:
            self.note("connected")
            await work(client)
        self.note("closed")

    def note(self, name: str) -> None:
        self.times_s[name] = asyncio.get_running_loop().time()

    def since_s(self, name: str, begun: str) -> float:
        return self.times_s[name] - self.times_s[begun]


@pytest.mark.parametrize("round_trip_s", [10.0, pytest.param(300.0, marks=pytest.mark.slow)])
def test_a_client_commands_and_stops_over_any_light_time(round_trip_s: float) -> None:
    """The rover would stop by itself after 5 s without a contact: heartbeats do not wait."""
    session, below = Session(round_trip_s), RoverBelow()

    async def work(client: MrsClient) -> None:
        assert (await client.run(client.command(SetTravelSpeed(0.02)))).executed
        drive = asyncio.create_task(client.run(client.command(MoveForward(15.0))))
        await asyncio.sleep(20.0)
        session.note("stop sent")
        stop = await client.run(client.command(Stop()))
        session.note("stopped")
        session.ends = [stop.stage, (await drive).stage]
        assert client.delay.declared_s == round_trip_s
        assert client.delay.round_trip_s == pytest.approx(round_trip_s, abs=0.1)

    silent = LinkLossSettings(motion=(LinkLossStage(5.0, LinkLossAction.STOP),))
    settings = replace(patient_settings(ADDRESS.asset), link_loss=silent)
    with delayed_world(LinkConditions(round_trip_s), below, settings) as world:
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.run(5 * round_trip_s + 30.0)
        assert world.errors == []
    assert session.ends == [Stage.EXECUTED, Stage.CANCELLED]
    assert session.since_s("stopped", "stop sent") < round_trip_s + 1.0


def test_a_stop_arrives_after_one_light_time_though_nothing_is_known_of_the_rover() -> None:
    session = Session(10.0)

    async def work(client: MrsClient) -> None:
        stop = await client.run(client.command(Stop()))
        session.ends = [stop.stage]
        session.times_s["arrived"] = stop.reports[0].utc_s

    settings = patient_settings(ADDRESS.asset)
    with delayed_world(LinkConditions(10.0), RoverBelow(), settings) as world:
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.run(40.0)
        assert world.errors == []
        sent_utc_s = world.start_utc_s + session.times_s["begun"]
    assert session.ends == [Stage.EXECUTED]
    assert session.times_s["arrived"] - sent_utc_s == pytest.approx(5.0, abs=0.1)


def test_a_first_command_with_a_precondition_waits_for_the_directory() -> None:
    session = Session(10.0)

    async def work(client: MrsClient) -> None:
        at_origin = Precondition(at=OnlyAt(0.0, 0.0, 0.5))
        driven = await client.run(client.command(MoveForward(0.2), precondition=at_origin))
        session.ends = [driven.stage]

    settings = patient_settings(ADDRESS.asset)
    with delayed_world(LinkConditions(10.0), RoverBelow(), settings) as world:
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.run(60.0)
        assert world.errors == []
    assert session.ends == [Stage.EXECUTED]


def executed_with_a_loss(
    session: Session,
    work: Callable[[MrsClient], Awaitable[None]],
    lost_s: float,
    back_s: float,
    until_s: float,
) -> float:
    """Run a client that ends a command while the link is lost for a time; return the start."""
    settings = patient_settings(ADDRESS.asset)
    with delayed_world(LinkConditions(10.0), RoverBelow(), settings) as world:
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.at(lost_s, world.processes["link"].kill)
        world.at(back_s, world.processes["link"].begin)
        world.run(until_s)
        assert world.errors == []
    assert session.ends == [Stage.EXECUTED]
    return world.start_utc_s


def test_a_link_lost_soon_after_the_directorys_answer_is_restored() -> None:
    session = Session(10.0)

    async def work(client: MrsClient) -> None:
        await client.get_pose()
        await asyncio.sleep(10.0)
        session.ends = [(await client.run(client.command(Stop()))).stage]
        assert client.delay.round_trip_s == pytest.approx(10.0, abs=0.1)

    executed_with_a_loss(session, work, 15.0, 15.5, 150.0)


def test_after_a_loss_a_stop_arrives_one_light_time_after_the_new_connection() -> None:
    session = Session(10.0)

    async def work(client: MrsClient) -> None:
        await asyncio.sleep(49.5)
        stop = await client.run(client.command(Stop()))
        session.ends = [stop.stage]
        session.times_s["arrived"] = stop.reports[0].utc_s

    start_utc_s = executed_with_a_loss(session, work, 50.0, 51.0, 95.0)
    assert session.times_s["arrived"] - start_utc_s < 51.0 + 5.0 + 0.5


def test_without_a_rover_behind_the_link_a_client_learns_it() -> None:
    session = Session(10.0)

    async def work(client: MrsClient) -> None:
        with pytest.raises(ConnectionError, match="closed the connection"):
            await client.run(client.command(Stop()))
        session.note("refused")

    settings = patient_settings(ADDRESS.asset)
    with delayed_world(LinkConditions(10.0), RoverBelow(), settings) as world:
        world.processes["executive"].kill()
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.run(40.0)
        assert world.errors == []
    assert session.since_s("refused", "begun") < 12.0


def test_octets_sent_between_two_contacts_arrive_in_the_next() -> None:
    conditions = LinkConditions(10.0, contact_s=60.0, period_s=300.0)
    assert [conditions.arrival_s(at_s) for at_s in (0.0, 59.0, 60.0, 299.0, 301.0)] == [
        *(5.0, 64.0, 305.0, 305.0, 306.0)
    ]
    session = Session(10.0)

    async def work(client: MrsClient) -> None:
        await client.get_pose()
        await asyncio.sleep(60.0 - asyncio.get_running_loop().time())
        session.note("contact ended")
        with pytest.raises(MalError):
            await client.get_pose()
        session.note("not answered")
        await asyncio.sleep(310.0 - asyncio.get_running_loop().time())
        await client.get_pose()
        session.note("answered")

    settings = patient_settings(ADDRESS.asset)
    with delayed_world(conditions, RoverBelow(), settings) as world:
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.run(340.0)
        assert world.errors == []
    assert session.since_s("not answered", "contact ended") == pytest.approx(20.0, abs=0.1)
    assert session.since_s("answered", "begun") == pytest.approx(319.0, abs=0.1)


def test_a_share_of_whole_messages_is_lost() -> None:
    session = Session(2.0)
    answered = []

    async def work(client: MrsClient) -> None:
        for _ in range(30):
            answers = await asyncio.gather(client.get_pose(), return_exceptions=True)
            answered.append(not isinstance(answers[0], MalError))

    settings = patient_settings(ADDRESS.asset)
    # Of an exchange, request or answer is lost; the first ones, which make the session, are not.
    with delayed_world(LinkConditions(2.0, loss=0.2), RoverBelow(), settings) as world:
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.run(500.0)
        assert world.errors == []
    assert len(answered) == 30
    assert 5 < answered.count(False) < 18, "of 30, 11 are expected"


def test_no_result_of_a_command_is_missed_over_a_link_that_loses_messages() -> None:
    """A lost request or acknowledgement is a timeout; a lost report is fetched."""
    session = Session(2.0)

    async def work(client: MrsClient) -> None:
        for _ in range(12):
            command = client.command(SetTravelSpeed(0.2))
            while not (outcome := await asyncio.wait_for(client.run(command), 60.0)).executed:
                assert isinstance(outcome.refusal, MalError), outcome
            session.ends.append(outcome.stage)

    settings = patient_settings(ADDRESS.asset)
    with delayed_world(LinkConditions(2.0, loss=0.15), RoverBelow(), settings) as world:
        world.process("ground", HOST, partial(session.start, work)).begin()
        world.run(400.0)
        assert world.errors == []
    assert session.ends == 12 * [Stage.EXECUTED]


def start_console(round_trip_s: float, process: Process) -> None:
    rover = RoverTarget(URI, TransportSettings(round_trip_s=round_trip_s))
    options = ConsoleOptions((rover,), "127.0.0.1", PORT, None, None, process.folder)
    process.run(serve(options, SimSystem(process)))


def test_a_console_commands_and_stops_over_light_time() -> None:
    """No state in between is UNKNOWN: a report in transit is not overdue."""
    below, journal = RoverBelow(), PageJournal()
    browser = Browser(ADDRESS.asset, journal)
    settings = patient_settings(ADDRESS.asset)
    with delayed_world(LinkConditions(12.0), below, settings) as world:
        world.process("console", HOST, partial(start_console, 12.0)).begin()
        world.process("browser", BROWSER_HOST, browser.start).begin()
        world.at(60.0, browser.send, SetTravelSpeed(0.02), 1)
        world.at(61.0, browser.send, MoveForward(15.0), 2)
        world.at(85.0, browser.send, Stop(), 3)
        world.run(110.0)
        assert world.errors == []
        archive = rows(world.processes["console"].stored / "archive.sqlite", HISTORIES)
    ends = [*journal.ends.values()]
    assert ends == [["executed"], ["cancelled"], ["executed"]]
    assert archive
    assert not any("UNKNOWN" in history for (history,) in archive)


def test_after_a_loss_a_console_stops_one_light_time_after_the_new_connection() -> None:
    below, journal = RoverBelow(), PageJournal()
    browser = Browser(ADDRESS.asset, journal)
    settings = patient_settings(ADDRESS.asset)
    with delayed_world(LinkConditions(12.0), below, settings) as world:
        world.process("console", HOST, partial(start_console, 12.0)).begin()
        world.process("browser", BROWSER_HOST, browser.start).begin()
        world.at(60.0, world.processes["link"].kill)
        world.at(60.5, browser.send, Stop(), 1)
        world.at(61.0, world.processes["link"].begin)
        world.run(120.0)
        assert world.errors == []
        ((body,),) = rows(world.processes["console"].stored / "archive.sqlite", HISTORIES)
    (received,) = (each for each in json.loads(body)["history"] if each["stage"] == "RECEIVED")
    # the link listens again at 61 s; the console tries at least every 5 s
    assert received["utc"] - world.start_utc_s < 61.0 + 5.0 + 6.0
