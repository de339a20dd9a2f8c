"""The operations that read, and those that broadcast: values, definitions, filters, the past."""

import asyncio
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from math import isnan
from types import SimpleNamespace

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    NamedValue,
    StandardError,
    Subscription,
    SubscriptionFilter,
    TypedAttribute,
    UpdateHeader,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import (
    AreaError,
    AssetMode,
    FaultReaction,
    Notification,
    NotificationKind,
    ParameterValue,
    Severity,
    Stage,
    notification_of,
    utc_s_of,
)
from executive.commands import (
    FollowPath,
    MoveForward,
    Request,
    Resume,
    SetCameraRotateSpeed,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.obstacles.zones import ScannedObstacle
from executive.record import LedgerError, LedgerRetention
from executive.settings import TargetFrame
from executive.values.reasons import Figure, Reason
from executive.values.reports import Identity
from tests.mrs.aboard import Aboard, LinkedBench, event, number_of, raises

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
NAMES = list(UNITS)


def errors_of(aboard: Aboard, call: Callable[[MrsClient], Awaitable[object]]) -> MalError:
    async def session(client: MrsClient) -> MalError:
        with pytest.raises(MalError) as raised:
            await call(client)
        return raised.value

    return aboard.ground(session)


def forget_sensors(aboard: Aboard) -> None:
    def forget(bench: LinkedBench) -> None:
        status = bench.executive.status
        status.odometry = status.camera = status.battery = None

    aboard.do(forget)


def double(value: float) -> TypedAttribute:
    return TypedAttribute(AttributeType.DOUBLE, value)


async def test_reports_pose_and_speed(aboard: Aboard, client: MrsClient) -> None:
    await client.submit(client.command(MoveForward(5.0)))
    aboard.run(3.0)
    pose, speeds = await client.get_pose(), await client.get_speeds()
    assert pose.frame == "odom"
    assert pose.x == aboard.do(lambda bench: bench.rover.pose.x_m) > 0.5
    assert speeds.currentTravelSpeed > 0.5
    assert speeds.travelSpeed == 1.0


async def test_an_unknown_value_is_not_a_number(aboard: Aboard, client: MrsClient) -> None:
    forget_sensors(aboard)

    pose, state = await client.get_pose(), await client.get_camera_state()
    assert all(map(isnan, (pose.x, pose.y, pose.z, pose.heading, state.pan, state.tilt)))
    assert isnan((await client.get_speeds()).currentTravelSpeed)
    (voltage,) = await client.get_value("BATERY_VOLTAGE")
    assert voltage.value is None


async def test_reports_mode_and_activity(aboard: Aboard, client: MrsClient) -> None:
    idle = await client.get_status()
    assert (idle.mode, idle.activeCommandId, idle.queuedCommands) == (AssetMode.IDLE, None, 0)
    assert [value.name for value in idle.values] == NAMES
    for number in (1, 2, 3):
        await client.submit(client.command(MoveForward(5.0), command_id=number))
    aboard.run(1.0)
    busy = await client.get_status()
    assert (busy.mode, busy.activeCommandId, busy.queuedCommands) == (AssetMode.MOVING, 1, 2)
    await client.submit(client.command(Stop(), command_id=4))
    stopped = await client.get_status()
    assert (stopped.mode, stopped.queuedCommands) == (AssetMode.STOPPED, 0)


async def test_reports_its_faults_from_their_beginning_to_their_end(
    aboard: Aboard, client: MrsClient
) -> None:
    calm = await client.get_faults()
    assert (calm.why, calm.active) == ("standing: no motion goal", ())
    assert ("slip", "no second odometry") in [
        (each.quantity, each.cause) for each in calm.unmonitored
    ]
    await client.submit(client.command(MoveForward(50.0)))
    aboard.run(1.0)
    aboard.do(lambda bench: setattr(bench, "odometry", False))
    aboard.run(2.0)
    (stale,) = (await client.get_faults()).active
    assert (stale.name, stale.severity) == ("odometry_stale", Severity.ALARM)
    assert (stale.reaction, stale.onResume) == (FaultReaction.SAFE, True)
    assert stale.code == Reason.ODOMETRY_STALE.value
    past = await client.get_notifications()
    reported = next(each.report for each in past if each.report.reason is Reason.ODOMETRY_STALE)
    assert (reported.text, notification_of(reported).parameters) == (stale.text, stale.parameters)
    assert 0.0 <= reported.utc_s - utc_s_of(stale.began) < 1.0
    aboard.do(lambda bench: setattr(bench, "odometry", True))
    aboard.run(2.0)
    assert [each.name for each in (await client.get_faults()).active] == ["odometry_stale"]
    await client.run(client.command(Resume()))
    assert (await client.get_faults()).active == ()


async def test_reports_a_fault_that_ends_by_itself(aboard: Aboard, client: MrsClient) -> None:
    aboard.do(lambda bench: setattr(bench, "odometry", False))
    aboard.run(2.0)
    (silent,) = (await client.get_faults()).active
    assert (silent.name, silent.severity) == ("odometry_silent", Severity.WARNING)
    assert (silent.reaction, silent.onResume) == (FaultReaction.WARN, False)
    aboard.do(lambda bench: setattr(bench, "odometry", True))
    aboard.run(2.0)
    assert (await client.get_faults()).active == ()


async def test_gives_parameters_by_name_in_the_requested_order(client: MrsClient) -> None:
    found = await client.get_value("HEAD", "POS_X", "HEAD")
    assert [value.name for value in found] == ["HEAD", "POS_X", "HEAD"]
    assert [value.name for value in await client.get_value()] == NAMES


def test_a_parameter_of_no_name_is_not_found(aboard: Aboard) -> None:
    error = errors_of(aboard, lambda client: client.get_value("HEAD", "MASS"))
    assert (error.number, error.extra) == (5, TypedAttribute(AttributeType.STRING, "MASS"))


async def test_sends_telemetry_at_the_interval(aboard: Aboard, client: MrsClient) -> None:
    await client.run(client.command(SetStatusInterval(0.5)))
    aboard.run(1.0)
    values = await client.telemetry()
    aboard.run(1.0)
    seen = [await anext(values) for _ in range(2 * len(NAMES))]
    assert [value.name for value in seen] == NAMES * 2
    assert seen[len(NAMES)].utc_s - seen[0].utc_s == pytest.approx(0.5, abs=1e-6)


async def test_an_event_of_others_is_reported_with_the_name_of_its_sender(
    aboard: Aboard, client: MrsClient
) -> None:
    received = client.notifications()
    figure = NamedValue(name="dust", value=TypedAttribute(AttributeType.FLOAT, 0.5))
    await client.send_notification(event(sequence=99, parameters=(figure,)))
    found = (await anext(received)).report
    assert (found.kind, found.severity) == (NotificationKind.EVENT, Severity.ALARM)
    assert (found.text, found.sequence) == ("127.0.0.1: the lens is dusty", 1)
    assert found.figures == (Figure("dust", 0.5),)
    (last,) = await asyncio.to_thread(
        aboard.consume, lambda consumer: consumer.request("Notification", "getLastNotification")
    )
    assert last.parameters == (NamedValue(name="dust", value=double(0.5)),)
    assert int(found.utc_s) == 1_800_000_000


@pytest.mark.parametrize(
    "wrong",
    [
        event(text="x" * 5000),
        event(parameters=(NamedValue(name="d" * 300, value=double(1.0)),)),
        event(parameters=(NamedValue(name="d", value=double(1.0)),) * 33),
        event(kind=NotificationKind.COMMAND, stage=Stage.EXECUTED, commandId=1, source="MOE"),
        event(kind=NotificationKind.LINK),
        event(text=None),
        event(parameters=(NamedValue(name="dust"),)),
        event(parameters=(NamedValue(name="dust", value=double(float("nan"))),)),
        event(parameters=(NamedValue(name="d", value=TypedAttribute(AttributeType.STRING, "1")),)),
    ],
)
def test_no_other_client_reports_on_commands(aboard: Aboard, wrong: Notification) -> None:
    assert errors_of(aboard, lambda client: client.send_notification(wrong)).number == 1
    assert aboard.do(lambda bench: bench.received.reports) == []


async def test_returns_notifications_of_the_past(aboard: Aboard, client: MrsClient) -> None:
    for number in (11, 12):
        await client.submit(client.command(TakePicture(), command_id=number))
    aboard.run(2.0)
    everything = await client.get_notifications()
    assert [n.report.sequence for n in everything] == list(range(1, len(everything) + 1))
    assert await client.get_notifications(since=3) == everything[2:]
    assert await client.get_notifications(max_count=2) == everything[:2]
    of_one = await client.get_notifications(command_id=12)
    assert of_one == tuple(n for n in everything if number_of(n) == 12)
    assert of_one[-1].report.stage is Stage.EXECUTED
    assert await client.get_notifications(since=2**64 - 1) == ()
    assert await client.get_last_notification() == everything[-1]
    assert [n.cursor for n in everything] == [n.report.sequence for n in everything]


async def test_returns_the_arguments_of_commands(aboard: Aboard, client: MrsClient) -> None:
    path = FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.0, 0.5)), frame=TargetFrame.ODOM)
    requests: list[Request] = [path, MoveForward(500.0), TakePicture(format="PNG")]
    for number, request in enumerate(requests, 1):
        with suppress(MalError):
            await client.submit(client.command(request, source="TER", command_id=number))
    aboard.run(0.1)
    given = [await client.get_arguments(Identity("TER", number)) for number in (1, 2, 3)]
    waypoints = [{"x": 1.0, "y": 0.0}, {"x": 2.0, "y": 0.0, "heading": 0.5}]
    assert given == [
        {"waypoints": waypoints, "frame": "odom"},
        {"distance": 500.0},  # refused
        {"format": "PNG"},
    ]
    with raises(AreaError.NOT_FOUND.value):
        await client.get_arguments(Identity("TER", 4))


