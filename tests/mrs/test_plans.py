"""Plans from the ground: octets on a real socket, commands as typed."""

import asyncio
import threading
from pathlib import Path

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    NamedValue,
    Subscription,
    TypedAttribute,
    UpdateHeader,
)
from adapters.mrs.ground import CommandOutcome, MrsClient
from adapters.mrs.spec import AreaError, AssetMode, ReceivedReport, Stage
from adapters.mrs.spec.mapping import definition_of, wire_definition
from adapters.mrs.spec.types import PlanDefinition
from executive.commands import (
    AbortPlan,
    ActivatePlan,
    AnswerQuestion,
    HoldAtNode,
    MoveForward,
    RemovePlan,
    Request,
    Resume,
    ResumePlan,
    RetryNode,
    SkipNode,
    Stop,
    SubmitPlan,
    SuspendPlan,
)
from executive.values.reasons import Reason
from executive.values.reports import PlanStatus, PlanUpdate
from tests.mrs.aboard import Aboard, number_of, raises
from tests.support.plans import plan

pytestmark = pytest.mark.usefixtures("running")

AHEAD = plan('<moveForward distance="3" deadline_s="60"/>')


async def test_a_plan_is_returned_as_submitted(client: MrsClient) -> None:
    named = plan('<moveForward distance="{far}" deadline_s="60"/>', far="2")
    await send(client, SubmitPlan(named))
    assert await client.get_plan("survey") == named
    with raises(AreaError.NOT_FOUND.value):
        await client.get_plan("another")


def is_of_plan(received: ReceivedReport) -> bool:
    identity = received.report.identity
    return identity is not None and identity.source == "plan:survey"


async def send(client: MrsClient, *requests: Request) -> list[CommandOutcome]:
    return [await client.run(client.command(request)) for request in requests]


async def test_a_plan_is_watched_to_its_end(client: MrsClient) -> None:
    updates, arrived = await client.plan_updates(), []
    notifications = client.notifications()
    outcomes = await send(client, SubmitPlan(AHEAD), ActivatePlan("survey"))
    assert all(outcome.executed for outcome in outcomes)
    async for update in updates:
        arrived.append(update)
        if update.status is PlanStatus.EXECUTING and update.node:
            status = await client.get_status()
            assert (status.mode, status.activePlan) == (AssetMode.PLAN, "survey")
        if update.status is PlanStatus.COMPLETED:
            break
    async for received in notifications:
        if is_of_plan(received) and received.report.stage is Stage.EXECUTED:
            break
    assert await client.get_plan_status("survey") == (arrived[-1],)
    assert [update.status.name for update in arrived] == [
        "SUBMITTED",
        "ACTIVATED",
        "EXECUTING",
        "EXECUTING",
        "COMPLETED",
    ]
    assert [(update.done, update.total) for update in arrived][-1] == (1, 1)
    assert arrived[-1].node == "plan:survey/moveForward"


async def test_a_stop_suspends_and_resume_plan_continues(client: MrsClient) -> None:
    updates = await client.plan_updates()
    await send(client, SubmitPlan(AHEAD), ActivatePlan("survey"))
    async for update in updates:
        if update.node:
            break
    (stopped,) = await send(client, Stop())
    assert stopped.executed
    assert (await client.get_status()).mode is AssetMode.STOPPED
    (early,) = await send(client, ResumePlan("survey"))
    assert not early.executed
    await send(client, Resume())
    status = await client.get_status()
    assert (status.mode, status.activePlan) == (AssetMode.PAUSED, None)
    (unknown,) = await send(client, ResumePlan("survey", "wp2"))
    assert unknown.refusal is not None
    assert (unknown.refusal.number, unknown.refusal.extra.value) == (5, "wp2")
    assert unknown.reports[-1].text.endswith("remaining steps: moveForward")
    (outcome,) = await send(client, ResumePlan("survey", "moveForward"))
    assert outcome.executed
    assert outcome.reports[-1].text.endswith("at moveForward")
    async for update in updates:
        if update.status is PlanStatus.COMPLETED:
            break


async def test_a_plan_is_steered(client: MrsClient) -> None:
    """Node and option in octets, refusals as the errors of the XML."""
    question = '<Ask name="ditch" question="?" options="go;stay" deadline_s="9000" answer="{a}"/>'
    far = '<moveForward name="far" distance="90" deadline_s="900"/>'
    body = f'<Sequence>{far}{question}<takePicture name="photo" deadline_s="9"/></Sequence>'
    updates = await client.plan_updates()
    await send(client, SubmitPlan(plan(body)), ActivatePlan("survey"))
    async for update in updates:
        if update.node:
            break
    errors = []
    for request in (
        SkipNode("survey", "near", "SUCCESS"),
        SkipNode("survey", "far", "MAYBE"),
        RetryNode("survey", "photo"),
        HoldAtNode("survey", "far"),
        AnswerQuestion("survey", "far", "go"),
        AnswerQuestion("survey", "ditch", "fly"),
    ):
        (outcome,) = await send(client, request)
        assert outcome.refusal is not None
        extra = outcome.refusal.extra
        found = getattr(extra, "value", None) or getattr(extra, "values", None)
        errors.append((AreaError(outcome.refusal.number).name, found))
    assert errors[0] == ("NOT_FOUND", "near")
    assert errors[1] == errors[5] == ("INVALID", (3,))
    unfit = "plan:survey/Sequence/photo is not running: only what runs is begun again"
    assert errors[2] == ("REJECTED", unfit)
    assert errors[3] == ("REJECTED", "plan:survey/Sequence/far runs already: suspend the plan")
    assert errors[4] == ("NOT_FOUND", "far")
    steering = (
        HoldAtNode("survey", "photo"),
        AnswerQuestion("survey", "ditch", "go"),
        RetryNode("survey", "far"),
        SkipNode("survey", "far", "SUCCESS"),
    )
    assert all(outcome.executed for outcome in await send(client, *steering))
    async for update in updates:
        if update.status is PlanStatus.SUSPENDED:
            break
    assert update.text == "held at plan:survey/Sequence/photo"
    await send(client, ResumePlan("survey"))
    async for update in updates:
        if update.status is PlanStatus.COMPLETED:
            break


