"""A PROGRESS with much to send: whoever is slow makes the other wait, and nobody's memory grows."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from adapters.mal import (
    Consumer,
    Interaction,
    InteractionStage,
    Provider,
    load_specification,
    transactions,
)

SPECIFICATION = load_specification(Path(__file__).with_name("transfer.xml"))
CHUNK = bytes(range(256)) * 256
COUNT = 800
BUFFER_CAP = 4 * len(CHUNK)


class Source:
    """Sends chunks, and keeps how many went and how many octets waited in the process at most."""

    def __init__(self) -> None:
        self.sent = 0
        self.waiting = 0

    async def fetch(self, interaction: Interaction, chunks: int) -> None:
        interaction.acknowledge()
        transport: Any = interaction.call.connection._transport
        for _ in range(chunks):
            await interaction.update(CHUNK)
            self.sent += 1
            self.waiting = max(self.waiting, transport.get_write_buffer_size())


async def provided(source: Source) -> tuple[Provider, Consumer]:
    provider = Provider(SPECIFICATION, "Transfer")
    provider.serve("Transfer", "fetch", source.fetch)
    await provider.start()
    return provider, await Consumer.connect(SPECIFICATION, provider.uri)


async def settled(source: Source) -> int:
    """How many chunks were sent when no more are, however long the loop turns."""
    seen = -1
    while seen != source.sent:
        seen = source.sent
        for _ in range(2000):
            await asyncio.sleep(0)
    return seen


async def test_a_large_transfer_does_not_pile_up_at_the_provider() -> None:
    source = Source()
    provider, consumer = await provided(source)
    octets = 0
    async with consumer.progress("Transfer", "fetch", COUNT) as progress:
        async for (chunk,) in progress:
            assert chunk == CHUNK
            octets += len(chunk)
        assert await progress.response() == ()
    assert octets == COUNT * len(CHUNK)
    assert source.waiting < BUFFER_CAP
    await consumer.close()
    await provider.close()


async def test_a_consumer_that_takes_no_updates_makes_the_provider_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(transactions, "MAX_BUFFERED_OCTETS", 4 * len(CHUNK))

    source = Source()
    provider, consumer = await provided(source)
    async with consumer.progress("Transfer", "fetch", COUNT) as progress:
        assert await settled(source) < COUNT
        assert source.waiting < BUFFER_CAP
        assert progress._transaction._octets < 16 * len(CHUNK)
        assert len([chunk async for chunk in progress]) == COUNT
    async with consumer.progress("Transfer", "fetch", COUNT) as progress:
        assert await settled(source) < 2 * COUNT
    async with consumer.progress("Transfer", "fetch", 1) as progress:
        assert await progress.response() == ()
    await consumer.close()
    await provider.close()


async def test_a_peer_that_never_reads_makes_only_itself_wait() -> None:
    source, other = Source(), Source()
    provider, consumer = await provided(source)
    deaf = await Consumer.connect(SPECIFICATION, provider.uri)
    provider.serve("Transfer", "fetch", other.fetch)
    deaf._connection.pause_reading(deaf)
    deaf._send("Transfer", "fetch", InteractionStage.PROGRESS, (COUNT,))
    assert await settled(other) < COUNT
    provider.serve("Transfer", "fetch", source.fetch)
    async with consumer.progress("Transfer", "fetch", 100) as progress:
        assert len([chunk async for chunk in progress]) == 100
    assert other.waiting < BUFFER_CAP
    await deaf.close()
    await consumer.close()
    await provider.close()


async def test_a_provider_waits_for_a_consumer_for_its_stated_time_only() -> None:
    aborted = asyncio.Event()

    async def fetch(interaction: Interaction, chunks: int) -> None:
        interaction.acknowledge()
        try:
            for _ in range(chunks):
                await interaction.update(CHUNK, patience_s=0.1)
        except TimeoutError:
            aborted.set()
            raise

    provider, deaf = await provided(Source())
    provider.serve("Transfer", "fetch", fetch)
    deaf._connection.pause_reading(deaf)
    deaf._send("Transfer", "fetch", InteractionStage.PROGRESS, (COUNT,))
    await aborted.wait()
    await deaf.close()
    await provider.close()
