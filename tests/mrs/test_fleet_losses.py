"""What is lost between rovers comes back, and no rover depends on another."""

import socket
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from adapters.mrs.spec.types import AssetMode, NotificationKind, Severity
from executive.commands.catalogue import MoveForward, SetTravelSpeed
from tests.mrs.aboard import Aboard
from tests.mrs.fleet import (
    LIMIT_S,
    Fleet,
    eventually,
    joined,
    modes,
    own,
    said,
    services,
    told,
    value,
)


def test_who_is_killed_is_offline_and_the_other_goes_on(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.25))
    eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
    eventually(lambda: told(jackal, "scout") == own(scout))
    scout.runs = False
    past = told(jackal, "scout")
    fleet.kill(scout)
    eventually(lambda: modes(jackal) == {"jackal": AssetMode.IDLE, "scout": AssetMode.OFFLINE})
    assert value(jackal, "scout", "TRAVEL_SPEED") == 0.25
    assert told(jackal, "scout") == past
    assert jackal.carry_out(MoveForward(0.5))[0].executed


def test_a_rover_does_not_miss_a_service_layer_that_is_dead(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    eventually(lambda: joined(scout))
    eventually(lambda: "jackal" in modes(scout))
    fleet.kill(jackal)
    eventually(lambda: said(scout, "is away"))
    lost = own(scout)[-1]
    assert (lost.kind, lost.severity) == (NotificationKind.LINK, Severity.WARNING)
    eventually(lambda: modes(scout) == {"jackal": AssetMode.OFFLINE, "scout": AssetMode.IDLE})
    assert scout.carry_out(MoveForward(0.5))[0].executed
    assert value(scout, "jackal", "TRAVEL_SPEED") == 1.0


def test_a_rover_starts_without_its_service_layer_and_finds_it_later(
    fleet: Fleet, tmp_path: Path
) -> None:
    gone = fleet.launch("jackal")
    fleet.kill(gone)
    scout = fleet.launch("scout")
    fleet.close(scout)
    scout = Aboard(tmp_path / "scout", asset="scout", service_layer=gone.uri)
    try:
        eventually(lambda: said(scout, "is away"))
        assert scout.carry_out(MoveForward(0.5))[0].executed
        jackal = fleet.launch("jackal", port=gone.port)
        eventually(lambda: joined(scout))
        eventually(lambda: told(jackal, "scout") == own(scout))
    finally:
        scout.close()


def test_nothing_is_missed_while_the_service_layer_is_away(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout, mule = fleet.launch("scout", above=jackal), fleet.launch("mule", above=jackal)
    for one, other in ((scout, mule), (mule, scout)):
        one.carry_out(SetTravelSpeed(0.5))
        eventually(lambda one=one, other=other: told(other, one.asset)[-1:] == own(one)[-1:])  # type: ignore[misc]
    jackal.hang_up()
    for rover in (jackal, scout, mule):
        rover.do(lambda bench: bench.submit(MoveForward(0.5), 77))
        rover.run(5.0)
    jackal.listen()
    for one in (jackal, scout, mule):
        for other in (jackal, scout, mule):
            eventually(lambda one=one, other=other: told(one, other.asset)[-1:] == own(other)[-1:])  # type: ignore[misc]
            numbers = [each.sequence for each in told(one, other.asset)]
            assert numbers == list(range(numbers[0], numbers[-1] + 1)), (one.asset, other.asset)
    assert any(each.commandId == 77 for each in told(mule, "scout"))


def test_a_service_layer_without_memory_is_told_again(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.5))
    eventually(lambda: told(jackal, "scout") == own(scout))
    fleet.kill(jackal)
    again = fleet.launch("jackal", port=jackal.port)
    eventually(lambda: told(again, "scout") == own(scout) and len(own(scout)) > 5)
    eventually(lambda: value(again, "scout", "TRAVEL_SPEED") == 0.5)


def test_a_rover_that_restarts_goes_on_where_it_was_heard_last(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.do(lambda bench: bench.submit(MoveForward(5.0), 1))
    scout.run(1.0)
    eventually(lambda: told(jackal, "scout") == own(scout))
    fleet.kill(scout)
    scout = fleet.launch("scout", above=jackal)
    eventually(lambda: told(jackal, "scout") == own(scout))
    assert [each.commandId for each in own(scout)].count(1) == 4
    eventually(lambda: modes(jackal)["scout"] is AssetMode.IDLE)


def test_a_rover_with_another_ledger_begins_anew(fleet: Fleet, tmp_path: Path) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.5), MoveForward(0.5))
    eventually(lambda: told(jackal, "scout") == own(scout))
    fleet.kill(scout)
    for left in (tmp_path / "scout").glob("ledger*"):
        left.unlink()
    scout = fleet.launch("scout", above=jackal)
    scout.carry_out(SetTravelSpeed(0.75))
    eventually(lambda: told(jackal, "scout")[-1:] == own(scout)[-1:])
    assert len(told(jackal, "scout")) <= len(own(scout))


def test_who_ends_in_order_says_its_last_word_and_deregisters(fleet: Fleet) -> None:
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)
    scout.do(lambda bench: bench.submit(MoveForward(5.0), 1))
    scout.run(1.0)
    eventually(lambda: told(jackal, "scout") == own(scout))
    fleet.close(scout)
    assert "scout.ServiceLayer" not in services(jackal)
    assert told(jackal, "scout")[-1].commandId == 1
    assert "shut down" in (told(jackal, "scout")[-1].text or "")
    eventually(lambda: modes(jackal)["scout"] is AssetMode.OFFLINE)


@pytest.mark.parametrize("answer", [b"", b"\x00" * 200, b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_a_service_layer_that_is_none_hinders_nobody(tmp_path: Path, answer: bytes) -> None:
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
                eventually(lambda: said(rover, "is away"))
        finally:
            rover.close()
            listening.shutdown(socket.SHUT_RDWR)
            for connection in calls:
                connection.close()
