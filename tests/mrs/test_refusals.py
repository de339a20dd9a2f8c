"""What is not carried out: the error, what is notified, and octets that no sound client sends."""

import asyncio
from dataclasses import replace

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    NamedValue,
    StandardError,
    TypedAttribute,
    TypedList,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import Stage
from executive.commands import (
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.values.reasons import Reason
from tests.mrs.aboard import HEADER, Aboard, raises, reading, stages

HEAD = reading("HEAD")


@pytest.mark.parametrize(
    ("request_", "number", "extra", "code"),
    [
        (MoveForward(1e6), 1, TypedList(AttributeType.UINTEGER, (1,)), Reason.OUT_OF_RANGE),
        (MoveForward(float("nan")), 1, TypedList(AttributeType.UINTEGER, (1,)), Reason.NOT_FINITE),
        (DriveFor(0.1, 0.1, 1e9), 1, TypedList(AttributeType.UINTEGER, (3,)), Reason.OUT_OF_RANGE),
        (FollowPath(()), 1, TypedList(AttributeType.UINTEGER, (1,)), Reason.EMPTY_PATH),
        (Resume(), 2, None, Reason.WRONG_MODE),
        (TakePicture(format="RAW"), 4, None, Reason.NOT_SUPPORTED),
    ],
)
def test_refuses_with_number_and_cause(
    aboard: Aboard, request_: Request, number: int, extra: object, code: Reason
) -> None:
    (outcome,) = aboard.carry_out(request_)
    assert not outcome.executed
    assert outcome.refusal is not None
    assert outcome.refusal.number == number
    assert extra is None or outcome.refusal.extra == extra
    assert stages(outcome) == [Stage.RECEIVED, Stage.REJECTED]
    assert outcome.reports[-1].reason is code
    assert outcome.reports[-1].text


def test_a_drive_without_battery_for_its_return_is_refused_with_its_figures(aboard: Aboard) -> None:
    aboard.do(lambda bench: setattr(bench, "charge_ratio", 0.1))
    aboard.run(0.1)
    (outcome,) = aboard.carry_out(MoveForward(1.0))
    assert outcome.refusal is not None
    assert outcome.refusal.number == 2
    assert stages(outcome) == [Stage.RECEIVED, Stage.REJECTED]
    assert outcome.reports[-1].reason is Reason.BATTERY_INSUFFICIENT
    figures = {each.name: each.value for each in outcome.reports[-1].figures}
    assert figures["needed"] > 0.0 == figures["left"]
    assert figures["reserve"] == 97_200.0
    (home,) = aboard.carry_out(MoveTo(Waypoint(0.0, 0.0)))
    assert home.executed


async def test_reports_busy_when_the_queue_is_full(aboard: Aboard, client: MrsClient) -> None:
    capacity = aboard.do(lambda bench: bench.settings.drive.queue_length)
    for _ in range(capacity):
        await client.submit(client.command(MoveForward(1.0)))
    with raises(6):
        await client.submit(client.command(MoveForward(1.0)))


async def test_a_name_too_long_to_be_sent_back_is_refused(
    aboard: Aboard, consumer: Consumer
) -> None:
    header = replace(HEADER, source="x" * 100_000)

    with raises(1, 0):
        await consumer.submit("MotionControl", "moveForward", header, 1.0)
    assert aboard.do(lambda bench: bench.received.reports) == []


@pytest.mark.parametrize(
    ("service", "operation", "parts"),
    [
        ("Plan", "getPlanStatus", (("survey",) * 1001,)),
        ("Monitoring", "getValue", (("HEAD",) * 1001,)),
        ("MonitoringClient", "getValue", ("jackal", ("HEAD",) * 1001)),
        ("Monitoring", "publishParameters", ((HEAD,) * 1001,)),
    ],
)
async def test_no_request_is_large_enough_to_delay_others(
    service: str, operation: str, parts: tuple[object, ...], consumer: Consumer
) -> None:
    call = consumer.submit if operation.startswith("publish") else consumer.request
    with raises(StandardError.TOO_MANY.value):
        await call(service, operation, *parts)


async def test_number_nought_is_refused(client: MrsClient) -> None:
    with raises(1, 0):
        await client.submit(client.command(MoveForward(1.0), command_id=0))


def test_a_repeat_is_not_executed_and_receives_the_last_report_again(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        command = client.command(MoveForward(0.2))
        assert (await client.run(command)).executed
        position = aboard.do(lambda bench: bench.rover.pose)
        again = await client.run(command)
        assert again.refusal is not None
        assert again.refusal.number == 3
        assert again.refusal.extra == TypedAttribute(
            AttributeType.LONG, command.identity.command_id
        )
        assert stages(again) == [Stage.EXECUTED]
        assert not again.executed
        other = await client.run(
            client.command(MoveForward(0.3), command_id=command.identity.command_id)
        )
        assert other.refusal is not None
        assert other.refusal.number == 3
        assert not other.executed
        assert aboard.do(lambda bench: bench.rover.pose) == position

    aboard.runs = True
    aboard.ground(session)


async def test_an_expired_command_is_not_begun(aboard: Aboard, consumer: Consumer) -> None:
    aboard_s = aboard.do(lambda bench: bench.clock.utc_s())
    header = replace(HEADER, lifetime=2.0, creationTime=round((aboard_s - 3.0) * 1e9))

    with pytest.raises(MalError) as raised:
        await consumer.submit("MotionControl", "moveForward", header, 1.0)
    error = raised.value
    assert error.number == 2
    assert "2 s" in error.extra.value


async def test_an_unknown_arrival_never_reaches_the_core(
    aboard: Aboard, consumer: Consumer
) -> None:
    later = NamedValue(name="preemption", value=TypedAttribute(AttributeType.IDENTIFIER, "later"))

    with raises(1):
        await consumer.submit("MotionControl", "moveForward", HEADER, 1.0, supplements=(later,))
    assert aboard.do(lambda bench: bench.stages(1)) == []


def test_a_silent_core_is_reported(aboard: Aboard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adapters.mrs.aboard.gateway.ANSWER_TIMEOUT_S", 0.05)
    aboard.do(lambda bench: setattr(bench.executive, "wake", lambda: None))

    async def session(client: MrsClient) -> None:
        with pytest.raises(MalError, match=r"no answer of the executive within 0\.05 s"):
            await client.get_pose()
        with pytest.raises(MalError, match="same commandId"):
            await client.submit(client.command(MoveForward(1.0)))

    aboard.ground(session)


async def test_endless_requests_delay_no_stop(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch, client: MrsClient
) -> None:
    monkeypatch.setattr("adapters.mrs.aboard.gateway.MAX_PENDING", 3)
    turn = aboard.do(lambda bench: bench.executive.wake)
    aboard.do(lambda bench: setattr(bench.executive, "wake", lambda: None))

    requested = [asyncio.create_task(client.get_pose()) for _ in range(3)]
    await asyncio.sleep(0)
    for refused in (client.get_pose(), client.submit(client.command(MoveForward(1.0)))):
        with raises(StandardError.TOO_MANY.value):
            await refused
    stop = asyncio.create_task(client.submit(client.command(Stop())))
    while not stop.done():
        aboard.do(lambda bench: bench.executive.serve_inbox())
        await asyncio.sleep(0.01)
    await stop
    await asyncio.gather(*requested)
    aboard.do(lambda bench: setattr(bench.executive, "wake", turn))
    await client.get_pose()
