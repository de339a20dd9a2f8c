"""A subscriber that does not read slows nobody, costs little, and misses no report in the end."""

import asyncio
import socket
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any, Self

import pytest

from adapters.mal import Codec, Header, MalUri, Subscription, connection, encode_message
from adapters.mal import InteractionStage as SduStage
from adapters.mal.codec import decode_message
from adapters.mrs.aboard import query_services
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import (
    Notification,
    ParameterValue,
    ReceivedReport,
    ReceivedValue,
    Stage,
    TreeUpdate,
    mrs_specification,
    received_value,
)
from adapters.mrs.spec.tree_updates import snapshot_of_update
from executive.commands import MoveForward, SetCameraAngles, SetStatusInterval
from executive.core.runner import Executive
from executive.values.parameters import Parameter
from tests.mrs.aboard import Aboard
from tests.support.kinematic import STEP_S
from trees import TreeSnapshot, snapshot_of

CAPACITY_OCTETS = 4096
ANSWER_S = 60.0
OWN_URI = "maltcp://127.0.0.1:1/slow"


VALUES = ("Monitoring", "monitorValue")
REPORTS = ("Notification", "monitorNotification")
TREE = ("Status", "monitorTree")


class SlowSubscriber:
    """A plain socket with little room, subscribed to some of what a rover tells."""

    def __init__(self, rover: str, *operations: tuple[str, str]) -> None:
        uri = MalUri.parse(rover)
        self._broker = str(uri.broker)
        self._codec = Codec(mrs_specification())
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, CAPACITY_OCTETS)
        self._socket.settimeout(ANSWER_S)
        self._socket.connect((uri.host, uri.port))
        self._octets = bytearray()
        for number, (service, operation) in enumerate(operations, 1):
            self._subscribe(number, service, operation)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def read(self) -> Iterator[Notification | ParameterValue | TreeUpdate]:
        """What comes, until the rover hangs up or has nothing more to say for long."""
        while message := self._message():
            header, body = decode_message(message)
            operation = mrs_specification().resolve(
                header.area, header.area_version, header.service, header.operation
            )
            _, _, value = self._codec.decode(operation.parts[header.stage], body)
            yield value

    def _subscribe(self, number: int, service: str, operation: str) -> None:
        found = mrs_specification().operation(service, operation)
        header = Header.of(found, SduStage.REGISTER, number, OWN_URI, self._broker)
        wanted: tuple[Any, ...] = (Subscription(subscriptionId="slow"),)
        body = self._codec.encode(found.parts[SduStage.REGISTER], wanted)
        self._socket.sendall(encode_message(header, body))
        acknowledgement, _ = decode_message(self._message())
        assert acknowledgement.stage is SduStage.REGISTER_ACK
        assert not acknowledgement.is_error

    def _message(self) -> bytes:
        """The next message, or nothing if the rover hung up."""
        while len(self._octets) < 4 or len(self._octets) < int.from_bytes(self._octets[:4], "big"):
            try:
                more = self._socket.recv(1 << 16)
            except ConnectionResetError:
                more = b""
            if not more:
                return b""
            self._octets += more
        length = int.from_bytes(self._octets[:4], "big")
        message = bytes(self._octets[:length])
        del self._octets[:length]
        return message


STAGES = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]
ROUNDS = 48
TICKS = 10
"""In a round; a client that reads is up to date after each."""
COMMAND_EVERY = 4


class Watched:
    """What a client that reads heard while another did not."""

    def __init__(self) -> None:
        self.lifecycles: list[list[Stage | None]] = []
        self.values: list[ReceivedValue] = []
        self.sequences: list[int] = []


async def work(client: MrsClient, aboard: Aboard, rounds: int) -> Watched:
    """Let telemetry flow at every tick, command now and then, and listen to all of it."""
    received = Watched()
    await client.submit(client.command(SetStatusInterval(STEP_S)))
    reports, values = client.notifications(), await client.telemetry()
    for number in range(rounds):
        running = None
        if number % COMMAND_EVERY == 0:
            angles = SetCameraAngles(pan_rad=0.001 * number)
            running = asyncio.create_task(client.run(client.command(angles)))
            await anext(reports)
        await asyncio.to_thread(aboard.run, TICKS * STEP_S)
        if running is not None:
            received.lifecycles.append([report.stage for report in (await running).reports])
        for _ in range(TICKS * len(Parameter)):
            received.values.append(await anext(values))
    received.sequences = [each.report.sequence for each in await client.get_notifications()]
    return received