@pytest.mark.parametrize(
    ("request_", "number", "message"),
    [
        (ActivatePlan("nothing"), 5, "nothing"),
        (RemovePlan("nothing"), 5, "nothing"),
        (SuspendPlan("survey"), 2, "is SUBMITTED"),
        (SubmitPlan(AHEAD), 2, "exists: remove it"),
        (SubmitPlan(plan("<fly/>", "other")), 1, None),
    ],
)
async def test_what_cannot_be_is_answered_by_an_error(
    request_: Request, number: int, message: str | None, client: MrsClient
) -> None:
    await send(client, SubmitPlan(AHEAD))
    (outcome,) = await send(client, request_)
    assert outcome.refusal is not None
    assert outcome.refusal.number == number
    if message is None:
        assert outcome.refusal.extra.values == (1,)
        assert outcome.reports[-1].reason is Reason.PLAN_UNKNOWN_NODE
        assert outcome.reports[-1].text.startswith("line 3: unknown node 'fly'")
    else:
        assert message in outcome.refusal.extra.value


async def test_the_status_of_no_plan_is_not_found(client: MrsClient) -> None:
    assert await client.get_plan_status() == ()
    with raises(5):
        await client.get_plan_status("nothing")


def test_updates_carry_their_keys(running: Aboard) -> None:
    async def session(consumer: Consumer) -> object:
        arrived: asyncio.Queue[UpdateHeader] = asyncio.Queue()
        await consumer.subscribe(
            "Plan",
            "monitorPlanExecution",
            Subscription(subscriptionId="mine"),
            lambda header, _: arrived.put_nowait(header),
        )
        threading.Thread(target=submit).start()
        return [key.value and key.value.value for key in (await arrived.get()).keyValues or ()]

    def submit() -> None:
        async def inner(client: MrsClient) -> None:
            await send(client, SubmitPlan(AHEAD))

        running.ground(inner)

    assert running.consume(session) == ["jackal", "survey", 1]


def test_after_a_kill_it_is_suspended_and_continues(tmp_path: Path) -> None:
    first = Aboard(tmp_path)
    first.runs = True

    async def begin(client: MrsClient) -> None:
        updates = await client.plan_updates()
        await send(client, SubmitPlan(AHEAD), ActivatePlan("survey"))
        async for update in updates:
            if update.node:
                return

    async def proceed(client: MrsClient) -> list[int]:
        (found,) = await client.get_plan_status()
        assert found.status is PlanStatus.SUSPENDED
        assert "restarted" in found.text
        updates = await client.plan_updates()
        (outcome,) = await send(client, ResumePlan("survey"))
        assert outcome.executed
        async for update in updates:
            if update.status is PlanStatus.COMPLETED:
                break
        past = await client.get_notifications(since=1)
        return [number_of(n) or 0 for n in past if is_of_plan(n)]

    first.ground(begin)
    first.die()
    second = Aboard(tmp_path)
    second.runs = True
    try:
        assert sorted(set(second.ground(proceed))) == [1, 2]
    finally:
        second.close()


def test_updates_missed_while_the_link_was_lost_are_caught_up(running: Aboard) -> None:
    async def session(client: MrsClient) -> PlanUpdate:
        updates = await client.plan_updates()
        await send(client, SubmitPlan(AHEAD), ActivatePlan("survey"))
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, running.hang_up)
        await loop.run_in_executor(None, running.run, 30.0)
        await loop.run_in_executor(None, running.listen)
        async for update in updates:
            if update.status is PlanStatus.COMPLETED:
                return update
        raise AssertionError("the stream ended")

    assert running.ground(session).done == 1


@pytest.mark.parametrize(
    ("typed", "text"),
    [
        (TypedAttribute(AttributeType.DOUBLE, 1.5), "1.5"),
        (TypedAttribute(AttributeType.INTEGER, -3), "-3"),
        (TypedAttribute(AttributeType.IDENTIFIER, "a"), "a"),
    ],
)
def test_arguments_are_texts_or_numbers(typed: TypedAttribute, text: str) -> None:
    given = (NamedValue(name="x", value=typed),)
    wire = PlanDefinition(planId="p", name="", format="BTCPP4", content=b"", arguments=given)
    assert definition_of(wire).arguments[0].text == text
    assert definition_of(wire_definition(definition_of(wire))) == definition_of(wire)


@pytest.mark.parametrize(
    "typed", [None, TypedAttribute(AttributeType.BLOB, b""), TypedAttribute(AttributeType.TIME, 1)]
)
def test_other_arguments_are_invalid(typed: TypedAttribute | None) -> None:
    given = (NamedValue(name="x", value=typed),)
    wire = PlanDefinition(planId="p", name="", format="BTCPP4", content=b"", arguments=given)
    with raises(1):
        definition_of(wire)


async def test_aborted_from_the_ground(client: MrsClient) -> None:
    requests = (SubmitPlan(AHEAD), ActivatePlan("survey"), AbortPlan("survey"), MoveForward(0.2))
    assert [outcome.executed for outcome in await send(client, *requests)] == [True] * 4
