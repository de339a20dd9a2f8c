"""SEND, INVOKE and PROGRESS between a provider and consumers over real sockets."""

import asyncio
import dataclasses
from collections.abc import Awaitable
from typing import Any

import pytest

from adapters.mal import (
    Call,
    Consumer,
    Encoding,
    Interaction,
    MalError,
    StandardError,
    encode_message,
)
from adapters.mal.message import Framer, decode_message
from tests.mal.wiretest import FILE, SERVICE, connected, cut, provided


async def invoked(interaction: Interaction, _: str) -> tuple[float]:
    interaction.acknowledge(42)
    return (-2.5,)


async def progressed(interaction: Interaction, count: int) -> tuple[str]:
    interaction.acknowledge(True)
    for number in range(1, count + 1):
        await interaction.update(100 * number)
    return ("done",)


async def error_of(interaction: Awaitable[Any]) -> tuple[int, Any]:
    with pytest.raises(MalError) as raised:
        await interaction
    return raised.value.number, raised.value.extra


async def all_of(consumer: Consumer, count: int = 3) -> tuple[Any, list[Any], Any]:
    """Acknowledgement, updates and response of a doProgress."""
    async with consumer.progress(SERVICE, "doProgress", count) as progress:
        updates = [p async for (p,) in progress]
        return progress.acknowledgement, updates, await progress.response()


@pytest.mark.parametrize("encoding", list(Encoding))
async def test_every_stage_goes_there_and_back(encoding: Encoding) -> None:
    sent: asyncio.Queue[tuple[Call, int]] = asyncio.Queue()

    def send(call: Call, value: int) -> None:
        sent.put_nowait((call, value))

    async with (
        provided(encoding=encoding) as provider,
        connected(provider, encoding=encoding) as consumer,
    ):
        provider.serve(SERVICE, "doSend", send)
        provider.serve(SERVICE, "doInvoke", invoked)
        provider.serve(SERVICE, "doProgress", progressed)
        await consumer.send(SERVICE, "doSend", -123456)
        call, value = await sent.get()
        assert (call.operation, value) == ("doSend", -123456)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "driveTo")
        assert invocation.acknowledgement == (42,)
        assert await invocation.response() == (-2.5,)
        assert await invocation.response() == (-2.5,)
        assert await all_of(consumer) == ((True,), [100, 200, 300], ("done",))
        assert await all_of(consumer, 0) == ((True,), [], ("done",))
        async with consumer.progress(SERVICE, "doProgress", 5) as progress:
            assert await progress.response() == ("done",)


@pytest.mark.parametrize("case", ["invoke.1", "progress.1"])
@pytest.mark.parametrize("encoding", list(Encoding))
async def test_the_captured_conversations_agree_octet_for_octet(
    encoding: Encoding, case: str
) -> None:
    first, *wanted = (
        bytes.fromhex(v.message)
        for v in FILE.vectors
        if v.given["case"] == case and v.encoding == encoding.name.lower()
    )

    async with provided(encoding=encoding) as provider:
        provider.serve(SERVICE, "doInvoke", invoked)
        provider.serve(SERVICE, "doProgress", progressed)
        uri = provider.uri
        reader, writer = await asyncio.open_connection(uri.host, uri.port)
        writer.write(first)
        framer, replies = Framer(), list[bytes]()
        while len(replies) < len(wanted):
            replies += cut(framer, await reader.read(1 << 16))
        writer.close()
    for reply, captured in zip(replies, wanted, strict=True):
        header, body = decode_message(reply)
        then = decode_message(captured)[0].timestamp_ns
        restamped = dataclasses.replace(header, timestamp_ns=then)
        assert encode_message(restamped, body) == captured


async def test_leaving_early_leaves_the_connection_usable() -> None:
    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doProgress", progressed)
        async with consumer.progress(SERVICE, "doProgress", 600) as progress:
            assert await anext(progress) == (100,)
        assert not consumer._pending
        assert (await all_of(consumer))[2] == ("done",)


async def test_interactions_over_a_connection_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adapters.mal.provider.INTERACTION_CAP", 3)

    go_on = asyncio.Event()

    async def waits(interaction: Interaction, _: str) -> tuple[float]:
        interaction.acknowledge(42)
        await go_on.wait()
        return (1.0,)

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doInvoke", waits)
        running = [await consumer.invoke(SERVICE, "doInvoke", "") for _ in range(3)]
        number, _ = await error_of(consumer.invoke(SERVICE, "doInvoke", ""))
        assert number == StandardError.TOO_MANY.value
        go_on.set()
        for invocation in running:
            assert await invocation.response() == (1.0,)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "")
        assert await invocation.response() == (1.0,)


async def test_many_run_at_once() -> None:
    async with provided() as provider:
        provider.serve(SERVICE, "doProgress", progressed)
        async with connected(provider) as one, connected(provider) as two:
            results = await asyncio.gather(*(all_of(c, 20) for c in (one, two, one, two)))
            assert results == 4 * [((True,), [100 * n for n in range(1, 21)], ("done",))]
