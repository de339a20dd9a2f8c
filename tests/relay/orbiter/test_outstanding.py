"""A command whose lifetime ends at the orbiter ends for who waits for it, too."""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from adapters.bundle import (
    Address,
    BundleAgent,
    ContactPlan,
    Ipn,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
    Queued,
)
from adapters.bundle.links.contact import Contact
from adapters.mal import MalError
from adapters.mocup.brick.record import BrickLink
from adapters.mops import LinkHealth, decode
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AreaError, forwarded_command, lost_command
from adapters.mrs.spec.types import Severity
from adapters.relay.orbiter.record import Outstanding
from adapters.relay.orbiter.relay import GRACE_S, OrbiterRelay, recover_outbox
from executive.commands.catalogue import Command, MoveForward, Request, Stop
from executive.record import LedgerError
from executive.values.reports import Stage
from tests.mocup.brick.routing import Bench, executed
from tests.relay.orbiter.sky import (
    DICTIONARY,
    HERE,
    ORBITER,
    STAGES,
    Clock,
    FarRover,
    Sky,
    catch_up,
    eclipse,
    ground,
    landed,
    meeting,
    orbiting,
    rover,
    until,
)
from tests.support.unsynced import UNSYNCED

WHY = "may not have reached the rover: its lifetime ended at the orbiter"


