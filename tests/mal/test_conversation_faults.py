"""SEND, INVOKE and PROGRESS that go wrong: errors at every stage, silence, a link that is lost."""

import asyncio
from typing import Any

import pytest

from adapters.mal import (
    AttributeType,
    Interaction,
    MalError,
    Stage,
    StandardError,
    Typed,
    UpdateError,
)
from adapters.mal.message import Framer, decode_message
from tests.mal.test_conversations import all_of, error_of, invoked
from tests.mal.wiretest import FILE, SERVICE, connected, cut, provided

WHY = Typed(AttributeType.STRING, "why")


async def test_errors_end_it_at_every_stage() -> None:
    async def refuse(_: Interaction, *_parts: Any) -> None:
        raise MalError(7, WHY)

    async def fail(interaction: Interaction, first: Any) -> None:
        interaction.acknowledge(42 if isinstance(first, str) else True)
        if not isinstance(first, str):
            await interaction.update(1)
        raise MalError(8, WHY)

    async def fail_update(interaction: Interaction, _: int) -> None:
        interaction.acknowledge(True)
        await interaction.update(1)
        raise UpdateError(9, WHY)

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doInvoke", refuse)
        provider.serve(SERVICE, "doProgress", refuse)
        assert await error_of(consumer.invoke(SERVICE, "doInvoke", "")) == (7, WHY)
        assert await error_of(all_of(consumer)) == (7, WHY)
        provider.serve(SERVICE, "doInvoke", fail)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "")
        assert invocation.acknowledgement == (42,)
        for _ in range(2):
            assert await error_of(invocation.response()) == (8, WHY)
        for handler, number in ((fail, 8), (fail_update, 9)):
            provider.serve(SERVICE, "doProgress", handler)
            async with consumer.progress(SERVICE, "doProgress", 1) as progress:
                assert await anext(progress) == (1,)
                assert await error_of(anext(progress)) == (number, WHY)
                assert await error_of(progress.response()) == (number, WHY)


@pytest.mark.parametrize(
    ("handler", "stage"),
    [
        ("refuse", Stage.PROGRESS_ACK),
        ("update", Stage.PROGRESS_UPDATE),
        ("", Stage.PROGRESS_RESPONSE),
    ],
)
async def test_an_error_takes_the_place_of_the_message_that_would_come(
    handler: str, stage: Stage
) -> None:
    async def fail(interaction: Interaction, _: int) -> None:
        if handler != "refuse":
            interaction.acknowledge(True)
        raise (UpdateError if handler == "update" else MalError)(9)

    async with provided() as provider:
        provider.serve(SERVICE, "doProgress", fail)
        reader, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
        writer.write(
            next(bytes.fromhex(v.message) for v in FILE.vectors if v.given["case"] == "progress.1")
        )
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
            number, _ = await error_of(all_of(consumer))
            assert number == StandardError.INTERNAL.value
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
        number, _ = await error_of(consumer.send(SERVICE, "doSend", 3))
        assert number == StandardError.DESTINATION_LOST.value
    assert "ZeroDivisionError" in caplog.text


async def test_it_is_cancelled_when_the_consumer_goes() -> None:
    ended: asyncio.Queue[str] = asyncio.Queue()

    async def endless(interaction: Interaction, *_parts: Any) -> None:
        interaction.acknowledge(42 if interaction.call.operation == "doInvoke" else True)
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            ended.put_nowait(interaction.call.operation)
            raise

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doInvoke", endless)
        provider.serve(SERVICE, "doProgress", endless)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "")
        async with consumer.progress(SERVICE, "doProgress", 1) as progress:
            await consumer.close()
            lost = (StandardError.DESTINATION_LOST.value, None)
            assert await error_of(invocation.response()) == lost
            assert await error_of(anext(progress)) == lost
        assert {await ended.get(), await ended.get()} == {"doInvoke", "doProgress"}


async def test_a_provider_that_closes_says_so() -> None:
    async def endless(interaction: Interaction, *_parts: Any) -> None:
        interaction.acknowledge(42)
        await asyncio.Event().wait()

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doInvoke", endless)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "")
        await provider.close()
        number, _ = await error_of(invocation.response())
        assert number == StandardError.SHUTDOWN.value


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
        assert (await error_of(consumer.invoke(SERVICE, "doInvoke", "")))[0] == unsent
        assert (await error_of(all_of(consumer)))[0] == unsent
        stages.append(1)
        invocation = await consumer.invoke(SERVICE, "doInvoke", "", timeout_s=0.01)
        assert (await error_of(invocation.response()))[0] == unfinished
        assert (await error_of(all_of(consumer)))[0] == unfinished
        stages.append(2)
        async with consumer.progress(SERVICE, "doProgress", 1) as progress:
            assert await anext(progress) == (1,)
            assert (await error_of(anext(progress)))[0] == unfinished
        assert not consumer._pending
