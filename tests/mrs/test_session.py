"""Sessions from the ground: several at once, and over losses of the link."""

import asyncio
import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from adapters.mal import MalError, OnUpdate, StandardError, Subscription, UpdateHeader
from adapters.mrs.aboard.served_operations import MESSAGE_CAP
from adapters.mrs.ground import MrsClient, Stream, parse_address
from adapters.mrs.ground.streams import NotificationStream
from adapters.mrs.link import MrsLink
from adapters.mrs.spec import Notification, ReceivedReport
from executive.commands import (
    Command,
    MoveForward,
    PlanDefinition,
    SetStatusInterval,
    Stop,
    SubmitPlan,
)
from executive.plans.plan_xml import MAX_PLAN_OCTETS
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, Stage
from tests.mrs.aboard import Aboard, LinkedBench, event

STAGES = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


async def arrived(stream: Stream[ReceivedReport], stage: Stage) -> Report:
    """Wait for a stage."""
    async for received in stream:
        if received.report.stage is stage:
            return received.report
    raise AssertionError(f"the stream ended before {stage}")


async def active(
    client: MrsClient, command: Command, aboard: Aboard
) -> "asyncio.Task[list[Stage | None]]":
    """Run a command until it has started, and return what waits for its life."""
    stream = client.notifications()

    async def lifecycle() -> list[Stage | None]:
        return [report.stage for report in (await client.run(command)).reports]

    task = asyncio.create_task(lifecycle())
    await arrived(stream, Stage.ACCEPTED)
    aboard.run(1.0)
    await arrived(stream, Stage.STARTED)
    return task


def plan(octets: int) -> SubmitPlan:
    return SubmitPlan(PlanDefinition("long", "long", "BTCPP4", b" " * octets))


@contextmanager
def restart(folder: Path, port: int) -> Iterator[Aboard]:
    """Give a rover at the address of one that is gone."""
    rover = Aboard(folder, port)
    yield rover
    rover.close()


def test_every_client_receives_reports_of_every_command(aboard: Aboard) -> None:
    async def session(one: MrsClient) -> None:
        async with await MrsClient.connect(aboard.uri, source="MOE-2") as two:
            streams = [one.notifications(), two.notifications()]
            await one.submit(one.command(MoveForward(5.0), command_id=1))
            aboard.run(1.0)
            await two.submit(two.command(Stop(), command_id=1))
            aboard.run(1.0)
            for stream in streams:
                stopped = await arrived(stream, Stage.CANCELLED)
                assert stopped.identity == Identity("MOE", 1)
                stop = await arrived(stream, Stage.EXECUTED)
                assert stop.identity == Identity("MOE-2", 1)

    aboard.ground(session)


def test_an_exception_of_a_listener_ends_the_waiting(aboard: Aboard) -> None:
    def full(_: ReceivedReport) -> None:
        raise OSError("no space left")

    async def session() -> None:
        async with await MrsClient.connect(aboard.uri) as client:
            await asyncio.wait_for(client.run(client.command(MoveForward(1.0)), full), 60.0)

    with pytest.raises(OSError, match="no space left"):
        asyncio.run(session())


async def test_the_life_cycle_of_a_command_outlives_the_link(
    aboard: Aboard, client: MrsClient
) -> None:
    task = await active(client, client.command(MoveForward(2.0)), aboard)
    aboard.hang_up()
    aboard.run(10.0)
    aboard.listen()
    assert await task == STAGES


