"""Crowds, half messages, floods and deaf peers: whoever was there first goes on being served."""

import asyncio
import logging
import resource
import socket
import struct
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

import pytest

from adapters.mal import (
    Certificates,
    Connection,
    Consumer,
    Header,
    InteractionStage,
    MalError,
    PeerLimits,
    Provider,
    StandardError,
    Subscription,
    encode_message,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import mrs_specification
from executive.commands import SetTravelSpeed, Stop
from tests.mal.test_pubsub import Updates, publish
from tests.mal.wiretest import SERVICE, SPECIFICATION, XML, connected, error_of, provided
from tests.mrs.aboard import Aboard
from tests.support.certificates import certified

CROWD = 40
FEW = PeerLimits(connections=8)
KIB = 1 << 10


def echo(_: object, value: Any, other: Any) -> tuple[Any, Any]:
    return value, other


async def served(consumer: Consumer) -> None:
    assert await consumer.request(SERVICE, "echoLong", 1, None) == (1, None)


async def attack(provider: Provider, octets: bytes = b"") -> asyncio.StreamWriter:
    """Connect, send octets and no more."""
    _, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
    writer.write(octets)
    return writer


@asynccontextmanager
async def besieged(limits: PeerLimits, **options: Any) -> AsyncIterator[tuple[Provider, Consumer]]:
    """A provider, and a client that was there first."""
    async with provided(limits=limits, **options) as provider:
        provider.serve(SERVICE, "echoLong", echo)
        async with connected(provider) as first:
            await served(first)
            yield provider, first


ONE = bytes(8) + b"\0"
"""The body of an echoLong."""


def request(provider: Provider, body: bytes = ONE) -> bytes:
    operation = SPECIFICATION.operation(SERVICE, "echoLong")
    header = Header.of(operation, InteractionStage.REQUEST, 1, to_uri=str(provider.uri))
    return encode_message(header, body)


async def test_a_crowd_blocks_neither_connected_nor_new_clients(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with besieged(FEW) as (provider, first):
        crowd = [await attack(provider) for _ in range(CROWD)]
        await served(first)
        assert len(provider._connections._open) <= 8
        async with connected(provider) as newcomer:
            await served(newcomer)
            await served(first)
        for each in crowd:
            each.close()
    reported = [
        record for record in caplog.records if "another peer needs one" in record.getMessage()
    ]
    assert 1 <= len(reported) <= 10


async def test_of_an_active_crowd_the_connection_with_the_maximum_silence_is_closed() -> None:
    async with besieged(FEW) as (provider, first):
        crowd = []
        for _ in range(CROWD):
            crowd.append(await attack(provider, 5 * request(provider)))
            await served(first)
        async with connected(provider) as newcomer:
            await served(newcomer)
            await served(first)
        for each in crowd:
            each.close()


async def test_a_protected_connection_is_not_closed() -> None:
    stored: set[Connection] = set()

    def submit(call: Any, *_: Any) -> None:
        stored.add(call.connection)

    async with besieged(FEW) as (provider, first):
        provider.serve(SERVICE, "doSubmit", submit)
        provider.set_priority_check(stored.__contains__)
        await first.submit(SERVICE, "doSubmit", "lamp", True)
        crowd = [await attack(provider, request(provider)) for _ in range(CROWD)]
        await served(first)
        for each in crowd:
            each.close()


def test_the_connection_of_the_authority_holder_is_not_closed(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        await client.authority.request()
        await client.submit(client.command(SetTravelSpeed(0.2)))
        crowd = []
        for _ in range(300):
            _, writer = await asyncio.open_connection("127.0.0.1", aboard.port)
            writer.write(20 * b"no message at all")
            crowd.append(writer)
        await client.submit(client.command(SetTravelSpeed(0.3)))
        for each in crowd:
            each.close()

    aboard.ground(session)


async def test_handshakes_that_never_end_block_no_client(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    ends: dict[str, Certificates] = certified(tmp_path_factory.mktemp("ends"), "rover", "MOE")
    async with provided(limits=FEW, tls=ends["rover"].for_provider()) as provider:
        provider.serve(SERVICE, "echoLong", echo)
        crowd = [await attack(provider) for _ in range(CROWD)]
        async with connected(provider, tls=ends["MOE"].for_consumer()) as newcomer:
            await served(newcomer)
        for each in crowd:
            each.close()


async def test_half_messages_take_a_bounded_part_of_memory(
    caplog: pytest.LogCaptureFixture,
) -> None:
    limits = PeerLimits(message_octets=KIB * KIB, unfinished_octets=2 * KIB * KIB)
    async with besieged(limits) as (provider, first):
        half = request(provider, bytes(1000 * KIB))[: 512 * KIB]
        crowd = [await attack(provider, half) for _ in range(CROWD)]
        for each in crowd:
            with suppress(ConnectionError):
                await each.drain()
            await served(first)
        held = sum(len(each._framer._buffer) for each in provider._connections._open)
        assert held <= 2 * KIB * KIB + CROWD * 64 * KIB
        for each in crowd:
            each.close()
    assert "octets of unfinished messages over all connections together" in caplog.text


@pytest.mark.parametrize(
    ("octets", "why"),
    [(b"", "no message within 0.05 s"), (b"\0\0\1\0half", "a message is incomplete for 0.05 s")],
)
async def test_a_stalled_handshake_is_disconnected(
    octets: bytes, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    async with besieged(PeerLimits(silence_s=0.05, stall_s=0.05)) as (provider, first):
        reader, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
        if octets:
            writer.write(request(provider))
            await reader.read(1)
            writer.write(octets)
        with suppress(ConnectionError):
            await reader.read(-1)
        writer.close()
        await served(first)
    assert why in caplog.text


async def test_a_message_beyond_the_bound_is_answered_and_skipped() -> None:
    async with provided(limits=PeerLimits(message_octets=8 * KIB)) as provider:
        provider.serve(SERVICE, "doSubmit", lambda *_: None)
        provider.serve(SERVICE, "echoLong", echo)
        async with connected(provider) as consumer:
            for _ in range(3):
                error = await error_of(consumer.submit(SERVICE, "doSubmit", 100_000 * "x", True))
                assert error.number == StandardError.TOO_MANY.value
                assert "at most 8192 are accepted" in str(error)
                await served(consumer)


async def test_a_flood_on_one_connection_does_not_hold_up_another() -> None:
    order: list[int] = []

    def note(_: object, value: Any, other: Any) -> tuple[Any, Any]:
        order.append(value)
        return value, other

    async with besieged(PeerLimits()) as (provider, first):
        provider.serve(SERVICE, "echoLong", note)
        flood = await attack(provider, 4000 * request(provider))
        await first.request(SERVICE, "echoLong", 1, None)
        while len(order) < 4001:
            await asyncio.sleep(0)
        assert order.index(1) < 4000
        flood.close()


async def test_registrations_without_readers_delay_no_subscriber() -> None:
    deaf = []
    async with besieged(PeerLimits(subscriptions=64, share=32)) as (provider, first):
        publisher = provider.publisher(SERVICE, "monitor")
        updates = Updates()
        await first.subscribe(SERVICE, "monitor", Subscription(subscriptionId="s"), updates)
        operation = SPECIFICATION.operation(SERVICE, "monitor")
        for _ in range(4):
            writer = await attack(provider)
            writer.transport.pause_reading()  # type: ignore[attr-defined]
            deaf.append(writer)
            for number in range(40):
                header = Header.of(
                    operation,
                    InteractionStage.REGISTER,
                    number,
                    to_uri=str(provider.uri.broker),
                )
                writer.write(encode_message(header, b"\0\0\0\1" + bytes([48 + number]) + b"\0\0\0"))
        async with connected(provider) as newcomer:
            await served(newcomer)
            reported = Updates()
            await newcomer.subscribe(SERVICE, "monitor", Subscription(subscriptionId="s"), reported)
            for number in range(1000):
                publish(publisher, float(number))
                await updates.have(number + 1)
            await reported.have(1000)
        for each in deaf:
            each.close()


async def test_an_unreadable_message_is_reported_with_peer_and_reason_and_not_too_often(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.WARNING)
    async with besieged(PeerLimits()) as (provider, first):
        for _ in range(100):
            with pytest.raises(MalError):
                await first.request(SERVICE, "doRequest", 1.0)
        port = first.local_address[1]
        writer = await attack(provider, 100 * request(provider, bytes(8) + b"\2"))
        while "BAD_ENCODING" not in caplog.text:
            await served(first)
        writer.close()
    unserved = [each for each in caplog.messages if "UNSUPPORTED_OPERATION" in each]
    unread = [each for each in caplog.messages if "BAD_ENCODING" in each]
    assert (len(unserved), len(unread)) == (10, 10)
    assert f"from 127.0.0.1:{port}" in unserved[0]
    assert "a flag or Boolean must be 0 or 1, not 2" in unread[0]


async def test_slow_answers_are_bounded_and_end_with_their_caller() -> None:
    begun, ended = [0], [0]

    async def long(_: object, value: Any, other: Any) -> tuple[Any, Any]:
        begun[0] += 1
        try:
            await asyncio.sleep(60.0)
        finally:
            ended[0] += 1
        return value, other

    async with provided(limits=PeerLimits(share=8)) as provider:
        provider.serve(SERVICE, "echoLong", long)
        async with connected(provider) as first:
            requested = [
                asyncio.create_task(first.request(SERVICE, "echoLong", 1, None)) for _ in range(20)
            ]
            refused, _ = await asyncio.wait(requested, return_when=asyncio.FIRST_COMPLETED)
            with pytest.raises(MalError, match="at most 8 active interactions"):
                refused.pop().result()
        await asyncio.gather(*requested, return_exceptions=True)
        async with asyncio.timeout(5.0):
            while ended != begun:
                await asyncio.sleep(0.01)
    assert begun == [8]


async def test_a_disconnection_before_acceptance_leaves_nothing_behind(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with besieged(FEW) as (provider, first):
        for _ in range(CROWD):
            with socket.create_connection((provider.uri.host, provider.uri.port)) as hasty:
                reset_at_once = struct.pack("ii", 1, 0)
                hasty.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset_at_once)
        await served(first)
        async with connected(provider) as other:
            await served(other)
    assert "Traceback" not in caplog.text
    assert len(caplog.records) < CROWD


async def test_where_descriptors_are_few_new_operators_get_in_and_the_log_stays_short() -> None:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "tests.mal.broker_process", str(XML)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64)),
    )
    assert process.stdout is not None
    assert process.stderr is not None
    uri = (await process.stdout.readline()).decode().strip()
    host, _, port = uri.removeprefix("maltcp://").partition("/")[0].partition(":")
    crowd = [await asyncio.open_connection(host, int(port)) for _ in range(200)]
    async with asyncio.timeout(10.0):
        newcomer = await Consumer.connect(SPECIFICATION, uri, is_broker=True)
        subscription = Subscription(subscriptionId="s")
        await newcomer.subscribe(SERVICE, "monitor", subscription, lambda *_: None)
        await newcomer.close()
    for _, writer in crowd:
        writer.close()
    process.terminate()
    _, log = await process.communicate()
    assert len(log) < 10_000


@pytest.mark.at_length
def test_long_lists_do_not_hold_up_a_stop(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        consumer = await Consumer.connect(mrs_specification(), aboard.uri)
        error = await error_of(consumer.request("Monitoring", "getValue", 250_000 * ("",)))
        assert error.number == StandardError.BAD_ENCODING.value
        assert "250000 list elements, 2048 allowed" in str(error)
        await consumer.close()
        await client.submit(client.command(Stop()))

    aboard.ground(session)
