"""SEND, INVOKE and PROGRESS between a provider and consumers, and what goes wrong with them."""

import asyncio
import dataclasses
from typing import Any

import pytest

from adapters.mal import (
    CallContext,
    Consumer,
    Encoding,
    Interaction,
    InteractionStage,
    MalError,
    PeerLimits,
    StandardError,
    UpdateError,
    encode_message,
)
from adapters.mal.codec import decode_message
from adapters.mal.connection import Framer
from tests.mal.wiretest import FILE, SERVICE, connected, cut, error_of, provided


async def invoked(interaction: Interaction, _: str) -> tuple[float]:
    interaction.acknowledge(42)
    return (-2.5,)


async def progressed(interaction: Interaction, count: int) -> tuple[str]:
    interaction.acknowledge(True)
    for number in range(1, count + 1):
        await interaction.update(100 * number)
    return ("done",)


async def all_of(consumer: Consumer, count: int = 3) -> tuple[Any, list[Any], Any]:
    """Acknowledgement, updates and response of a doProgress."""
    async with consumer.progress(SERVICE, "doProgress", count) as progress:
        updates = [p async for (p,) in progress]
        return progress.acknowledgement, updates, await progress.response()


@pytest.mark.parametrize("encoding", list(Encoding))
async def test_every_stage_goes_there_and_back(encoding: Encoding) -> None:
    sent: asyncio.Queue[tuple[CallContext, int]] = asyncio.Queue()

    def send(call: CallContext, value: int) -> None:
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
        bytes.fromhex(vector["message"])
        for vector in FILE["vectors"]
        if vector["case"] == case and vector["encoding"] == encoding.name.lower()
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


async def test_interactions_over_a_connection_are_bounded() -> None:
    proceed = asyncio.Event()

    async def waits(interaction: Interaction, _: str) -> tuple[float]:
        interaction.acknowledge(42)
        await proceed.wait()
        return (1.0,)

    async with provided(limits=PeerLimits(share=3)) as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doInvoke", waits)
        running = [await consumer.invoke(SERVICE, "doInvoke", "") for _ in range(3)]
        error = await error_of(consumer.invoke(SERVICE, "doInvoke", ""))
        assert error.number == StandardError.TOO_MANY.value
        proceed.set()
        for invocation in running:
            assert await invocation.response() == (1.0,)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "")
        assert await invocation.response() == (1.0,)


@pytest.mark.parametrize(
    ("handler", "stage"),
    [
        ("refuse", InteractionStage.PROGRESS_ACK),
        ("update", InteractionStage.PROGRESS_UPDATE),
        ("", InteractionStage.PROGRESS_RESPONSE),
    ],
)
async def test_an_error_replaces_the_expected_message(
    handler: str, stage: InteractionStage
) -> None:
    async def fail(interaction: Interaction, _: int) -> None:
        if handler != "refuse":
            interaction.acknowledge(True)
        raise (UpdateError if handler == "update" else MalError)(9)

    async with provided() as provider:
        provider.serve(SERVICE, "doProgress", fail)
        reader, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
        captured = next(each for each in FILE["vectors"] if each["case"] == "progress.1")
        writer.write(bytes.fromhex(captured["message"]))
        framer = Framer()
        last = None
        while last is None or not last.is_error:
            for message in cut(framer, await reader.read(1 << 16)):
                last, _ = decode_message(message)
        assert last.stage is stage
        writer.close()


async def test_a_handler_that_breaks_the_rules_is_answered_for(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def silent(_: Interaction, *_parts: Any) -> tuple[str]:
        return ("done",)

    async def twice(interaction: Interaction, *_parts: Any) -> None:
        interaction.acknowledge(True)
        interaction.acknowledge(True)

    async def early(interaction: Interaction, *_parts: Any) -> None:
        await interaction.update(1)

    async def wrong(interaction: Interaction, *_parts: Any) -> None:
        interaction.acknowledge("yes")

    async with provided() as provider, connected(provider) as consumer:
        for handler in (silent, twice, early, wrong, lambda *_: None):
            provider.serve(SERVICE, "doProgress", handler)
            error = await error_of(all_of(consumer))
            assert error.number == StandardError.INTERNAL.value
    for why in ("no acknowledgement", "acknowledged already", "is not async", "b: "):
        assert why in caplog.text


async def test_a_send_that_fails_is_dropped(caplog: pytest.LogCaptureFixture) -> None:
    def breaks(*_: Any) -> None:
        raise ZeroDivisionError

    async with provided() as provider, connected(provider) as consumer:
        await consumer.send(SERVICE, "doSend", 1)
        provider.serve(SERVICE, "doSend", breaks)
        provider.serve(SERVICE, "doInvoke", invoked)
        await consumer.send(SERVICE, "doSend", 2)
        assert (await consumer.invoke(SERVICE, "doInvoke", "")).acknowledgement == (42,)
        await consumer.close()
        error = await error_of(consumer.send(SERVICE, "doSend", 3))
        assert error.number == StandardError.DESTINATION_LOST.value
    assert "ZeroDivisionError" in caplog.text


async def test_silence_at_any_stage_is_an_error() -> None:
    stages: list[int] = []

    async def stops(interaction: Interaction, first: Any) -> None:
        if stages[-1] > 0:
            interaction.acknowledge(42 if isinstance(first, str) else True)
        if stages[-1] > 1:
            await interaction.update(1)
        await asyncio.Event().wait()

    unsent, unfinished = (
        StandardError.DELIVERY_TIMEDOUT.value,
        StandardError.TRANSACTION_TIMEOUT.value,
    )
    async with provided() as provider, connected(provider, timeout_s=0.05) as consumer:
        provider.serve(SERVICE, "doInvoke", stops)
        provider.serve(SERVICE, "doProgress", stops)
        stages.append(0)
        assert (await error_of(consumer.invoke(SERVICE, "doInvoke", ""))).number == unsent
        assert (await error_of(all_of(consumer))).number == unsent
        stages.append(1)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "", timeout_s=0.01)
        assert (await error_of(invocation.response())).number == unfinished
        assert (await error_of(all_of(consumer))).number == unfinished
        stages.append(2)
        async with consumer.progress(SERVICE, "doProgress", 1) as progress:
            assert await anext(progress) == (1,)
            assert (await error_of(anext(progress))).number == unfinished
        assert not consumer._pending
