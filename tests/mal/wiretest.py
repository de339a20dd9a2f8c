"""What the tests of the MAL stack share: captured messages, their specification, a provider."""

import json
import ssl
from collections.abc import AsyncIterator, Awaitable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from adapters.mal import Consumer, MalError, Provider
from adapters.mal.connection import Framer
from tests.conformance.specification import read_specification

VECTORS_JSON = Path(__file__).with_name("vectors.json")
XML = Path(__file__).with_name("wiretest.xml")
FILE: Any = json.loads(VECTORS_JSON.read_text())
SPECIFICATION = read_specification(FILE["testSpecification"])
SERVICE = "Vectors"
Mode: Any = SPECIFICATION.classes["Mode"]
Rec: Any = SPECIFICATION.classes["Rec"]
Derived: Any = SPECIFICATION.classes["Derived"]
Derived2: Any = SPECIFICATION.classes["Derived2"]


async def error_of(interaction: Awaitable[Any]) -> MalError:
    """The error that an interaction ends with."""
    with pytest.raises(MalError) as raised:
        await interaction
    return raised.value


def cut(framer: Framer, octets: bytes) -> Iterator[bytes]:
    """The messages that are whole when octets have arrived."""
    while octets:
        buffer = framer.buffer()
        count = min(len(buffer), len(octets))
        buffer[:count] = octets[:count]
        framer.add_received(count)
        while (message := framer.next_message()) is not None:
            yield bytes(message)
        octets = octets[count:]


@asynccontextmanager
async def provided(
    name: str = SERVICE, tls: ssl.SSLContext | None = None, **options: Any
) -> AsyncIterator[Provider]:
    """A provider of the test service on a free port of loopback."""
    provider = Provider(SPECIFICATION, name, **options)
    await provider.start(tls=tls)
    try:
        yield provider
    finally:
        await provider.close()


@asynccontextmanager
async def connected(provider: Provider, **options: Any) -> AsyncIterator[Consumer]:
    """A consumer of a provider."""
    consumer = await Consumer.connect(SPECIFICATION, provider.uri, **options)
    try:
        yield consumer
    finally:
        await consumer.close()
