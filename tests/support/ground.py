"""What the ground asks of a rover that runs as a process, each time on a link of its own."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

from adapters.mrs.ground import CommandOutcome, MrsClient
from adapters.mrs.transport import CLEAR, TransportSettings
from executive.commands import Request

LIMIT_S = 120.0
T = TypeVar("T")


def call_ground(
    uri: str, question: Callable[[MrsClient], Awaitable[T]], terms: TransportSettings = CLEAR
) -> T:
    """Connect, ask, hang up; return the answer."""

    async def session() -> T:
        async with await MrsClient.connect(uri, terms=terms) as client:
            return await question(client)

    return asyncio.run(asyncio.wait_for(session(), LIMIT_S))


def carry_out(
    uri: str, *requests: Request, terms: TransportSettings = CLEAR
) -> list[CommandOutcome]:
    """Send requests one after the other, each when the one before has ended."""

    async def send(client: MrsClient) -> list[CommandOutcome]:
        return [await client.run(client.command(request)) for request in requests]

    return call_ground(uri, send, terms)


async def located(client: MrsClient) -> None:
    """Wait until the executive knows where the rover is."""
    async for value in await client.telemetry():
        if value.name == "POS_X" and value.value is not None:
            return


def until_located(uri: str) -> None:
    call_ground(uri, located)