async def test_clients_waiting_for_a_lost_command_are_notified(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with (
        orbiting(sky, clock, eclipse(clock)) as (relay, (station,)),
        landed(sky, "jackal") as far,
        await ground(station) as client,
    ):
        short = client.command(MoveForward(1.0), lifetime_s=30.0)
        waiting = [
            asyncio.create_task(client.run(each)) for each in (short, client.command(Stop()))
        ]
        await until(lambda: relay.agent.health().queued == 2)
        clock.shift_s = 60.0
        lost = await waiting[0]
        assert (lost.executed, lost.stage, lost.reports, lost.refusal) == (
            False,
            None,
            (),
            None,
        )
        assert lost.loss is not None
        assert lost.loss.severity is Severity.ALARM
        assert lost.loss.text == f"{short.identity} {WHY}"
        assert (lost.loss.identity, lost.loss.stage) == (short.identity, None)
        assert not waiting[1].done(), "it is of one command only"
        clock.shift_s = 3601.0
        assert (await waiting[1]).executed
        assert [message.command for message in far.commands] == ["STOP"]


async def test_a_command_that_leaves_the_orbiter_is_reported(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with meeting(sky, clock, eclipse(clock)) as (relay, _, client):
        command = client.command(MoveForward(1.0))
        received = client.notifications()
        await client.submit(command)
        await until(lambda: relay.agent.health().queued == 1)
        clock.shift_s = 3601.0
        reported = [(await anext(received)).report for _ in range(1 + len(STAGES))]
        (left,) = [each for each in reported if forwarded_command(each) is not None]
        assert forwarded_command(left) == command.identity
        assert (left.stage, left.sequence, lost_command(left)) == (None, 0, None)
        assert left.text == f"{command.identity} has left the orbiter"
        assert [each.stage.name for each in reported if each.stage] == [
            each.name for each in STAGES
        ]


async def test_rover_command_and_rover_mops_end_with_it(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with orbiting(sky, clock, eclipse(clock), lifetime_s=2.0) as (_, (station,)):
        to = ("--to", str(station.uri))
        status, message = await rover("command", *to, "--lifetime", "2", "moveForward", "0.4")
        assert status == 1
        assert "LOST" in message
        assert WHY in message
        status, message = await rover("mops", *to, "--no-telemetry", typed="moveForward 0.4\n")
        assert status == 1
        assert WHY in message


async def test_a_run_over_a_loss_of_the_session_ends_with_it(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with orbiting(sky, clock, eclipse(clock)) as (relay, (station,)):
        rover_node = relay.rovers[next(iter(relay.rovers))]
        async with await ground(station) as client:
            command = client.command(MoveForward(1.0), lifetime_s=30.0)
            waiting = asyncio.create_task(client.run(command))
            await until(lambda: relay.agent.health().queued == 1)
            rover_node.listener = None  # what is told now, nobody hears
            clock.shift_s = 60.0
            await until(lambda: rover_node.record.ledger.last() is not None)
            await client._session.drop(await client._session.consumer())
            assert (await waiting).loss is not None


LIFETIME_S = 60.0
AGAIN_S = 60.0
UNHEARD_AGAIN_S = 90.0


def link(
    utc_s: float, *, queued: int = 0, oldest_age_s: float = 0.0, undelivered: int = 0
) -> LinkHealth:
    return LinkHealth(utc_s, queued, oldest_age_s, None, 0.0, undelivered, 0)


@pytest.mark.parametrize(
    ("again_s", "grace_s"), [(UNHEARD_AGAIN_S, UNHEARD_AGAIN_S), (None, GRACE_S)]
)
async def test_only_a_link_made_late_enough_gives_it_up(
    tmp_path: Path, again_s: float | None, grace_s: float
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with meeting(sky, clock, retransmit_after_s=again_s) as (relay, rover, client):
        (far,) = relay.rovers.values()

        async def receive(health: LinkHealth) -> None:
            await rover.link(health)
            await until(lambda: far.aboard == health)

        await client.submit(client.command(MoveForward(0.5), lifetime_s=LIFETIME_S))
        await catch_up(client, len(STAGES))
        rover.lifecycle = ()
        command = client.command(MoveForward(1.0), lifetime_s=LIFETIME_S)
        end = asyncio.create_task(client.run(command))
        await until(lambda: rover.received == 2)
        await until(departed(relay))
        sent_s, late_s = clock.utc_s(), LIFETIME_S + grace_s
        await receive(link(sent_s + 3600.0))  # its clock is ahead
        clock.shift_s = late_s + 20.0
        relay.poll()
        await relay.retransmit_unanswered()
        await receive(link(sent_s + late_s - 5.0))
        await receive(link(sent_s + late_s + 20.0, queued=4, oldest_age_s=25.0))
        await receive(link(sent_s + late_s + 20.0, undelivered=1))
        assert not far.record.ledger.recorded_on(command.identity)
        await receive(link(sent_s + late_s + 20.0, queued=2, oldest_age_s=3.0))
        aborted = (await end).loss
        assert aborted is not None
        assert "no report within its lifetime" in (aborted.text or "")
        (loss,) = far.record.ledger.recorded_on(command.identity)
        assert loss.report.identity == command.identity


async def sent_and_killed(
    sky: Sky, clock: Clock, monkeypatch: pytest.MonkeyPatch, *requests: MoveForward | Stop
) -> list[Command]:
    """Send commands in the dark with an orbiter that never comes to write them down."""

    def killed(*_: object) -> None:
        raise LedgerError("killed")

    async with (
        orbiting(sky, clock, eclipse(clock)) as (relay, (station,)),
        await ground(station) as client,
    ):
        commands = [client.command(request) for request in requests]
        with monkeypatch.context() as kill:
            kill.setattr(Outstanding, "add", killed)
            for command in commands:
                with pytest.raises(MalError):
                    await client.submit(command)
        assert relay.agent.health().queued == len(commands)
    return commands


async def test_a_repeat_of_what_went_up_before_it_was_written_down_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    first, second = await sent_and_killed(sky, clock, monkeypatch, MoveForward(1.25), Stop())
    async with (
        orbiting(sky, clock) as (relay, (station,)),
        landed(sky, "jackal") as far,
        await ground(station) as client,
    ):
        (rover,) = relay.rovers.values()
        assert rover.record.outstanding.queued() == 2
        for command in (first, second):
            with pytest.raises(MalError) as refusal:
                await client.submit(command)
            assert refusal.value.number == AreaError.DUPLICATE.value
        await until(lambda: rover.record.outstanding.queued() == 0)
        await until(lambda: relay.agent.health().queued == 0)
        assert [message.command for message in far.commands] == ["STOP", "MOVE_FORWARD"]
        assert far.received == 3, "a stop goes up each time"


async def test_ended_records_are_not_searched(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with (
        orbiting(sky, clock, eclipse(clock)) as (relay, (station,)),
        await ground(station) as client,
    ):
        commands = [client.command(Stop()) for _ in range(40)]
        for command in commands:
            await client.submit(command)
        (rover,) = relay.rovers.values()
        queued = list(relay.agent.queued(rover.settings.endpoint))
        numbers = [decode(each.payload).moe_inputs_id for each in queued]
        assert numbers == [command.identity.command_id for command in reversed(commands)]
        recover_outbox(first(queued), rover.record, DICTIONARY, clock.utc_s())


def first(queued: Sequence[Queued]) -> Iterator[Queued]:
    yield queued[0]
    raise AssertionError("more was read than is new")


def departed(relay: OrbiterRelay) -> Callable[[], bool]:
    """Return whether the records know that all commands have left the outbox."""
    records = [each.record for each in relay.rovers.values()]
    return lambda: all(each.outstanding.earliest_utc_s() is None for each in records)


class Waiting:
    """A command that is up, and of which what the rover said was lost."""

    def __init__(
        self, relay: OrbiterRelay, clock: Clock, client: MrsClient, rover: FarRover
    ) -> None:
        self.relay, self.clock, self.client, self.rover = relay, clock, client, rover

    async def lose(self, request: Request, lifetime_s: float | None = None) -> Command:
        before = self.rover.received
        self.rover.mute = True
        command = self.client.command(request, lifetime_s=lifetime_s)
        await self.client.submit(command)
        await until(lambda: self.rover.received == before + 1)
        await until(departed(self.relay))
        self.rover.mute = False
        return command

    async def wait(self, time_s: float) -> None:
        self.clock.shift_s += time_s
        await self.relay.retransmit_unanswered()


async def stages(client: MrsClient, count: int) -> list[Stage]:
    return [n.stage for n in await catch_up(client, count) if n.stage is not None]


async def test_a_brick_is_queried_again_answers_and_executes_nothing_twice(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "mocup", numbered=False), Clock()
    async with (
        orbiting(sky, clock, retransmit_after_s=AGAIN_S) as (relay, (station,)),
        landed(sky, "mocup") as rover,
        await ground(station) as client,
    ):
        rover.ledger = ""
        waiting = Waiting(relay, clock, client, rover)
        lost = await waiting.lose(MoveForward(1.0))
        await waiting.wait(AGAIN_S / 2)
        assert rover.received == 1
        await waiting.wait(AGAIN_S)
        assert await stages(client, 4) == [*STAGES]
        assert [m.moe_inputs_id for m in rover.commands] == [lost.identity.command_id]
        assert rover.received == 2
        await waiting.wait(2 * AGAIN_S)
        assert rover.received == 2
        rover.lifecycle = (Stage.RECEIVED, Stage.STARTED)
        await client.submit(client.command(MoveForward(2.0)))
        reported = [*STAGES, Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED]
        assert await stages(client, 7) == reported
        await until(departed(relay))
        await waiting.wait(AGAIN_S)
        await until(lambda: rover.received == 4)
        await rover.send_telemetry(POS_X=9.0)
        (relayed,) = relay.rovers.values()
        await until(lambda: relayed.parameters()[0].value == 9.0)
        assert await stages(client, 7) == reported
        assert len(rover.commands) == 2


async def test_for_numbering_assets_only_commands_without_any_report(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with meeting(sky, clock, retransmit_after_s=AGAIN_S) as (relay, rover, client):
        waiting = Waiting(relay, clock, client, rover)
        rover.lifecycle = STAGES[:3]
        await client.submit(client.command(MoveForward(1.0)))
        await catch_up(client, 3)
        await until(departed(relay))
        await waiting.wait(2 * AGAIN_S)
        assert rover.received == 1
        rover.lifecycle = STAGES
        await waiting.lose(MoveForward(2.0))
        await waiting.wait(2 * AGAIN_S)
        past = await stages(client, 4)
        assert past[-1] is Stage.EXECUTED
        assert (rover.received, len(rover.commands)) == (3, 2)


async def test_a_command_without_an_answer_is_sent_again_although_the_clock_was_set_back(
    tmp_path: Path,
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with meeting(sky, clock, retransmit_after_s=AGAIN_S) as (relay, rover, client):
        waiting = Waiting(relay, clock, client, rover)
        await waiting.lose(MoveForward(1.0))
        await waiting.wait(-10 * AGAIN_S)
        assert (await stages(client, 1))[-1] is Stage.EXECUTED
        await waiting.wait(AGAIN_S / 2)
        assert (rover.received, len(rover.commands)) == (2, 1)


async def test_neither_a_stop_nor_an_expired_command_nor_without_contact(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    contacts = [(clock.utc_s() + begin_s, 1, 2, 100_000) for begin_s in (0.0, 4 * AGAIN_S)]
    plan = ContactPlan(tuple(Contact(at_s, at_s + AGAIN_S, *path) for at_s, *path in contacts))
    async with meeting(sky, clock, plan, retransmit_after_s=AGAIN_S) as (relay, rover, client):
        waiting = Waiting(relay, clock, client, rover)
        await waiting.lose(Stop())
        await waiting.lose(MoveForward(1.0), lifetime_s=2 * AGAIN_S)
        await waiting.lose(MoveForward(2.0))
        await waiting.wait(3 * AGAIN_S)
        assert not relay.agent.health().queued
        await waiting.wait(1.5 * AGAIN_S)
        await until(lambda: rover.received == 4)
        await waiting.wait(0.0)
        assert [m.inputs for m in rover.commands] == [(), ("1.0",), ("2.0",)]
        assert rover.received == 4


async def carry(agent: BundleAgent, bench: Bench) -> None:
    """Stand where rover-relay does: commands to the router, and what it says then to the ground."""
    while True:
        async with agent.receive() as delivery:
            message = len(bench.ports.notified)
            bench.router.process(BrickLink.RELAY, delivery.payload.decode())
            for _, reply in bench.ports.notified[message:]:
                await agent.send(ORBITER, str(reply).encode())


async def test_an_undelivered_reply_of_the_brick_is_requested_again(tmp_path: Path) -> None:
    sky, clock, bench = Sky(tmp_path, "mocup", numbered=False), Clock(), Bench()
    neighbour = Neighbour(Ipn(ORBITER.node, 0), LtpLink(sky.to_orbiter, answer_s=0.2))
    node = NodeSettings(sky.node("mocup"), (sky.node("mocup"),), (neighbour,))
    listen = Listen(ltp=Address(HERE, sky.rover_ports["mocup"]))
    agent = BundleAgent(node, tmp_path / "far.db", listen, system=UNSYNCED)
    await agent.open(lambda _: None)
    carrying = asyncio.create_task(carry(agent, bench))
    async with (
        orbiting(sky, clock, retransmit_after_s=AGAIN_S) as (relay, (station,)),
        await ground(station) as client,
    ):
        command = client.command(MoveForward(1.5))
        running = asyncio.create_task(client.run(command))
        await until(lambda: len(bench.ports.brick) == 1)
        await until(departed(relay))
        bench.sends(executed(decode(bench.ports.brick[0])))
        bench.start(bench.router.record)
        clock.shift_s += 2 * AGAIN_S
        await relay.retransmit_unanswered()
        outcome = await running
        assert outcome.executed
        past = await catch_up(client, len(outcome.reports))
        assert [n.sequence for n in past] == list(range(1, len(past) + 1))
        assert [n.stage for n in past if n.stage is not None][-1].value == Stage.EXECUTED.value
        clock.shift_s += 2 * AGAIN_S
        await relay.retransmit_unanswered()
        assert not relay.agent.health().queued
        assert len(bench.ports.brick) == 1
    carrying.cancel()
    await asyncio.gather(carrying, return_exceptions=True)
    await agent.close()
