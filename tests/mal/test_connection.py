"""What a connection does with a peer that is slow to take what it is sent, or does not take it."""

import asyncio
import random
import socket
from typing import Any

import pytest

from adapters.mal import (
    AttributeType,
    DecodeError,
    Header,
    InteractionStage,
    MalError,
    Provider,
    TypedAttribute,
    connection,
    encode_message,
)
from adapters.mal.codec import MIN_MESSAGE_OCTETS, decode_message
from adapters.mal.connection import (
    MESSAGE_CAP,
    Connection,
    ConnectionGuard,
    Framer,
    LinkTraffic,
    NotificationQueue,
)
from tests.mal.wiretest import SERVICE, SPECIFICATION, connected, cut, provided

BIG = (1 << 20) * b"x"


async def deaf(provider: Provider) -> asyncio.StreamWriter:
    """A client that sends and never reads."""
    _, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    return writer


def request(provider: Provider, number: int) -> bytes:
    operation = SPECIFICATION.operation(SERVICE, "doRequest")
    header = Header.of(operation, InteractionStage.REQUEST, number, to_uri=str(provider.uri))
    return encode_message(header, bytes(8))


async def test_a_peer_that_accepts_no_replies_is_disconnected(
    caplog: pytest.LogCaptureFixture,
) -> None:
    closed = asyncio.Event()

    def answer(call: Any, _: float) -> tuple[str]:
        call.connection.lost.add_done_callback(lambda _: closed.set())
        return (BIG.decode(),)

    async with provided() as provider, connected(provider) as good:
        provider.serve(SERVICE, "doRequest", answer)
        writer = await deaf(provider)
        for number in range(40):
            writer.write(request(provider, number))
        await closed.wait()
        assert "octets are unread by the peer" in caplog.text
        assert await good.request(SERVICE, "doRequest", 1.0) == (BIG.decode(),)
        writer.close()


async def test_closing_does_not_wait_for_a_peer_that_takes_nothing() -> None:
    answered = asyncio.Event()

    def answer(*_: Any) -> tuple[str]:
        answered.set()
        return (7 * BIG.decode(),)

    async with provided() as provider:
        provider.serve(SERVICE, "doRequest", answer)
        writer = await deaf(provider)
        writer.write(request(provider, 1))
        await answered.wait()
    writer.close()


async def test_small_messages_are_not_held_back() -> None:
    options = []

    def handler(call: Any, _: float) -> None:
        transport = call.connection._transport
        sock: socket.socket = transport.get_extra_info("socket")
        options.append(sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
        raise MalError(1)

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doRequest", handler)
        with pytest.raises(MalError):
            await consumer.request(SERVICE, "doRequest", 1.0)
    assert options == [1]


async def test_extra_information_that_does_not_fit_is_left_out() -> None:
    def handler(*_: Any) -> None:
        raise MalError(7, TypedAttribute(AttributeType.OCTET, 1000))

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doRequest", handler)
        with pytest.raises(MalError) as raised:
            await consumer.request(SERVICE, "doRequest", 1.0)
        assert (raised.value.number, raised.value.extra) == (7, None)


async def test_notifications_of_one_turn_travel_together_and_in_order_with_replies() -> None:
    written: list[bytes] = []

    async with provided() as provider, connected(provider):
        await asyncio.sleep(0)
        while not provider._connections._open:
            await asyncio.sleep(0)
        (connection,) = provider._connections._open
        connection._transport.write = written.append  # type: ignore[union-attr,method-assign]
        connection.notify(lambda: [b"one"], droppable=True)
        connection.notify(lambda: [b"two"], droppable=False)
        assert written == []
        connection.send(b"reply")
        assert written == [b"onetworeply"]
        connection.notify(lambda: [b"three"], droppable=True)
        await asyncio.sleep(0)
        assert written == [b"onetworeply", b"three"]
        connection.notify(lambda: [bytes(20_000)], droppable=True)
        assert written[2:] == [bytes(20_000)]


async def test_answers_to_simultaneous_messages_are_written_together_and_before_a_refusal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connection, "SLICE_S", 60.0)
    written: list[bytes] = []
    async with provided() as provider, connected(provider):
        provider.serve(SERVICE, "doRequest", lambda *_: ("text",))
        while not provider._connections._open:
            await asyncio.sleep(0)
        (served,) = provider._connections._open
        served._transport.write = written.append  # type: ignore[union-attr,method-assign]
        octets = b"".join(request(provider, number) for number in range(5)) + bytes(4)
        served.get_buffer(-1)[: len(octets)] = octets
        served.buffer_updated(len(octets))
        assert not served.is_open
        answers = [decode_message(answer)[0] for answer in cut(Framer(), b"".join(written))]
    assert [answer.transaction_id for answer in answers] == list(range(5))
    assert len(written) == 1


