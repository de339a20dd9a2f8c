"""Wrong messages of publishers and of who invokes: answered for or hung up on, never INTERNAL."""

import asyncio
import logging
import random

import pytest

from adapters.mal import Codec, Interaction, StandardError
from tests.mal.test_hostile import exchange, mutated
from tests.mal.test_shared_broker import CAPTURED, MONITOR, client, publish
from tests.mal.wiretest import FILE, SERVICE, SPECIFICATION, provided

PUBLISHED = [message for sender, message in CAPTURED if sender == "provider"]
INVOKED = [
    bytes.fromhex(vector.message)
    for vector in FILE.vectors
    if vector.encoding == "fixed" and vector.given["stage"] in ("INVOKE", "PROGRESS", "SEND")
]
WRONG = 1500


@pytest.mark.parametrize(("name", "messages"), [("SharedBroker", PUBLISHED), (SERVICE, INVOKED)])
async def test_no_wrong_message_breaks_the_provider(
    name: str, messages: list[bytes], caplog: pytest.LogCaptureFixture
) -> None:
    chance = random.Random(14)
    codec = Codec(SPECIFICATION)

    async def endless(interaction: Interaction, *_parts: object) -> None:
        interaction.acknowledge(42 if interaction.call.operation == "doInvoke" else True)
        await asyncio.Event().wait()

    caplog.set_level(logging.ERROR, "adapters.mal")
    async with provided(name=name) as provider:
        provider.open(SERVICE, MONITOR)
        provider.serve(SERVICE, "doInvoke", endless)
        provider.serve(SERVICE, "doProgress", endless)
        provider.serve(SERVICE, "doSend", lambda *_: None)
        errors = 0
        for _ in range(WRONG):
            first = chance.choice(messages)
            for header, body in await exchange(provider, first + mutated(chance, messages)):
                if header.is_error:
                    number = codec.decode_error(body).number
                    assert number != StandardError.INTERNAL.value
                    errors += 1
        assert errors > WRONG // 10
        async with client(provider.uri) as publisher:
            publication = await publisher.publication(SERVICE, MONITOR)
            await publish(publication, 1.0)
            await publication.close()
        while provider._connections:
            await asyncio.sleep(0)
        assert not provider._broker._publishers
        assert not provider._running
    assert caplog.records == []