async def test_a_command_is_sent_again_when_its_answer_was_lost_and_done_once(
    aboard: Aboard, client: MrsClient
) -> None:
    arrived = threading.Event()

    wake = aboard.do(lambda bench: bench.executive.wake)
    aboard.do(lambda bench: setattr(bench.executive, "wake", arrived.set))
    task = asyncio.create_task(client.run(client.command(MoveForward(1.0))))
    await asyncio.to_thread(arrived.wait)
    aboard.hang_up()
    aboard.do(lambda bench: setattr(bench.executive, "wake", wake))
    aboard.do(lambda bench: bench.executive.serve_inbox())
    aboard.listen()
    aboard.runs = True
    outcome = await task
    assert outcome.executed
    assert aboard.do(lambda bench: bench.rover.pose.x_m) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("octets", "reason"),
    [(MAX_PLAN_OCTETS, Reason.PLAN_NOT_XML), (MAX_PLAN_OCTETS + 1, Reason.PLAN_TOO_LARGE)],
)
def test_the_maximum_plan_reaches_the_rover(aboard: Aboard, octets: int, reason: Reason) -> None:
    (outcome,) = aboard.carry_out(plan(octets))
    assert outcome.reports[-1].reason is reason


async def test_a_message_that_is_too_long_is_answered_and_the_link_stays(client: MrsClient) -> None:
    reported = client.notifications()
    with pytest.raises(MalError, match=f"TOO_MANY.*at most {MESSAGE_CAP} are accepted"):
        await client.submit(client.command(plan(MESSAGE_CAP)))
    await client.submit(client.command(MoveForward(1.0)))
    await arrived(reported, Stage.ACCEPTED)


def test_a_crashed_rover_reports_it_after_its_restart(tmp_path: Path) -> None:
    async def session(client: MrsClient) -> None:
        task = asyncio.create_task(client.run(client.command(MoveForward(9.0))))
        await arrived(client.notifications(), Stage.ACCEPTED)
        first.run(1.0)
        first.die()
        with restart(tmp_path, first.port) as second:
            outcome = await task
            assert outcome.reports[-1].stage is Stage.FAILED
            assert outcome.reports[-1].reason is Reason.INTERRUPTED
            second.run(1.0)
            assert second.do(lambda bench: bench.rover.pose.x_m) == 0.0

    first = Aboard(tmp_path)
    first.ground(session)


def test_a_rover_without_its_ledger_is_a_stranger(tmp_path: Path) -> None:
    async def session(client: MrsClient) -> None:
        task = asyncio.create_task(client.run(client.command(MoveForward(9.0))))
        await arrived(client.notifications(), Stage.ACCEPTED)
        first.die()
        with restart(tmp_path / "other", first.port):
            with pytest.raises(ConnectionError, match="without its ledger"):
                await task
            assert (await client.get_asset()).asset == "jackal"

    first = Aboard(tmp_path / "one")
    first.ground(session)


async def test_streams_continue_after_a_loss_without_a_gap(
    aboard: Aboard, client: MrsClient
) -> None:
    stream, values = client.notifications(), await client.telemetry()
    await client.submit(client.command(SetStatusInterval(0.5)))
    aboard.hang_up()
    aboard.do(lambda bench: bench.submit(MoveForward(0.5), 1))
    aboard.run(5.0)
    aboard.listen()
    await client.get_pose()
    aboard.run(1.0)
    assert (await anext(values)).name == "POS_X"
    sequences = [(await anext(stream)).report.sequence for _ in range(8)]
    assert sequences == list(range(1, 9))


def test_times_out_if_a_rover_remains_absent(
    aboard: Aboard, caplog: pytest.LogCaptureFixture
) -> None:
    async def session() -> None:
        async with await MrsClient.connect(aboard.uri, patience_s=0.1) as client:
            stream = client.notifications()
            task = asyncio.create_task(client.run(client.command(MoveForward(5.0))))
            await arrived(stream, Stage.RECEIVED)
            aboard.hang_up()
            with pytest.raises(ConnectionError, match="no answer at maltcp://"):
                await task
            with pytest.raises(ConnectionError):
                await arrived(stream, Stage.EXECUTED)
            with pytest.raises(ConnectionError):
                await client.get_pose()

    asyncio.run(session())
    assert f"connection with {aboard.uri} lost: it is tried again for 0.1 s" in caplog.messages


