"""What 1000 hostile connections cost: memory, and the round trip of whoever was there first."""

import asyncio
import os
import resource
import sys
import time
from contextlib import suppress
from typing import Final

import psutil

from adapters.mal import Consumer, Header, InteractionStage, encode_message
from adapters.mrs.spec import mrs_specification
from tests.support.figures import Figure, Goal, quantile
from tests.support.victims import Victim, Workplace, workplace

SERVICE: Final = "MotionControl"
OPERATION: Final = "getPose"
MB: Final = 1e6
MS: Final = 1000.0
MAX_GROWTH_MB: Final = 20.0
MAX_P99_MS: Final = 50.0
POLITE: Final = 10
"""How far attackers, who would have a computer of their own, step back on this one."""
ATTACKS: Final = "attacks"
WARM_UP_S: Final = 1.0
SETTLE_S: Final = 3.0
PAUSE_S: Final = 0.01
AGAIN_S: Final = 1.0
"""After which an attacker that was hung up on comes again."""
MESSAGE_OCTETS: Final = 1 << 20


async def attack(port: int, count: int, kind: str) -> None:
    """Hold connections that send half a message, nothing at all, or requests without end."""
    os.nice(POLITE)
    _, maximum = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (maximum, maximum))
    operation = mrs_specification().operation(SERVICE, OPERATION)
    header = Header.of(
        operation, InteractionStage.REQUEST, 1, "maltcp://h:1/x", f"maltcp://h:{port}/MRS"
    )
    octets = {
        "half messages": encode_message(header, bytes(MESSAGE_OCTETS - 100))[: MESSAGE_OCTETS // 2],
        "silent": b"",
        "requests": 50 * encode_message(header, b""),
    }[kind]

    async def one() -> None:
        while True:
            with suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(octets)
                await writer.drain()
                while await reader.read(1 << 16):
                    if kind == "requests":
                        writer.write(octets)
                writer.close()
            await asyncio.sleep(AGAIN_S)

    print(ATTACKS, flush=True)
    await asyncio.gather(*(one() for _ in range(count)))


async def _round_trips_s(consumer: Consumer, duration_s: float) -> list[float]:
    taken_s, end_s = [], time.monotonic() + duration_s
    while time.monotonic() < end_s:
        began_s = time.perf_counter()
        await consumer.request(SERVICE, OPERATION)
        taken_s.append(time.perf_counter() - began_s)
        await asyncio.sleep(PAUSE_S)
    return taken_s


async def _under(
    kind: str, workspace: Workplace, provider: Victim, count: int, duration_s: float
) -> list[Figure]:
    process = psutil.Process(provider.child.pid)
    uri = f"maltcp://127.0.0.1:{provider.port()}/MRS"
    consumer = await Consumer.connect(mrs_specification(), uri, "first")
    await _round_trips_s(consumer, WARM_UP_S)
    before_mb = process.memory_info().rss / MB
    attackers = workspace.start(
        kind.replace(" ", "-"), "tests.benchmarks.hostile", provider.port(), count, kind, up=ATTACKS
    )
    attackers.wait()
    taken_s = await _round_trips_s(consumer, duration_s)
    during_mb = process.memory_info().rss / MB
    attackers.child.kill()
    await asyncio.sleep(SETTLE_S)
    after_mb = process.memory_info().rss / MB
    newcomer = await Consumer.connect(mrs_specification(), uri, "newcomer")
    await newcomer.request(SERVICE, OPERATION)
    await newcomer.close()
    await consumer.close()
    beside = f"{count} connections, {kind}; {len(taken_s)} round trips in {duration_s:g} s"
    median_ms, p99_ms = (MS * quantile(taken_s, ratio) for ratio in (0.5, 0.99))
    gained, bound = after_mb - before_mb, Goal(MAX_GROWTH_MB)
    return [
        Figure(f"{kind}: memory before", before_mb, "MB", beside),
        Figure(f"{kind}: memory while they are there", during_mb, "MB", beside),
        Figure(f"{kind}: memory gained when they are gone", gained, "MB", beside, bound),
        Figure(f"{kind}: round trip, median", median_ms, "ms", beside),
        Figure(f"{kind}: round trip, p99", p99_ms, "ms", beside, Goal(MAX_P99_MS)),
        Figure(f"{kind}: round trip, max", MS * max(taken_s), "ms", beside),
    ]


def measure(count: int, duration_s: float = 10.0) -> list[Figure]:
    """Return memory and round trips under each kind of attack, each on a provider of its own.

    Args:
        count: hostile connections.
        duration_s: how long they are there.
    """
    figures = []
    for kind in ("half messages", "silent", "requests"):
        with workplace() as workspace:
            provider = workspace.start(
                "provider", "tests.benchmarks.mal_peers", "provider", workspace.folder / "files"
            )
            figures += asyncio.run(_under(kind, workspace, provider, count, duration_s))
    return figures


if __name__ == "__main__":
    asyncio.run(attack(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]))