async def test_returns_the_obstacles_that_the_laser_detected(
    aboard: Aboard, client: MrsClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert await client.get_obstacles() == ()
    seen = SimpleNamespace(circles=(ScannedObstacle("seen", 1.0, 2.0, 0.2),))
    monkeypatch.setattr(aboard.do(lambda bench: bench.executive.status), "_local_map", seen)
    (found,) = await client.get_obstacles()
    assert (found.x, found.y, found.radius) == (1.0, 2.0, 0.2)


async def test_reports_its_properties(client: MrsClient) -> None:
    asset = await client.get_asset()
    assert (asset.asset, asset.domain) == ("jackal", ("meteron", "jackal"))
    assert asset.mode is AssetMode.IDLE
    assert asset.softwareVersion


async def test_the_directory_lists_what_works_and_nothing_else(
    aboard: Aboard, client: MrsClient
) -> None:
    services = await client.get_services()
    assert {service.name: service.operations for service in services} == {
        "ServiceLayer": (1, 2, 3, 4, 5),
        "Notification": (1, 2, 3, 5, 6),
        "Monitoring": (1, 2, 3, 4),
        "FileTransfer": (1, 2, 3),
        "FileManagement": (1, 2, 3, 4, 5),
        "Action": (1, 2),
        "Camera": (1, 2, 3, 4, 5),
        "MotionControl": tuple(range(1, 17)),
        "Plan": tuple(range(1, 18)),
        "Status": (1, 2, 3, 4, 5, 6),
        "MonitoringClient": (1, 2, 3),
        "NotificationClient": (1, 2),
        "Authority": (1, 2, 3, 4, 5),
    }
    notification = await client.get_service("Notification")
    assert notification in services
    assert notification.providerURI == aboard.uri
    assert notification.brokerURI == aboard.uri + "InternalBroker"
    assert notification.service.keyArea == 3001
    assert (await client.get_service("Camera")).brokerURI is None


def test_the_directory_knows_no_service_that_does_not_work(aboard: Aboard) -> None:
    error = errors_of(aboard, lambda client: client.get_service("Coffee"))
    assert (error.number, error.extra.value) == (5, "Coffee")


def test_a_question_that_fails_leaves_the_core_at_work(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise LedgerError("the disk is full")

    monkeypatch.setattr(aboard.do(lambda bench: bench.executive), "reports", fail)
    error = errors_of(aboard, lambda client: client.get_notifications())
    assert error.number == StandardError.INTERNAL.value
    assert "the disk is full" in caplog.text
    aboard.run(1.0)


async def test_sending_over_a_lost_link_is_a_connection_error(
    aboard: Aboard, client: MrsClient
) -> None:
    executive = aboard.do(lambda bench: bench.executive)
    executive.wake = lambda: threading.Thread(target=aboard.hang_up).start()
    with pytest.raises(ConnectionError, match="before the rover answered"):
        await client.send_notification(event())


SETTERS: dict[str, Callable[[float], Request]] = {
    "TRAVEL_SPEED": SetTravelSpeed,
    "ROTATE_SPEED": SetRotateSpeed,
    "CAM_ROTATE_SPEED": SetCameraRotateSpeed,
}


def is_one_of(name: str, *values: TypedAttribute) -> SubscriptionFilter:
    return SubscriptionFilter(name=name, values=values)


def names(*texts: str) -> tuple[TypedAttribute, ...]:
    return tuple(TypedAttribute(AttributeType.IDENTIFIER, text) for text in texts)


def test_every_parameter_is_defined_with_its_unit(aboard: Aboard) -> None:
    definitions = aboard.ground(lambda client: client.list_definition())
    assert {each.name: each.unit for each in definitions} == UNITS
    assert all(each.description and each.type is AttributeType.DOUBLE for each in definitions)


def test_writable_parameters_can_be_set_and_no_others(aboard: Aboard) -> None:
    definitions = aboard.ground(lambda client: client.list_definition())
    assert {each.name for each in definitions if each.writable} == SETTERS.keys()
    aboard.carry_out(*(setter(0.3) for setter in SETTERS.values()))

    async def session(client: MrsClient) -> None:
        for value in await client.get_value(*SETTERS):
            assert value.value == 0.3, value.name

    aboard.ground(session)


@pytest.mark.parametrize(
    ("filters", "received"),
    [
        ((is_one_of("parameter", *names("HEAD", "POS_X")),), ["POS_X", "HEAD"]),
        ((is_one_of("parameter", *names("*")), is_one_of("asset", *names("jackal"))), [*UNITS]),
        ((is_one_of("parameter", *names("HEAD")), is_one_of("asset", *names("scout"))), []),
        ((is_one_of("parameter", *names("MASS")),), []),
    ],
)
async def test_a_subscription_is_for_the_parameters_and_assets_it_names(
    aboard: Aboard, filters: tuple[SubscriptionFilter, ...], received: list[str], consumer: Consumer
) -> None:
    found: list[str] = []

    def receive(update: UpdateHeader, value: ParameterValue) -> None:
        assert update.source == "jackal"
        found.append(value.name)

    subscription = Subscription(subscriptionId="some", filters=filters)
    await consumer.subscribe("Monitoring", "monitorValue", subscription, receive)
    aboard.run(2.0)
    await consumer.request("ServiceLayer", "getAsset")
    assert found == received * 2
    await consumer.unsubscribe("Monitoring", "monitorValue", "some")
    aboard.run(2.0)
    await consumer.request("ServiceLayer", "getAsset")
    assert found == received * 2


async def test_on_change_a_client_receives_only_changed_values(
    aboard: Aboard, consumer: Consumer
) -> None:
    found: list[str] = []

    def receive(_: UpdateHeader, value: ParameterValue) -> None:
        found.append(value.name)

    aboard.do(lambda bench: bench.submit(SetStatusInterval(0.0), 1))
    aboard.run(0.5)
    everything = Subscription(subscriptionId="all")
    await consumer.subscribe("Monitoring", "monitorValue", everything, receive)
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
    ("filters", "received"),
    [
        ((is_one_of("commandId", TypedAttribute(AttributeType.LONG, 2)),), {(2, Stage.EXECUTED)}),
        (
            (is_one_of("stage", TypedAttribute(AttributeType.UOCTET, Stage.CANCELLED.value)),),
            {(1, Stage.CANCELLED)},
        ),
        ((is_one_of("severity", TypedAttribute(AttributeType.UOCTET, 2)),), {(1, Stage.CANCELLED)}),
        ((is_one_of("kind", TypedAttribute(AttributeType.UOCTET, 3)),), set()),
    ],
)
async def test_notifications_are_filtered_by_their_keys(
    aboard: Aboard,
    filters: tuple[SubscriptionFilter, ...],
    received: set[tuple[int | None, Stage]],
    consumer: Consumer,
) -> None:
    found: list[tuple[int | None, Stage | None]] = []

    def receive(_: UpdateHeader, notification: Notification) -> None:
        found.append((notification.commandId, notification.stage))

    subscription = Subscription(subscriptionId="some", filters=filters)
    await consumer.subscribe("Notification", "monitorNotification", subscription, receive)
    aboard.do(lambda bench: bench.submit(MoveForward(5.0), 1))
    aboard.run(1.0)
    aboard.do(lambda bench: bench.submit(Stop(), 2))
    aboard.run(1.0)
    await consumer.request("ServiceLayer", "getAsset")
    ends = {(number, stage) for number, stage in found if stage in _ENDS}
    assert ends == received
    everything = aboard.do(lambda bench: len(bench.received.reports))
    assert len(found) < everything


_ENDS = (Stage.EXECUTED, Stage.CANCELLED)


async def test_events_do_not_pile_up_behind_a_ledger_that_cannot_be_written(
    aboard: Aboard, client: MrsClient
) -> None:
    dust = event(text="dust")

    def write(possible: bool) -> None:
        def turn(bench: LinkedBench) -> None:
            bench.fill_disk(not possible)
            bench.run(0.1)

        aboard.do(turn)

    write(possible=False)
    await client.send_notification(dust)
    with pytest.raises(MalError, match="cannot be written"):
        await client.send_notification(dust)
    write(possible=True)
    await client.send_notification(dust)
    reported = aboard.do(lambda bench: [report.text for report in bench.received.reports])
    assert reported.count("127.0.0.1: dust") == 2


RETAINED, AT_ONCE = 20, 4


def forgetful(bench: LinkedBench) -> None:
    bench.executive.retention = LedgerRetention(bench.ledger, RETAINED, AT_ONCE)


async def test_the_past_begins_where_the_record_does_and_a_repeat_is_a_duplicate(
    aboard: Aboard, client: MrsClient
) -> None:
    aboard.do(forgetful)

    for number in range(1, 31):
        await client.submit(client.command(SetTravelSpeed(0.5), command_id=number))
        aboard.run(0.1)
    with raises(AreaError.DUPLICATE.value):
        await client.submit(client.command(SetTravelSpeed(0.5), command_id=1))
    assert await client.get_notifications(command_id=1) == ()
    past = await client.get_notifications(since=1)
    first, last = past[0].report.sequence, past[-1].report.sequence
    assert first > 1
    assert [reported.report.sequence for reported in past] == list(range(first, last + 1))
    assert RETAINED <= len(past) < RETAINED + AT_ONCE + 1
    assert past[-1].report.reason is Reason.DUPLICATE
    assert "its command is no longer stored" in past[-1].report.text
