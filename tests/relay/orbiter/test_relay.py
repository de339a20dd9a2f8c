import asyncio
from collections.abc import Iterable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from adapters.bundle import ContactPlan
from adapters.bundle.links.contact import Contact
from adapters.mal import MalError, StandardError
from adapters.mops import LinkHealth
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import (
    AreaError,
    AssetMode,
    NotificationKind,
    ReceivedValue,
    forwarded_command,
)
from executive.commands.catalogue import (
    ExecuteAction,
    FollowPath,
    MoveForward,
    PlanDefinition,
    PreemptionPolicy,
    Request,
    Stop,
    SubmitPlan,
    TakePicture,
    Waypoint,
)
from executive.values.reports import Report, Stage
from tests.relay.orbiter.sky import (
    STAGES,
    Clock,
    Sky,
    catch_up,
    ground,
    landed,
    meeting,
    orbiting,
    until,
)

LONG = FollowPath((Waypoint(1.0 / 3.0, 2.0 / 3.0),) * 200)


def stages(lifecycle: Iterable[Report]) -> list[Stage]:
    return [n.stage for n in lifecycle if n.stage is not None]


def figure(value: ReceivedValue) -> float:
    assert isinstance(value.value, float)
    return value.value


async def refusal(client: MrsClient, request: Request, **how: Any) -> MalError:
    with pytest.raises(MalError) as caught:
        await client.submit(client.command(request, **how))
    return caught.value