def times(values: list[ReceivedValue]) -> list[int]:
    """When the position was taken, in ms of the rover's time."""
    return [round(value.utc_s * 1000.0) for value in values if value.name == "POS_X"]


def gaps(times_ms: list[int]) -> list[int]:
    """Where more than a tick lies between two values."""
    return [
        index
        for index, (one, other) in enumerate(pairwise(times_ms), 1)
        if other - one > 1500 * STEP_S
    ]


def test_one_that_reads_late_lacks_only_old_telemetry(aboard: Aboard) -> None:
    with SlowSubscriber(aboard.uri, REPORTS, VALUES) as slow:
        received = aboard.ground(lambda client: work(client, aboard, ROUNDS))
        assert received.lifecycles == [STAGES] * (ROUNDS // COMMAND_EVERY)
        assert gaps(times(received.values)) == []

        newest = received.values[-1]
        values: list[ReceivedValue] = []
        sequences: list[int] = []
        for reported in slow.read():
            if isinstance(reported, Notification):
                sequences.append(reported.sequence)
                continue
            assert isinstance(reported, ParameterValue)
            values.append(received_value(reported))
            if values[-1] == newest:
                break
    assert sequences == received.sequences
    (gap,) = gaps(times(values))
    assert len(values) < len(received.values)
    waited = connection.DROPPABLE_CAP // len(Parameter)
    assert waited <= len(times(values)[gap:]) <= waited + 1


def test_one_that_never_reads_is_hung_up_on_and_can_catch_up(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "BACKLOG_CAP", 20)
    with SlowSubscriber(aboard.uri, REPORTS, VALUES) as dead:
        received = aboard.ground(lambda client: work(client, aboard, ROUNDS))
        assert received.lifecycles == [STAGES] * (ROUNDS // COMMAND_EVERY)
        assert gaps(times(received.values)) == []
        got = [reported.sequence for reported in dead.read() if isinstance(reported, Notification)]
    assert got == list(range(1, len(got) + 1))
    assert len(got) < len(received.sequences)

    async def catch_up(client: MrsClient) -> tuple[ReceivedReport, ...]:
        return await client.get_notifications(since=got[-1] + 1)

    missed = aboard.ground(catch_up)
    assert got + [each.report.sequence for each in missed] == received.sequences


def much(executive: Executive, utc_s: float) -> TreeSnapshot:
    """Return a snapshot that fills what a socket takes before anybody reads."""
    return replace(snapshot_of(executive, utc_s), unmonitored="x" * 20_000)


def test_one_that_reads_late_has_the_tree_as_it_is_all_the_same(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "DROPPABLE_CAP", 8)
    monkeypatch.setattr(query_services, "snapshot_of", much)
    for name in ("POLL_S", "FIGURES_ONLY_S", "FULL_UPDATE_S"):
        monkeypatch.setattr(query_services, name, 0.0)

    async def watch(client: MrsClient) -> TreeSnapshot:
        trees = await client.tree_snapshots()
        await client.submit(client.command(MoveForward(50.0)))
        for _ in range(2 * ROUNDS):
            await asyncio.to_thread(aboard.run, STEP_S)
            now = aboard.do(lambda bench: much(bench.executive, bench.clock.utc_s()))
            while await anext(trees) != now:
                pass
        return now

    with SlowSubscriber(aboard.uri, TREE) as slow:
        newest = aboard.ground(watch)
        numbers: list[int] = []
        for update in slow.read():
            assert isinstance(update, TreeUpdate)
            numbers.append(update.whole)
            snapshot = snapshot_of_update(update, None)
            if snapshot == newest:
                break
        assert snapshot == newest
        assert numbers != list(range(numbers[0], numbers[-1] + 1)), "none was dropped"
