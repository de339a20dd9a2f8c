"""Rovers that hear one another: one broker, real sockets between them, and losses."""

import socket
import threading
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    Encoding,
    MalError,
    Subscription,
    SubscriptionFilter,
    TypedAttribute,
    UpdateHeader,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AssetMode, Notification, NotificationKind, ParameterValue, Severity
from adapters.mrs.transport import TransportSettings
from executive.commands import MoveForward, SetTravelSpeed, Stop
from tests.mrs.aboard import Aboard, number_of
from tests.mrs.fleet import (
    LIMIT_S,
    Fleet,
    eventually,
    joined,
    modes,
    own,
    reported,
    services,
    value,
    was_reported,
)
from tests.support.certificates import certified, make_ends
from tests.support.ports import free_port

IDLE = {AssetMode.IDLE}


def number(error: pytest.ExceptionInfo[MalError]) -> int:
    return error.value.number


def test_a_rover_alone_knows_itself(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    assert modes(jackal) == {"jackal": AssetMode.IDLE}
    assert value(jackal, "jackal", "TRAVEL_SPEED") == 1.0
    jackal.carry_out(SetTravelSpeed(0.5))
    assert reported(jackal, "jackal") == own(jackal) != ()


def test_each_reads_the_other(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    jackal.carry_out(SetTravelSpeed(0.5))
    scout.carry_out(SetTravelSpeed(0.25))
    eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
    eventually(lambda: value(scout, "jackal", "TRAVEL_SPEED") == 0.5)
    eventually(lambda: reported(jackal, "scout") == own(scout))
    eventually(lambda: reported(scout, "jackal") == own(jackal))
    eventually(lambda: set(modes(jackal).values()) == set(modes(scout).values()) == IDLE)
    assert modes(jackal).keys() == modes(scout).keys() == {"jackal", "scout"}


@pytest.mark.parametrize("encoding", [Encoding.VARIABLE, Encoding.SPLIT])
def test_the_terms_of_the_link_hold_between_rovers_too(tmp_path: Path, encoding: Encoding) -> None:
    certificates = certified(tmp_path, "jackal", "scout")
    fleet = Fleet(tmp_path, TransportSettings(encoding), certificates)
    try:
        jackal = fleet.launch("jackal")
        scout = fleet.launch("scout", above=jackal)
        scout.carry_out(SetTravelSpeed(0.25))
        eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
        eventually(lambda: reported(jackal, "scout") == own(scout))
        eventually(lambda: set(modes(jackal).values()) == set(modes(scout).values()) == IDLE)
    finally:
        fleet.close_all()


def test_a_clear_text_asset_is_not_registered_if_certificates_are_required(
    tmp_path: Path,
) -> None:
    ends = make_ends(tmp_path)
    jackal = Aboard(tmp_path / "jackal", terms=TransportSettings(certificates=ends.rover))
    stranger = Aboard(tmp_path / "scout", asset="scout", service_layer=jackal.uri)
    try:
        eventually(lambda: was_reported(stranger, "is not reachable"))
        assert modes(jackal) == {"jackal": AssetMode.IDLE}
    finally:
        stranger.close()
        jackal.close()


def test_the_mode_of_another_is_its_present_one(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.do(lambda bench: bench.submit(Stop(), 1))
    eventually(lambda: modes(jackal)["scout"] is AssetMode.STOPPED)


def test_three_receive_one_another_through_one(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout, mule = fleet.launch("scout", above=jackal), fleet.launch("mule", above=jackal)
    mule.carry_out(SetTravelSpeed(0.75))
    for other in (jackal, scout):
        eventually(lambda other=other: value(other, "mule", "TRAVEL_SPEED") == 0.75)  # type: ignore[misc]
        eventually(lambda other=other: reported(other, "mule") == own(mule))  # type: ignore[misc]
    eventually(lambda: set(modes(scout).values()) == {AssetMode.IDLE})
    assert modes(scout).keys() == {"jackal", "scout", "mule"}


def test_received_reports_are_broadcast_to_listeners_at_either(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    wanted = SubscriptionFilter(
        name="parameter", values=(TypedAttribute(AttributeType.IDENTIFIER, "TRAVEL_SPEED"),)
    )
    subscription = Subscription(subscriptionId="speeds", filters=(wanted,))
    for listener, speaker in ((jackal, scout), (scout, jackal)):
        received: list[tuple[str, str | None, tuple[str, ...] | None, float]] = []

        def receive(update: UpdateHeader, value: ParameterValue) -> None:
            assert update.keyValues is not None
            asset = update.keyValues[0].value
            assert asset is not None
            assert value.value is not None
            received.append((asset.value, update.source, update.domain, value.value.value))  # noqa: B023

        async def session(consumer: Consumer) -> None:
            await consumer.subscribe("MonitoringClient", "monitorAssetValue", subscription, receive)
            speaker.do(lambda bench: bench.submit(SetTravelSpeed(0.4), 1))  # noqa: B023
            speaker.run(1.0)  # noqa: B023
            while 0.4 not in {speed for asset, _, _, speed in received if asset == speaker.asset}:  # noqa: B023
                await consumer.request("ServiceLayer", "getAsset")

        listener.consume(session)
        sources = {
            (source, domain) for asset, source, domain, _ in received if asset == speaker.asset
        }
        passes_on = speaker.asset if listener is jackal else listener.asset
        assert (passes_on, ("meteron", speaker.asset)) in sources


def test_the_rest_is_found_from_one_uri(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout, mule = fleet.launch("scout", above=jackal), fleet.launch("mule", above=jackal)
    eventually(lambda: "ServiceLayer.above" in services(scout))
    from_scout = services(scout)
    assert from_scout["ServiceLayer"] == scout.uri
    assert from_scout["ServiceLayer.above"] == jackal.uri
    from_jackal = services(jackal)
    assert from_jackal["scout.ServiceLayer"] == scout.uri
    assert from_jackal["mule.ServiceLayer"] == mule.uri

    async def session(client: MrsClient) -> None:
        found = await client.get_service("mule.ServiceLayer")
        assert found.service.keyService == 1
        assert 3 in found.operations
        # what is registered here does not take the place of what is served here
        assert (await client.get_asset()).asset == "jackal"

    jackal.ground(session)


def test_of_two_with_one_name_the_second_is_ignored(fleet: Fleet, tmp_path: Path) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    double = Aboard(tmp_path / "double", asset="scout", service_layer=jackal.uri)
    try:
        eventually(lambda: was_reported(double, "refuses this asset: Duplicate: scout"))
        scout.carry_out(SetTravelSpeed(0.25))
        double.carry_out(SetTravelSpeed(0.75))
        eventually(lambda: reported(jackal, "scout") == own(scout))
        eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
    finally:
        double.close()
    assert services(jackal)["scout.ServiceLayer"] == scout.uri


def test_an_asset_with_the_name_of_its_service_layer_continues_alone(
    tmp_path: Path, fleet: Fleet
) -> None:
    port = fleet.launch("other").port
    fleet.close_all()
    uri = f"maltcp://127.0.0.1:{port}/MRS"
    rover = Aboard(tmp_path / "loop", port, asset="jackal", service_layer=uri)
    try:
        eventually(lambda: was_reported(rover, "Duplicate"))
        assert modes(rover) == {"jackal": AssetMode.IDLE}
    finally:
        rover.close()


def test_two_may_be_each_others_service_layer(fleet: Fleet, tmp_path: Path) -> None:
    scout = fleet.launch("scout")
    uri, port = scout.uri, scout.port
    fleet.close(scout)
    jackal = Aboard(tmp_path / "jackal", asset="jackal", service_layer=uri)
    scout = Aboard(tmp_path / "scout", port, asset="scout", service_layer=jackal.uri)
    try:
        eventually(lambda: joined(scout) and joined(jackal))
        scout.carry_out(SetTravelSpeed(0.25))
        jackal.carry_out(SetTravelSpeed(0.75))
        eventually(lambda: reported(jackal, "scout") == own(scout))
        eventually(lambda: reported(scout, "jackal") == own(jackal))
        eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
    finally:
        scout.close()
        jackal.close()


def test_in_a_ring_of_three_each_receives_everything_once(tmp_path: Path) -> None:
    ports = [free_port() for _ in range(3)]
    uris = [f"maltcp://127.0.0.1:{port}/MRS" for port in ports]
    names = ("jackal", "scout", "mule")
    ring = [
        Aboard(tmp_path / name, ports[number], asset=name, service_layer=uris[number - 1])
        for number, name in enumerate(names)
    ]
    received: Counter[tuple[str, int]] = Counter()

    def receive(update: UpdateHeader, notification: Notification) -> None:
        assert update.keyValues is not None
        asset = update.keyValues[0].value
        assert asset is not None
        received[asset.value, notification.sequence] += 1

    async def session(consumer: Consumer) -> None:
        everything = Subscription(subscriptionId="all")
        await consumer.subscribe(
            "NotificationClient", "monitorAssetNotification", everything, receive
        )
        for rover in ring:
            rover.do(lambda bench: bench.submit(SetTravelSpeed(0.25), 1))
        last = {
            (rover.asset, rover.do(lambda bench: bench.executive.last_sequence)) for rover in ring
        }
        while not last <= received.keys():
            await consumer.request("ServiceLayer", "getAsset")

    try:
        for rover in ring:
            eventually(lambda rover=rover: modes(rover).keys() == set(names))  # type: ignore[misc]
        ring[0].consume(session)
        for rover in ring * 3:  # time for what would go round
            assert modes(rover).keys() == set(names)
        assert set(received.values()) == {1}
    finally:
        for rover in ring:
            rover.close()


def test_an_unknown_asset_is_not_found(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") is not None)

    async def session(client: MrsClient) -> None:
        for asset, names in (("mule", ()), ("scout", ("MASS",)), ("jackal", ("MASS",))):
            with pytest.raises(MalError) as raised:
                await client.get_asset_value(asset, *names)
            assert number(raised) == 5
        with pytest.raises(MalError) as raised:
            await client.get_asset_notifications("mule")
        assert number(raised) == 5
        both = await client.get_asset_value("scout", "HEAD", "POS_X")
        assert [value.name for value in both] == ["HEAD", "POS_X"]

    jackal.ground(session)
    assert scout.asset == "scout"


def test_a_killed_asset_is_offline_and_the_other_continues(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.25))
    eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
    eventually(lambda: reported(jackal, "scout") == own(scout))
    scout.runs = False
    past = reported(jackal, "scout")
    fleet.kill(scout)
    eventually(lambda: modes(jackal) == {"jackal": AssetMode.IDLE, "scout": AssetMode.OFFLINE})
    assert value(jackal, "scout", "TRAVEL_SPEED") == 0.25
    assert reported(jackal, "scout") == past
    assert jackal.carry_out(MoveForward(0.5))[0].executed


def test_a_rover_does_not_miss_a_service_layer_that_is_dead(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    eventually(lambda: joined(scout))
    eventually(lambda: "jackal" in modes(scout))
    fleet.kill(jackal)
    eventually(lambda: was_reported(scout, "is not reachable"))
    lost = own(scout)[-1].report
    assert (lost.kind, lost.severity) == (NotificationKind.LINK, Severity.WARNING)
    eventually(lambda: modes(scout) == {"jackal": AssetMode.OFFLINE, "scout": AssetMode.IDLE})
    assert scout.carry_out(MoveForward(0.5))[0].executed
    assert value(scout, "jackal", "TRAVEL_SPEED") == 1.0


def test_a_rover_starts_without_its_service_layer_and_finds_it_later(
    fleet: Fleet, tmp_path: Path
) -> None:
    closed = fleet.launch("jackal")
    fleet.kill(closed)
    scout = fleet.launch("scout")
    fleet.close(scout)
    scout = Aboard(tmp_path / "scout", asset="scout", service_layer=closed.uri)
    try:
        eventually(lambda: was_reported(scout, "is not reachable"))
        assert scout.carry_out(MoveForward(0.5))[0].executed
        jackal = fleet.launch("jackal", port=closed.port)
        eventually(lambda: joined(scout))
        eventually(lambda: reported(jackal, "scout") == own(scout))
    finally:
        scout.close()


def test_nothing_is_missed_while_the_service_layer_is_away(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout, mule = fleet.launch("scout", above=jackal), fleet.launch("mule", above=jackal)
    for one, other in ((scout, mule), (mule, scout)):
        one.carry_out(SetTravelSpeed(0.5))
        eventually(lambda one=one, other=other: reported(other, one.asset)[-1:] == own(one)[-1:])  # type: ignore[misc]
    jackal.hang_up()
    for rover in (jackal, scout, mule):
        rover.do(lambda bench: bench.submit(MoveForward(0.5), 77))
        rover.run(5.0)
    jackal.listen()
    for one in (jackal, scout, mule):
        for other in (jackal, scout, mule):
            eventually(
                lambda one=one, other=other: reported(one, other.asset)[-1:] == own(other)[-1:]  # type: ignore[misc]
            )
            numbers = [each.report.sequence for each in reported(one, other.asset)]
            assert numbers == list(range(numbers[0], numbers[-1] + 1)), (one.asset, other.asset)
    assert any(number_of(each) == 77 for each in reported(mule, "scout"))


def test_a_service_layer_without_memory_is_notified_again(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.5))
    eventually(lambda: reported(jackal, "scout") == own(scout))
    fleet.kill(jackal)
    again = fleet.launch("jackal", port=jackal.port)
    eventually(lambda: reported(again, "scout") == own(scout) and len(own(scout)) > 5)
    eventually(lambda: value(again, "scout", "TRAVEL_SPEED") == 0.5)


def test_a_restarted_rover_continues_at_its_last_contact(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.do(lambda bench: bench.submit(MoveForward(5.0), 1))
    scout.run(1.0)
    eventually(lambda: reported(jackal, "scout") == own(scout))
    fleet.kill(scout)
    scout = fleet.launch("scout", above=jackal)
    eventually(lambda: reported(jackal, "scout") == own(scout))
    assert [number_of(each) for each in own(scout) if each.report.stage is not None].count(1) == 4
    eventually(lambda: modes(jackal)["scout"] is AssetMode.IDLE)


def test_a_rover_with_another_ledger_starts_again(fleet: Fleet, tmp_path: Path) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.5), MoveForward(0.5))
    eventually(lambda: reported(jackal, "scout") == own(scout))
    fleet.kill(scout)
    for left in (tmp_path / "scout").glob("ledger*"):
        left.unlink()
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.75))
    eventually(lambda: reported(jackal, "scout")[-1:] == own(scout)[-1:])
    assert len(reported(jackal, "scout")) <= len(own(scout))


def test_an_orderly_end_sends_the_last_report_and_deregisters(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.do(lambda bench: bench.submit(MoveForward(5.0), 1))
    scout.run(1.0)
    eventually(lambda: reported(jackal, "scout") == own(scout))
    fleet.close(scout)
    assert "scout.ServiceLayer" not in services(jackal)
    assert number_of(reported(jackal, "scout")[-1]) == 1
    assert "shut down" in reported(jackal, "scout")[-1].report.text
    eventually(lambda: modes(jackal)["scout"] is AssetMode.OFFLINE)


@pytest.mark.parametrize("answer", [b"", b"\x00" * 200, b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_an_invalid_service_layer_hinders_no_asset(tmp_path: Path, answer: bytes) -> None:
    called = threading.Event()
    calls: list[socket.socket] = []

    def serve() -> None:
        with suppress(OSError):
            while True:
                connection, _ = listening.accept()
                calls.append(connection)
                called.set()
                connection.sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as listening:
        threading.Thread(target=serve, daemon=True).start()
        uri = f"maltcp://127.0.0.1:{listening.getsockname()[1]}/MRS"
        rover = Aboard(tmp_path, service_layer=uri)
        try:
            assert called.wait(LIMIT_S)
            assert rover.carry_out(MoveForward(0.5))[0].executed
            assert modes(rover) == {"jackal": AssetMode.IDLE}
            if answer:
                eventually(lambda: was_reported(rover, "is not reachable"))
        finally:
            rover.close()
            listening.shutdown(socket.SHUT_RDWR)
            for connection in calls:
                connection.close()
