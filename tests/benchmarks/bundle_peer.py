"""A bundle agent as a process: sends, or receives and counts; what `bundle.py` measures.

It prints a line of JSON for each thing that happened, with the time it happened.
"""

import argparse
import asyncio
import json
import resource
import time
from pathlib import Path
from typing import Final

from adapters.bundle import (
    Address,
    BundleAgent,
    ContactOverride,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
)
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.database import BundleDatabase
from adapters.bundle.node.node import BundleNode

POLL_S: Final = 0.01
_TOGETHER: Final = 256
_SENDER, _RECEIVER = 1, 2
_HOST = "127.0.0.1"


def emit(what: str, **values: object) -> None:
    print(json.dumps({"what": what, "time_s": time.time(), **values}), flush=True)


def resident_mb() -> float:
    """Return what this process holds in memory now; no library for that is part of it."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def settings_of(own: int, other: int, port: int) -> NodeSettings:
    neighbour = Neighbour(Ipn(other, 0), LtpLink(Address(_HOST, port)))
    return NodeSettings(Ipn(own, 1), (Ipn(own, 1),), (neighbour,))


async def opened(own: int, other: int, options: argparse.Namespace) -> BundleAgent:
    """Return the agent of a node, started."""
    listen = Listen(ltp=Address(_HOST, options.listen))
    agent = BundleAgent(settings_of(own, other, options.peer), options.store, listen)
    await agent.open(lambda _: None)
    return agent


async def send(options: argparse.Namespace) -> None:
    """Send units; in the dark at first, if asked, until a file is there."""
    agent, contact = await opened(_SENDER, _RECEIVER, options), options.dark_until
    if contact is not None:
        agent.override(Ipn(_RECEIVER, 0), ContactOverride.DOWN)
    waits_s: list[float] = []
    emit("begins", resident_mb=resident_mb())

    async def send_some(numbers: range) -> None:
        for number in numbers:
            began_s = time.perf_counter()
            await agent.send(Ipn(_RECEIVER, 1), b"%d" % number + b"." * (options.octets - 8))
            waits_s.append(time.perf_counter() - began_s)

    await asyncio.gather(*(send_some(range(n, options.count, _TOGETHER)) for n in range(_TOGETHER)))
    waits_s.sort()
    emit(
        "all are on the disk",
        resident_mb=resident_mb(),
        median_ms=1000 * waits_s[len(waits_s) // 2],
        p99_ms=1000 * waits_s[len(waits_s) * 99 // 100],
    )
    if contact is not None:
        while not contact.exists():
            await asyncio.sleep(POLL_S)
        agent.override(Ipn(_RECEIVER, 0), ContactOverride.UP)
        emit("the link is up")
    while agent.health().queued:
        await asyncio.sleep(0.02)
    emit("all are handed on", resident_mb=resident_mb())
    await agent.close()


async def receive(options: argparse.Namespace) -> None:
    """Receive units and say when the first and the last came."""
    agent = await opened(_RECEIVER, _SENDER, options)
    emit("listens")
    numbers = set()
    for number in range(options.count):
        async with agent.receive() as delivery:
            numbers.add(delivery.payload)
        if not number:
            emit("the first came")
    emit("all came", different=len(numbers), resident_mb=resident_mb())
    await asyncio.sleep(1.0)
    await agent.close()


async def fill(options: argparse.Namespace) -> None:
    """Put units into a store that nobody serves."""
    database, settings = BundleDatabase(options.store), settings_of(_SENDER, _RECEIVER, 1)
    node = BundleNode(settings, database, lambda: int(1000 * time.time()), lambda _: None)
    for number in range(options.count):
        node.put(Ipn(_RECEIVER, 1), b"." * options.octets)
        if number % 1000 == 999:
            node.transaction.commit()
    node.transaction.commit()
    database.close()


async def start(options: argparse.Namespace) -> None:
    """Open an agent with what its store holds, in the dark, and say how long that took."""
    began_s = time.perf_counter()
    agent = await opened(_SENDER, _RECEIVER, options)
    queued = agent.health().queued
    took_s = time.perf_counter() - began_s
    await asyncio.sleep(2.0)
    emit("started", took_s=took_s, queued=queued, resident_mb=resident_mb())
    await agent.close()


_ROLES: Final = {each.__name__: each for each in (send, receive, fill, start)}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("role", choices=_ROLES)
    parser.add_argument("store", type=Path)
    parser.add_argument("--listen", type=int, default=0)
    parser.add_argument("--peer", type=int, default=9)
    parser.add_argument("--count", type=int, default=0)
    parser.add_argument("--octets", type=int, default=100)
    parser.add_argument("--dark-until", type=Path)
    options = parser.parse_args()
    asyncio.run(_ROLES[options.role](options))


if __name__ == "__main__":
    main()
