"""An operator opens and closes the way to a rover, before the plan."""

import asyncio
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from adapters.bundle import ContactPlan
from adapters.bundle.links.contact import ContactPlanError, parse_plan
from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AreaError, NotificationKind, Stage, describe_error, forwarded_command
from adapters.relay.orbiter.link_status import list_contacts
from executive.commands.catalogue import ExecuteAction, MoveForward
from tests.relay.orbiter.sky import (
    Clock,
    Sky,
    eclipse,
    ground,
    landed,
    meeting,
    orbiting,
    rover,
    until,
)


async def refused(client: MrsClient, action: str) -> str:
    with pytest.raises(MalError) as caught:
        await client.submit(client.command(ExecuteAction(action)))
    return describe_error(caught.value)


async def test_lines_open_the_contact_in_an_outage_and_are_not_uplinked(tmp_path: Path) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    async with (
        orbiting(sky, clock, eclipse(clock)) as (_, (station,)),
        landed(sky, "jackal") as far,
    ):
        typed = "contact up\nmoveForward 1.5\n"
        status, text = await rover("mops", "--to", str(station.uri), typed=typed)
        assert status == 0, text
        assert [message.command for message in far.commands] == ["MOVE_FORWARD"]
        assert "held open by the operator" in text
        typed = "status\ncontact ajar\n"
        status, text = await rover("mops", "--to", str(station.uri), typed=typed)
        assert "DTN_OVERRIDE=1.000" in text
        assert status == 1
        assert "unknown action 'CONTACT AJAR'; the orbiter has: CONTACT UP" in text
        assert far.received == 1


@pytest.mark.parametrize("numbered", [True, False])
async def test_the_contact_is_closed_until_it_is_returned_to_the_plan(
    tmp_path: Path, numbered: bool
) -> None:
    sky = Sky(tmp_path, "jackal", numbered=numbered)
    async with meeting(sky) as (relay, far, client):
        far.ledger = far.ledger if numbered else ""
        text = client.notifications()
        relay.poll()
        down = client.command(ExecuteAction(" contact  Down "))
        assert (await client.run(down)).executed
        relay.poll()
        (left,) = await client.get_value("DTN_NEXT_CONTACT")
        assert left.value is None
        waiting = asyncio.create_task(client.run(client.command(MoveForward(1.0))))
        await until(lambda: relay.agent.health().queued == 1)
        again = await client.run(down)
        assert again.refusal is not None
        assert again.refusal.number == AreaError.DUPLICATE.value
        assert [each.stage for each in again.reports] == [Stage.EXECUTED]
        assert far.commands == []
        assert (await client.run(client.command(ExecuteAction("CONTACT PLAN")))).executed
        assert (await waiting).executed
        relay.poll()
        links: list[str | None] = []
        while len(links) < 3:
            each = (await anext(text)).report
            if each.kind is NotificationKind.LINK and forwarded_command(each) is None:
                links.append(each.text)
        assert links == [
            "contact",
            "no contact: held closed by the operator until CONTACT PLAN",
            "contact",
        ]
        assert len(far.commands) == 1


async def test_one_rover_is_held_and_the_other_is_not(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal", "mocup")
    async with (
        orbiting(sky) as (relay, (jackal, mocup)),
        landed(sky, "mocup") as there,
        await ground(jackal) as silent,
        await ground(mocup) as client,
    ):
        assert (await silent.run(silent.command(ExecuteAction("CONTACT DOWN")))).executed
        assert (await client.run(client.command(MoveForward(1.0)))).executed
        assert [relay.link_status(node).contact for node in relay.rovers] == [False, True]
        assert len(there.commands) == 1


async def test_the_plan_is_read_again_and_retained_if_the_new_one_is_invalid(
    tmp_path: Path,
) -> None:
    sky, clock = Sky(tmp_path, "jackal"), Clock()
    plans: list[ContactPlan | ContactPlanError] = [
        ContactPlanError("contact plan p: line 1: not a whole number: 'x'"),
        ContactPlan(),
    ]

    def read() -> ContactPlan:
        plan = plans.pop(0)
        if isinstance(plan, Exception):
            raise plan
        return plan

    async with (
        orbiting(sky, clock, eclipse(clock), read) as (relay, (station,)),
        await ground(station) as client,
    ):
        (node,) = relay.rovers
        planned_s = relay.link_status(node).next_contact_s
        up, down = await client.get_value("DTN_CONTACTS_UP", "DTN_CONTACTS_DOWN")
        assert isinstance(up.value, str)
        begin, end = map(datetime.fromisoformat, up.value.split("/"))
        assert end - begin == timedelta(seconds=600)
        assert begin.timestamp() == pytest.approx(clock.utc_s() + planned_s, abs=2.0)
        assert down.value == ""
        assert (await client.get_value("DTN_CONTACTS_UP"))[0].utc_s == up.utc_s
        assert (await client.run(client.command(ExecuteAction("CONTACT UP")))).executed
        fault = await refused(client, "CONTACT PLAN")
        assert fault == "Rejected: contact plan p: line 1: not a whole number: 'x'"
        assert relay.link_status(node).contact, "a broken plan changes nothing"
        assert planned_s < float("inf")
        assert (await client.run(client.command(ExecuteAction("CONTACT PLAN")))).executed
        assert not relay.link_status(node).contact
        assert relay.link_status(node).next_contact_s == float("inf")
        (up,) = await client.get_value("DTN_CONTACTS_UP")
        assert up.value == ""
        assert "Invalid" in await refused_number_0(client)


def test_a_contact_that_is_planned_for_ever_is_listed() -> None:
    plan = parse_plan("a contact +0 +999999999999999999 1 2 125000", 1.8e9)
    listed = list_contacts(plan, 1, 2, None, 1.8e9)
    up, _ = listed.values()
    assert up.value is not None
    assert up.value.value == "2027-01-15T08:00:00Z/9999-12-31T23:59:59Z"
    assert list_contacts(plan, 1, 2, listed, 1.9e9) is listed


async def refused_number_0(client: MrsClient) -> str:
    with pytest.raises(MalError) as caught:
        await client.submit(client.command(ExecuteAction("CONTACT UP"), command_id=0))
    return describe_error(caught.value)