async def test_commands_reach_the_rover_and_its_reports_the_ground(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    requests = (MoveForward(-1.5), Stop(), TakePicture(format="png"), ExecuteAction("a, b|#"))
    async with orbiting(sky) as (_, (station,)), landed(sky, "jackal") as rover:
        async with await ground(station) as client:
            for request in requests:
                outcome = await client.run(client.command(request))
                assert outcome.executed
                assert stages(outcome.reports) == list(STAGES)
            past = await client.get_notifications()
            assert [n.report.sequence for n in past] == list(range(1, 4 * len(requests) + 1))
            assert (await client.get_notifications(since=5))[0].report.sequence == 5
        assert [m.command for m in rover.commands] == [
            "MOVE_FORWARD", "STOP", "TAKE_PICTURE", "EXECUTE_ACTION",
        ]  # fmt: skip
        assert rover.commands[0].inputs == ("-1.5",)
        assert {m.dest for m in rover.commands} == {"JACKAL"}


async def test_a_command_sent_without_contact_arrives_when_contact_begins(tmp_path: Path) -> None:
    sky_node = Sky(tmp_path, "jackal").node("jackal")
    rover_node = type(sky_node)(sky_node.node, 0)
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    dawn_s = clock.utc_s() + 3600.0
    plan = ContactPlan((Contact(dawn_s, dawn_s + 600.0, 1, 2, 100_000),))
    async with meeting(sky, clock, plan, queue_warning_s=60.0) as (relay, rover, client):
        message = client.notifications()
        relay.poll()
        commands = [client.command(MoveForward(1.0)), client.command(Stop())]
        runs = [asyncio.create_task(client.run(command)) for command in commands]
        outstanding = relay.rovers[rover_node].record.outstanding
        await until(lambda: outstanding.queued() == 2)
        (queued, octets, dawn, received) = await client.get_value(
            "DTN_QUEUED", "DTN_QUEUED_OCTETS", "DTN_NEXT_CONTACT", "DTN_LAST_RECEIVED"
        )
        assert figure(queued) == 2.0
        assert 100.0 < figure(octets) < 500.0
        assert 3500.0 < figure(dawn) < 3601.0
        assert received.value is None
        assert (await client.get_status()).mode is AssetMode.OFFLINE
        assert (await client.get_status()).queuedCommands == 2
        clock.shift_s = 120.0
        relay.poll()
        assert rover.commands == []
        clock.shift_s = 3601.0
        assert [o.executed for o in await asyncio.gather(*runs)] == [True, True]
        assert [m.command for m in rover.commands] == ["STOP", "MOVE_FORWARD"]
        await until(lambda: relay.link_status(rover_node).queued == 0)
        relay.poll()
        link = [(await anext(message)).report for _ in range(13)]
        link = [n for n in link if n.kind is NotificationKind.LINK and forwarded_command(n) is None]
        assert [n.sequence for n in link] == [0, 0, 0]
        dark, old, light = (n.text for n in link)
        assert dark.startswith("no contact until ")
        assert old.startswith("a command has waited for 120 s; next contact at ")
        assert light == "contact"
        names = (
            "DTN_QUEUED",
            "DTN_QUEUED_OCTETS",
            "DTN_OLDEST_AGE",
            "DTN_SENT",
            "DTN_ACKNOWLEDGED",
        )
        values = await client.get_value(*names)
        assert list(map(figure, values)) == [0.0, 0.0, 0.0, 2.0, 2.0]
        reported = LinkHealth(
            clock.utc_s(), 3, 1.5, None, 0.25, 0, 0, True, 700, 9, 6, 1, 0, 2, round_trip_s=0.125
        )
        await rover.link(reported)
        await until(lambda: relay.rovers[rover_node].aboard is not None)
        aboard = ("CONTACT", "QUEUED_OCTETS", "SENT", "RETRANSMITTED", "RECEIVED", "ROUND_TRIP")
        values = await client.get_value(*(f"DTN_ABOARD_{name}" for name in aboard))
        assert list(map(figure, values)) == [1.0, 700.0, 9.0, 1.0, 2.0, 0.125]
        await rover.housekeeping(EXEC_TICK=0.0625, EXEC_GOALS=None, EXEC_OF_TOMORROW=1.0)
        await until(lambda: bool(relay.rovers[rover_node].housekeeping.figures))
        tick, goals, brick = await client.get_value("EXEC_TICK", "EXEC_GOALS", "NXT_CONNECTED")
        assert figure(tick) == 0.0625
        assert {goals.value, brick.value} == {None}
        memory, free = await client.get_value("ORBITER_MEMORY", "ORBITER_DISK_FREE")
        assert figure(memory) > 1e7
        assert figure(free) > 0.0
        assert (await client.get_status()).mode is AssetMode.STOPPED


async def test_a_repeat_receives_the_known_reports_and_is_uplinked_once(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (_, (station,)), landed(sky, "jackal") as rover:
        async with await ground(station) as client:
            command = client.command(MoveForward(1.0))
            await client.run(command)
            outcome = await client.run(command)
            assert outcome.refusal is not None
            assert outcome.refusal.number == AreaError.DUPLICATE.value
            message = client.notifications()
            other = client.command(MoveForward(2.0), command_id=command.identity.command_id)
            with pytest.raises(MalError) as caught:
                await client.submit(other)
            assert caught.value.number == AreaError.DUPLICATE.value
            assert "is used by another command" in (await anext(message)).report.text
            with pytest.raises(MalError):
                await client.submit(command)
            again = (await anext(message)).report
            assert again.sequence == 4
            assert again.identity == command.identity
        assert rover.received == 1


async def test_what_cannot_go_is_refused_at_the_orbiter(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    plan = SubmitPlan(PlanDefinition("p", "p", "BTCPP4", Random(1).randbytes(8000)))
    async with orbiting(sky) as (relay, (station,)), await ground(station) as client:
        for request in (LONG, plan):
            error = await refusal(client, request)
            assert error.number == AreaError.REJECTED.value
            assert "4096" in str(getattr(error.extra, "value", ""))
        error = await refusal(client, MoveForward(1.0), preemption=PreemptionPolicy.REPLACE)
        assert error.number == AreaError.NOT_SUPPORTED.value
        error = await refusal(client, MoveForward(1.0), command_id=0)
        assert error.number == AreaError.INVALID.value
        error = await refusal(client, MoveForward(1.0), lifetime_s=-1.0)
        assert error.number == AreaError.REJECTED.value
        with pytest.raises(MalError) as caught:
            await client.list_actions()
        assert caught.value.number == AreaError.NOT_SUPPORTED.value
        async with await ground(station, "no spaces allowed") as stranger:
            error = await refusal(stranger, MoveForward(1.0))
            assert error.number == AreaError.REJECTED.value
        assert relay.agent.health().queued == 0


async def test_a_command_that_cannot_be_written_down_is_not_acknowledged(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with meeting(sky) as (relay, rover, client):
        (relayed,) = relay.rovers.values()
        read = relayed.record.ledger.rows
        ((pages,),), ((maximum,),) = read("PRAGMA page_count"), read("PRAGMA max_page_count")
        read(f"PRAGMA max_page_count = {pages}")
        sent = []

        async def fill() -> None:
            for number in range(1, 1000):
                sent.append(client.command(MoveForward(float(number))))
                await client.submit(sent[-1])

        with pytest.raises(MalError) as caught:
            await fill()
        assert caught.value.number == StandardError.INTERNAL.value
        assert "full" in str(getattr(caught.value.extra, "value", ""))
        read(f"PRAGMA max_page_count = {maximum}")
        with pytest.raises(MalError) as caught:
            await client.submit(sent[-1])
        assert caught.value.number == AreaError.DUPLICATE.value
        past = await catch_up(client, len(STAGES) * len(sent))
        assert [n.sequence for n in past] == list(range(1, len(past) + 1))
        assert len(rover.commands) == len(sent)


async def test_a_command_that_expires_is_reported(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with orbiting(sky, clock) as (relay, (station,)), await ground(station) as client:
        message = client.notifications()
        command = client.command(MoveForward(1.0), lifetime_s=30.0)
        await client.submit(command)
        clock.shift_s = 60.0
        text = (await anext(message)).report.text
        assert text.startswith(f"{command.identity} may not have reached the rover")
        assert relay.agent.health().queued == 0


async def test_rovers_do_not_disturb_one_another(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal", "mocup")
    async with (
        orbiting(sky) as (_, (jackal, mocup)),
        landed(sky, "mocup") as there,
        await ground(jackal) as silent,
        await ground(mocup) as client,
    ):
        waiting = silent.command(MoveForward(1.0))
        await silent.submit(waiting)
        same = client.command(MoveForward(2.0), command_id=waiting.identity.command_id)
        assert (await client.run(same)).executed
        await there.event("a stone")
        received = await catch_up(client, 5)
        assert received[-1].text == "a stone"
        assert await silent.get_notifications() == ()
        async with landed(sky, "jackal") as late:
            await until(lambda: len(late.commands) == 1)
        assert [m.inputs for m in there.commands] == [("2.0",)]


async def test_a_sender_under_another_name_receives_a_hint(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky), landed(sky, "jackal") as rover:
        rover.name = "SCOUT"
        await rover.event("it is cold")
        await until(lambda: "source: SCOUT is not JACKAL; correct asset in" in caplog.text)
        assert "of the sender at ipn:2.1" in caplog.text