def put(queue: NotificationQueue, message: bytes, *, droppable: bool) -> None:
    queue.put(lambda: [message], droppable)


def send_all(queue: NotificationQueue) -> None:
    while queue.send_one():
        pass


def test_notifications_are_in_order_and_only_the_first_droppable_ones_are_dropped() -> None:
    written: list[bytes] = []
    aborted: list[str] = []
    queue = NotificationQueue(written.append, aborted.append)
    queue.paused = True
    for number in range(connection.DROPPABLE_CAP + 10):
        put(queue, b"t%d" % number, droppable=True)
        if number % 100 == 0:
            put(queue, b"r%d" % number, droppable=False)
    send_all(queue)
    assert written == []
    queue.paused = False
    send_all(queue)
    assert written == [
        name % number
        for number in range(connection.DROPPABLE_CAP + 10)
        for name in (b"t%d", b"r%d")
        if (number >= 10 if name == b"t%d" else number % 100 == 0)
    ]
    for _ in range(connection.BACKLOG_CAP + 10):  # who reads is sent them instead of given up
        put(queue, b"r", droppable=False)
    queue.paused = True
    assert not aborted
    put(queue, b"r", droppable=False)
    assert len(aborted) == 1


def test_a_queue_paused_while_it_empties_retains_the_rest() -> None:
    written: list[bytes] = []
    queue = NotificationQueue(written.append, lambda _: None)
    queue.put(lambda: [b"a", b"b"], droppable=True)
    put(queue, b"c", droppable=True)
    for count in (1, 2, 3):
        queue.send_one()
        assert len(written) == count
    assert written == [b"a", b"b", b"c"]


SIZES = (
    MIN_MESSAGE_OCTETS,
    100,
    5_000,
    16 << 10,
    66_000,
    256 << 10,
    700_000,
    3 << 20,
    MIN_MESSAGE_OCTETS,
)


def message(size: int, fill: int) -> bytes:
    return size.to_bytes(4, "big") + bytes([fill]) * (size - 4)


@pytest.mark.parametrize("seed", range(5))
def test_messages_of_all_sizes_arrive_unchanged(seed: int) -> None:
    chance = random.Random(seed)
    sent = [message(chance.choice(SIZES), number % 256) for number in range(40)]
    stream, framer = memoryview(b"".join(sent)), Framer()
    got: list[bytes] = []
    while stream:
        count = chance.choice((1, 3, 1000, 70_000, 300_000, 1 << 20))
        got += cut(framer, bytes(stream[:count]))
        stream = stream[count:]
    assert got == sent


def test_an_announced_message_uses_no_memory_before_it_arrives() -> None:
    framer = Framer()
    assert list(cut(framer, message(MESSAGE_CAP, 0)[:1000])) == []
    assert len(framer._buffer) <= 16 << 10
    assert list(cut(framer, bytes(1_000_000))) == []
    assert len(framer._buffer) <= 2 << 20


def test_a_long_message_leaves_no_long_buffer_behind() -> None:
    framer = Framer()
    (got,) = cut(framer, message(8 << 20, 7))
    assert len(got) == 8 << 20
    assert len(framer._buffer) <= 256 << 10


def test_many_simultaneous_messages_are_read_in_large_pieces() -> None:
    framer = Framer()
    assert len(list(cut(framer, 20_000 * message(50, 1)))) == 20_000
    assert len(framer.buffer()) >= 32 << 10


def test_nothing_is_given_behind_what_cannot_be_a_message() -> None:
    got = cut(Framer(), message(50, 1) + (3).to_bytes(4, "big") + message(50, 2))
    assert next(got) == message(50, 1)
    with pytest.raises(DecodeError, match="message length 3"):
        next(got)


async def test_messages_to_a_closed_connection_are_not_traffic() -> None:
    guard = ConnectionGuard()
    Connection(lambda *_: None, guard).send(bytes(40))
    assert guard.traffic == LinkTraffic()