def test_a_session_that_is_closed_ends_everything(aboard: Aboard) -> None:
    async def session() -> None:
        client = await MrsClient.connect(aboard.uri)
        stream = client.notifications()
        task = asyncio.create_task(client.run(client.command(MoveForward(5.0))))
        await arrived(stream, Stage.RECEIVED)
        await client.close()
        assert Stage.EXECUTED not in [n.report.stage async for n in stream]
        with pytest.raises(ConnectionError, match="closed"):
            await task
        with pytest.raises(ConnectionError, match="closed"):
            await client.get_pose()

    asyncio.run(session())


def test_an_absent_rover_is_a_connection_error(aboard: Aboard) -> None:
    aboard.hang_up()
    with pytest.raises(ConnectionError, match=f"no answer at {aboard.uri}"):
        asyncio.run(MrsClient.connect(aboard.uri))


def test_a_web_server_is_no_rover() -> None:
    async def session() -> None:
        def answer(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n")
            writer.close()

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        async with server:
            await MrsClient.connect(f"127.0.0.1:{port}")

    with pytest.raises(
        ConnectionError,
        match=r"a web server, such as a console; the rover is at 127\.0\.0\.1:21000",
    ):
        asyncio.run(session())


def test_another_name_is_no_rover(aboard: Aboard) -> None:
    with pytest.raises(ConnectionError, match="does not answer like a rover"):
        asyncio.run(MrsClient.connect(aboard.uri + "X"))


def test_a_link_that_cannot_listen_reports_it_at_once(aboard: Aboard) -> None:
    def listen(bench: LinkedBench) -> None:
        MrsLink(bench.settings, port=aboard.port).start(bench.executive)

    with pytest.raises(OSError, match=r"(?i)address already in use"):
        aboard.do(listen)


@pytest.mark.parametrize(
    ("text", "uri"),
    [
        ("rover.local", "maltcp://rover.local:21000/MRS"),
        ("127.0.0.1:5000", "maltcp://127.0.0.1:5000/MRS"),
        ("[::1]:5000", "maltcp://[::1]:5000/MRS"),
        ("maltcp://10.0.0.1:21000/Other", "maltcp://10.0.0.1:21000/Other"),
        ("MALTCP://10.0.0.1:21000/Other", "maltcp://10.0.0.1:21000/Other"),
    ],
)
def test_reads_addresses(text: str, uri: str) -> None:
    assert str(parse_address(text)) == uri


@pytest.mark.parametrize("text", ["", "maltcp://host", "http://host:80/MRS", "host:port", "a/b"])
def test_reads_no_nonsense(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - what it says is for people
        parse_address(text)


def fact(sequence: int, text: str = "", cursor: int | None = None) -> Notification:
    return event(sequence=sequence, text=text, cursor=cursor or sequence or None)


class Connection:
    """What a feed needs of a consumer.

    Args:
        ledger: what the rover has written down.
        during: what it sends while it is asked for that.
    """

    def __init__(self, *ledger: Notification, during: tuple[Notification, ...] = ()) -> None:
        self.ledger = ledger
        self.during = list(during)
        self.readable = True

    async def subscribe(self, _: str, __: str, ___: Subscription, on_update: OnUpdate) -> None:
        self._on_update = on_update

    async def request(self, _: str, operation: str, since: int = 0, *__: Any) -> tuple[Any, ...]:
        while self.during:
            self.send(self.during.pop(0))
        if not self.readable:
            raise MalError(StandardError.INTERNAL)
        if operation == "getLastNotification":
            return (self.ledger[-1] if self.ledger else None,)
        return (tuple(n for n in self.ledger if (n.cursor or 0) >= since)[:2],)

    def send(self, notification: Notification) -> None:
        self._on_update(UpdateHeader(), notification)


class Listener:
    def __init__(self) -> None:
        self.received: list[int] = []
        self.new_ledgers = 0
        self.feed = NotificationStream(self._receive, self._strange)

    def on(self, connection: Connection) -> Connection:
        asyncio.run(self.feed.restore(connection))  # type: ignore[arg-type]
        return connection

    def _receive(self, received: ReceivedReport) -> None:
        self.received.append(received.report.sequence)

    def _strange(self) -> None:
        self.new_ledgers += 1


def test_the_first_connection_requests_nothing_of_the_past() -> None:
    listener = Listener()
    listener.on(Connection(fact(1), fact(2))).send(fact(3))
    assert listener.received == [3]


def test_reports_recorded_after_the_first_connection_are_fetched() -> None:
    for ledger in ((), (fact(1), fact(2))):
        listener = Listener()
        listener.on(Connection(*ledger))
        listener.on(Connection(*ledger, fact(3), fact(4)))
        assert (listener.received, listener.new_ledgers) == ([3, 4], 0)


def test_numbers_need_not_be_in_the_order_of_recording() -> None:
    listener = Listener()
    first = listener.on(Connection())
    received = (fact(1), fact(3, cursor=2))
    for each in received:
        first.send(each)
    refusal = fact(0, "refused", cursor=3)
    listener.on(Connection(*received, refusal, fact(2, cursor=4))).send(fact(0, "contact"))
    assert (listener.received, listener.new_ledgers) == ([1, 3, 0, 2, 0], 0)


def test_missed_reports_precede_new_ones() -> None:
    listener = Listener()
    listener.on(Connection()).send(fact(1))
    again = Connection(*map(fact, range(1, 7)), during=(fact(6), fact(7)))
    listener.on(again).send(fact(8))
    assert listener.received == [1, 2, 3, 4, 5, 6, 7, 8]
    assert listener.new_ledgers == 0


def test_a_rover_that_cannot_read_its_record_is_caught_up_with_later() -> None:
    listener = Listener()
    listener.on(Connection(fact(1))).send(fact(2))
    again = Connection(*map(fact, range(1, 7)))
    again.readable = False
    listener.on(again).send(fact(5))
    assert (listener.received, listener.feed.behind) == ([2, 5], True)
    again.readable = True
    again.during = [fact(7)]
    for _ in range(2):
        asyncio.run(listener.feed.catch_up(again))  # type: ignore[arg-type]
    again.send(fact(8))
    assert (listener.received, listener.feed.behind) == ([2, 5, 3, 4, 6, 7, 8], False)
    assert listener.new_ledgers == 0


def test_a_resent_report_is_received_again_and_is_not_the_last() -> None:
    listener = Listener()
    first = listener.on(Connection())
    for sequence in (4, 5, 4):
        first.send(fact(sequence))
    listener.on(Connection(*map(fact, range(1, 7))))
    assert listener.received == [4, 5, 4, 6]


def test_another_ledger_is_distinguished_from_the_known_one() -> None:
    for ledger in ((), (fact(1),), (fact(5, "other"), fact(6))):
        listener = Listener()
        listener.on(Connection()).send(fact(5))
        listener.on(Connection(*ledger)).send(fact(2))
        assert listener.received == [5, 2]
        assert listener.new_ledgers == 1


def test_reports_of_a_relay_itself_are_outside_the_numbering() -> None:
    listener = Listener()
    first = listener.on(Connection())
    first.send(fact(0, "contact"))
    first.send(fact(1))
    first.send(fact(0, "no contact"))
    listener.on(Connection(fact(1), fact(2), during=(fact(0, "contact"),)))
    assert listener.received == [0, 1, 0, 2, 0]
    assert listener.new_ledgers == 0


@pytest.mark.parametrize("steps", range(1, 4))
def test_a_session_with_a_cancelled_end_leaves_no_connection(aboard: Aboard, steps: int) -> None:
    async def session() -> None:
        client = await MrsClient.connect(aboard.uri)
        await client.telemetry()
        ending = asyncio.create_task(client.close())
        for _ in range(steps):
            await asyncio.sleep(0)
        ending.cancel()
        await asyncio.wait([ending])

    asyncio.run(session())
    gc.collect()  # an open connection is warned of, which is an error
