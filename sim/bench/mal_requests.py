"""Round trips of a REQUEST, beside a bare echo of the same octets."""

import asyncio
import time
from typing import Final

from adapters.mal.consumer import Consumer
from adapters.mal.message import Header, encode_message
from adapters.mal.specification import Stage
from adapters.mrs.specification import mrs_specification
from sim.bench.figures import Figure, quantile

SERVICE: Final = "MotionControl"
OPERATION: Final = "getPose"
WARM_UP: Final = 100
AT_ONCE: Final = 16
US: Final = 1e6


async def requests(uri: str, echo_port: int, samples: int) -> list[Figure]:
    """Return rate and latency of both, taken in turn, one after the other."""
    consumer = await Consumer.connect(mrs_specification(), uri, "bench")
    reader, writer = await asyncio.open_connection("127.0.0.1", echo_port)
    message = _message(uri)

    async def request() -> float:
        began_s = time.perf_counter()
        await consumer.request(SERVICE, OPERATION)
        return time.perf_counter() - began_s

    async def echo() -> float:
        began_s = time.perf_counter()
        writer.write(message)
        await reader.readexactly(len(message))
        return time.perf_counter() - began_s

    requests_s, echoes_s = [], []
    for sample in range(WARM_UP + samples):
        taken = await request(), await echo()
        if sample >= WARM_UP:
            requests_s.append(taken[0])
            echoes_s.append(taken[1])
    crowd_per_s = await _crowd(consumer, samples)
    await consumer.close()
    writer.close()
    beside = f"{samples} getPose and bare echoes of as many octets, in turn"
    return [
        Figure("REQUEST, one by one", samples / sum(requests_s), "1/s", beside),
        Figure("echo, one by one", samples / sum(echoes_s), "1/s", beside),
        Figure("REQUEST, median", US * quantile(requests_s, 0.5), "µs", beside),
        Figure("echo, median", US * quantile(echoes_s, 0.5), "µs", beside),
        Figure("REQUEST, p99", US * quantile(requests_s, 0.99), "µs", beside),
        Figure("echo, p99", US * quantile(echoes_s, 0.99), "µs", beside),
        Figure(f"REQUEST, {AT_ONCE} at a time", crowd_per_s, "1/s", "over one connection"),
    ]


async def _crowd(consumer: Consumer, samples: int) -> float:
    async def ask() -> None:
        for _ in range(samples // AT_ONCE):
            await consumer.request(SERVICE, OPERATION)

    began_s = time.perf_counter()
    await asyncio.gather(*(ask() for _ in range(AT_ONCE)))
    return samples // AT_ONCE * AT_ONCE / (time.perf_counter() - began_s)


def _message(uri: str) -> bytes:
    operation = mrs_specification().operation(SERVICE, OPERATION)
    from_uri = "maltcp://127.0.0.1:40000/bench"
    return encode_message(
        Header.of(operation, Stage.REQUEST, 1, from_uri, uri, time.time_ns()), b""
    )
