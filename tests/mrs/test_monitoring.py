"""Monitoring, Notification and Status as a client uses them: filters, on change, definitions."""

from collections.abc import Callable

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    Subscription,
    SubscriptionFilter,
    Typed,
    UpdateHeader,
)
from adapters.mrs.ground.client import MrsClient
from adapters.mrs.spec.types import (
    Notification,
    NotificationKind,
    ParameterValue,
    Severity,
    Stage,
)
from executive.commands.catalogue import (
    MoveForward,
    Request,
    SetCameraRotateSpeed,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
)
from tests.mrs.aboard import Aboard, LinkedBench

UNITS = {
    "POS_X": "m",
    "POS_Y": "m",
    "POS_Z": "m",
    "HEAD": "rad",
    "TRAVEL_SPEED": "m/s",
    "ROTATE_SPEED": "rad/s",
    "CURRENT_TRAVEL_SPEED": "m/s",
    "CURRENT_ROTATE_SPEED": "rad/s",
    "BATERY_VOLTAGE": "V",
    "CAM_PAN": "rad",
    "CAM_TILT": "rad",
    "CAM_ROTATE_SPEED": "rad/s",
}
SETTERS: dict[str, Callable[[float], Request]] = {
    "TRAVEL_SPEED": SetTravelSpeed,
    "ROTATE_SPEED": SetRotateSpeed,
    "CAM_ROTATE_SPEED": SetCameraRotateSpeed,
}


def is_one_of(name: str, *values: Typed) -> SubscriptionFilter:
    return SubscriptionFilter(name=name, values=values)


def names(*texts: str) -> tuple[Typed, ...]:
    return tuple(Typed(AttributeType.IDENTIFIER, text) for text in texts)


def test_every_parameter_is_defined_with_its_unit(aboard: Aboard) -> None:
    definitions = aboard.ground(lambda client: client.list_definition())
    assert {each.name: each.unit for each in definitions} == UNITS
    assert all(each.description and each.type is AttributeType.DOUBLE for each in definitions)


def test_what_is_writable_can_be_set_and_nothing_else_is(aboard: Aboard) -> None:
    definitions = aboard.ground(lambda client: client.list_definition())
    assert {each.name for each in definitions if each.writable} == SETTERS.keys()
    aboard.carry_out(*(setter(0.3) for setter in SETTERS.values()))

    async def session(client: MrsClient) -> None:
        for value in await client.get_value(*SETTERS):
            assert value.value == Typed(AttributeType.DOUBLE, 0.3), value.name

    aboard.ground(session)


@pytest.mark.parametrize(
    ("filters", "heard"),
    [
        ((is_one_of("parameter", *names("HEAD", "POS_X")),), ["POS_X", "HEAD"]),
        ((is_one_of("parameter", *names("*")), is_one_of("asset", *names("jackal"))), [*UNITS]),
        ((is_one_of("parameter", *names("HEAD")), is_one_of("asset", *names("scout"))), []),
        ((is_one_of("parameter", *names("MASS")),), []),
    ],
)
async def test_a_subscription_is_for_the_parameters_and_assets_it_names(
    aboard: Aboard, filters: tuple[SubscriptionFilter, ...], heard: list[str], consumer: Consumer
) -> None:
    found: list[str] = []

    def hear(update: UpdateHeader, value: ParameterValue) -> None:
        assert update.source == "jackal"
        found.append(value.name)

    subscription = Subscription(subscriptionId="some", filters=filters)
    await consumer.subscribe("Monitoring", "monitorValue", subscription, hear)
    aboard.run(2.0)
    await consumer.request("ServiceLayer", "getAsset")
    assert found == heard * 2
    await consumer.unsubscribe("Monitoring", "monitorValue", "some")
    aboard.run(2.0)
    await consumer.request("ServiceLayer", "getAsset")
    assert found == heard * 2


async def test_on_change_a_client_hears_what_changed_and_no_more(
    aboard: Aboard, consumer: Consumer
) -> None:
    found: list[str] = []

    def hear(_: UpdateHeader, value: ParameterValue) -> None:
        found.append(value.name)

    aboard.do(lambda bench: bench.submit(SetStatusInterval(0.0), 1))
    aboard.run(0.5)
    everything = Subscription(subscriptionId="all")
    await consumer.subscribe("Monitoring", "monitorValue", everything, hear)
    aboard.run(5.0)
    assert await consumer.request("Status", "getStatusInterval") == (0.0,)
    assert found == []
    aboard.do(lambda bench: bench.submit(SetTravelSpeed(0.5), 2))
    aboard.run(0.5)
    aboard.do(lambda bench: bench.submit(MoveForward(0.5), 3))
    aboard.run(5.0)
    await consumer.request("Status", "getStatusInterval")
    assert found[0] == "TRAVEL_SPEED"
    assert found.count("TRAVEL_SPEED") == 1
    assert set(found) == {"TRAVEL_SPEED", "POS_X", "CURRENT_TRAVEL_SPEED"}


@pytest.mark.parametrize(
    ("filters", "heard"),
    [
        ((is_one_of("commandId", Typed(AttributeType.LONG, 2)),), {(2, Stage.EXECUTED)}),
        (
            (is_one_of("stage", Typed(AttributeType.UOCTET, Stage.CANCELLED.value)),),
            {(1, Stage.CANCELLED)},
        ),
        ((is_one_of("severity", Typed(AttributeType.UOCTET, 2)),), {(1, Stage.CANCELLED)}),
        ((is_one_of("kind", Typed(AttributeType.UOCTET, 3)),), set()),
    ],
)
async def test_notifications_are_filtered_by_their_keys(
    aboard: Aboard,
    filters: tuple[SubscriptionFilter, ...],
    heard: set[tuple[int | None, Stage]],
    consumer: Consumer,
) -> None:
    found: list[tuple[int | None, Stage | None]] = []

    def hear(_: UpdateHeader, notification: Notification) -> None:
        found.append((notification.commandId, notification.stage))

    subscription = Subscription(subscriptionId="some", filters=filters)
    await consumer.subscribe("Notification", "monitorNotification", subscription, hear)
    aboard.do(lambda bench: bench.submit(MoveForward(5.0), 1))
    aboard.run(1.0)
    aboard.do(lambda bench: bench.submit(Stop(), 2))
    aboard.run(1.0)
    await consumer.request("ServiceLayer", "getAsset")
    ends = {(number, stage) for number, stage in found if stage in _ENDS}
    assert ends == heard
    everything = aboard.do(lambda bench: len(bench.heard.reports))
    assert len(found) < everything


_ENDS = (Stage.EXECUTED, Stage.CANCELLED)


def test_events_do_not_pile_up_behind_a_ledger_that_cannot_be_written(aboard: Aboard) -> None:
    dust = Notification(
        kind=NotificationKind.EVENT,
        severity=Severity.WARNING,
        timestamp=0,
        sequence=0,
        text="dust",
    )

    def write(possible: bool) -> None:
        def turn(bench: LinkedBench) -> None:
            bench.fill_disk(not possible)
            bench.run(0.1)

        aboard.do(turn)

    async def session(client: MrsClient) -> None:
        write(possible=False)
        await client.send_notification(dust)
        with pytest.raises(MalError, match="cannot be written"):
            await client.send_notification(dust)
        write(possible=True)
        await client.send_notification(dust)

    aboard.ground(session)
    told = aboard.do(lambda bench: [report.text for report in bench.heard.reports])
    assert told.count("dust") == 2
