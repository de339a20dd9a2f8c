"""What a connection does with a peer that is slow to take what it is sent, or does not take it."""

import asyncio
import socket
from typing import Any

import pytest

from adapters.mal.errors import MalError
from adapters.mal.header import Header, encode_message
from adapters.mal.provider import Provider
from adapters.mal.specification import Stage
from adapters.mal.values import AttributeType, Typed
from tests.mal.wiretest import SERVICE, SPECIFICATION, connected, provided, run

BIG = (1 << 20) * b"x"


async def deaf(provider: Provider) -> asyncio.StreamWriter:
    """A client that sends and never reads."""
    _, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    return writer


def request(provider: Provider, number: int) -> bytes:
    operation = SPECIFICATION.operation(SERVICE, "doRequest")
    header = Header.of(operation, Stage.REQUEST, number, to_uri=str(provider.uri))
    return encode_message(header, bytes(8))


def test_a_peer_that_takes_no_replies_is_given_up(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario() -> None:
        gone = asyncio.Event()

        def answer(call: Any, _: float) -> tuple[str]:
            call.connection.lost.add_done_callback(lambda _: gone.set())
            return (BIG.decode(),)

        async with provided() as provider, connected(provider) as good:
            provider.serve(SERVICE, "doRequest", answer)
            writer = await deaf(provider)
            for number in range(40):
                writer.write(request(provider, number))
            await gone.wait()
            assert "octets wait to be read there" in caplog.text
            assert await good.request(SERVICE, "doRequest", 1.0) == (BIG.decode(),)
            writer.close()

    run(scenario())


def test_closing_does_not_wait_for_a_peer_that_takes_nothing() -> None:
    async def scenario() -> None:
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

    run(scenario())


def test_small_messages_are_not_held_back() -> None:
    async def scenario() -> None:
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

    run(scenario())


def test_extra_information_that_does_not_fit_is_left_out() -> None:
    async def scenario() -> None:
        def handler(*_: Any) -> None:
            raise MalError(7, Typed(AttributeType.OCTET, 1000))

        async with provided() as provider, connected(provider) as consumer:
            provider.serve(SERVICE, "doRequest", handler)
            with pytest.raises(MalError) as raised:
                await consumer.request(SERVICE, "doRequest", 1.0)
            assert (raised.value.number, raised.value.extra) == (7, None)

    run(scenario())


def test_notifications_of_one_turn_travel_together_and_in_order_with_replies() -> None:
    async def scenario() -> None:
        written: list[bytes] = []

        async with provided() as provider, connected(provider):
            await asyncio.sleep(0)
            while not provider._connections:
                await asyncio.sleep(0)
            (connection,) = provider._connections
            connection._transport.write = written.append  # type: ignore[union-attr,method-assign]
            connection.notify(b"one", droppable=True)
            connection.notify(b"two", droppable=False)
            assert written == []
            connection.send(b"reply")
            assert written == [b"onetwo", b"reply"]
            connection.notify(b"three", droppable=True)
            await asyncio.sleep(0)
            assert written == [b"onetwo", b"reply", b"three"]
            connection.notify(bytes(20_000), droppable=True)
            assert written[3:] == [bytes(20_000)]

    run(scenario())
