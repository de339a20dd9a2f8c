"""What the MAL stack costs and reaches on loopback, beside plain asyncio TCP."""

import asyncio
import time
from typing import Final

import psutil

from adapters.mal import (
    Consumer,
    Header,
    InteractionStage,
    Subscription,
    UpdateHeader,
    encode_message,
)
from adapters.mrs.spec import ParameterValue, mrs_specification
from executive.values.parameters import Parameter
from tests.benchmarks.mal_peers import CHUNK_OCTETS, FILE, TRANSFER_OCTETS
from tests.support.figures import Figure, Goal, cpu_s, quantile
from tests.support.victims import workplace

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
    async def query() -> None:
        for _ in range(samples // AT_ONCE):
            await consumer.request(SERVICE, OPERATION)

    began_s = time.perf_counter()
    await asyncio.gather(*(query() for _ in range(AT_ONCE)))
    return samples // AT_ONCE * AT_ONCE / (time.perf_counter() - began_s)


def _message(uri: str) -> bytes:
    operation = mrs_specification().operation(SERVICE, OPERATION)
    from_uri = "maltcp://127.0.0.1:40000/bench"
    return encode_message(
        Header.of(operation, InteractionStage.REQUEST, 1, from_uri, uri, time.time_ns()), b""
    )


SETTLE_S: Final = 0.5
MS: Final = 1000.0


class Listener:
    """One subscriber, and what it got."""

    def __init__(self) -> None:
        self.received: set[tuple[int, str]] = set()
        self.delays_s: list[float] = []

    def receive(self, _: UpdateHeader, value: ParameterValue) -> None:
        assert value.value is not None
        self.delays_s.append((time.monotonic_ns() - value.timestamp) / 1e9)
        self.received.add((int(value.value.value), value.name))


async def fan_out(uri: str, provider_pid: int, duration_s: float, maximum: int) -> list[Figure]:
    """Return latency, losses and the provider's CPU for 1, 10 and the most subscribers."""
    figures = []
    for count in sorted({1, min(10, maximum), maximum}):
        figures += await _to(count, uri, psutil.Process(provider_pid), duration_s)
    return figures


async def _to(count: int, uri: str, provider: psutil.Process, duration_s: float) -> list[Figure]:
    consumers = [await Consumer.connect(mrs_specification(), uri) for _ in range(count)]
    listeners = [Listener() for _ in consumers]
    for consumer, listener in zip(consumers, listeners, strict=True):
        subscription = Subscription(subscriptionId="bench")
        await consumer.subscribe("Monitoring", "monitorValue", subscription, listener.receive)
    await asyncio.sleep(SETTLE_S)
    for listener in listeners:
        listener.delays_s.clear()
        listener.received.clear()
    began_s, before_s = time.monotonic(), cpu_s(provider)
    await asyncio.sleep(duration_s)
    cpu = 100 * (cpu_s(provider) - before_s) / (time.monotonic() - began_s)
    await asyncio.gather(*(consumer.close() for consumer in consumers))
    delays_s = [delay_s for listener in listeners for delay_s in listener.delays_s]
    name, beside = f"NOTIFY to {count}", "12 parameters at 10 Hz, a connection each"
    return [
        Figure(f"{name}, CPU of the provider", cpu, "%", beside),
        Figure(f"{name}, median", MS * quantile(delays_s, 0.5), "ms", beside),
        Figure(f"{name}, p99", MS * quantile(delays_s, 0.99), "ms", beside),
        Figure(f"{name}, lost", _lost(listeners), "updates", beside, Goal(0)),
    ]


def _lost(listeners: list[Listener]) -> int:
    """Count what is missing of the rounds before and after which everybody heard something."""
    rounds = [[number for number, _ in listener.received] for listener in listeners]
    whole = {
        (number, parameter.value)
        for number in range(max(map(min, rounds)) + 1, min(map(max, rounds)))
        for parameter in Parameter
    }
    return sum(len(whole - listener.received) for listener in listeners)


MB: Final = 1e6
LEAST_RATIO: Final = 0.5


async def transfer(uri: str, source_port: int, transfers: int) -> list[Figure]:
    """Return the rates of both, taken in turn after one of each that is not counted."""
    consumer = await Consumer.connect(mrs_specification(), uri)
    reader, writer = await asyncio.open_connection("127.0.0.1", source_port)
    ours_s, theirs_s = [], []
    for _ in range(1 + transfers):
        ours_s.append(await _by_progress(consumer))
        theirs_s.append(await _by_tcp(reader, writer))
    await consumer.close()
    writer.close()
    ours, theirs = (
        TRANSFER_OCTETS / MB / quantile(taken_s[1:], 0.5) for taken_s in (ours_s, theirs_s)
    )
    beside = f"{transfers} times a file of 50 MB in chunks of 64 KiB, in turn; median"
    goal = Goal(LEAST_RATIO, at_least=True)
    return [
        Figure("transfer by PROGRESS", ours, "MB/s", beside),
        Figure("plain asyncio TCP", theirs, "MB/s", beside),
        Figure("PROGRESS over plain TCP", ours / theirs, "ratio", beside, goal),
    ]


async def _by_progress(consumer: Consumer) -> float:
    octets = 0
    began_s = time.perf_counter()
    async with consumer.progress(
        "FileTransfer", "retrieveFile", FILE, None, CHUNK_OCTETS
    ) as progress:
        async for (chunk,) in progress:
            octets += len(chunk.data)
    assert octets == TRANSFER_OCTETS
    return time.perf_counter() - began_s


async def _by_tcp(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> float:
    left = TRANSFER_OCTETS
    began_s = time.perf_counter()
    writer.write(b"\0")
    while left:
        octets = await reader.read(CHUNK_OCTETS)
        if not octets:
            raise ConnectionError("the source hung up")
        left -= len(octets)
    return time.perf_counter() - began_s


def measure(
    samples: int = 3000, transfers: int = 7, duration_s: float = 5.0, max_subscribers: int = 50
) -> list[Figure]:
    """Return the figures of requests, of notifications and of a transfer.

    Args:
        samples: how many requests and echoes, in turn.
        transfers: how many transfers each way, in turn.
        duration_s: how long notifications are taken, for each number of subscribers.
        max_subscribers: that there are at once.
    """
    with workplace() as workspace:
        files = workspace.folder / "files"
        provider = workspace.start("provider", "tests.benchmarks.mal_peers", "provider", files)
        echo = workspace.start("echo", "tests.benchmarks.mal_peers", "echo")
        source = workspace.start("source", "tests.benchmarks.mal_peers", "source", files / FILE)
        uri = f"maltcp://127.0.0.1:{provider.port()}/MRS"
        return [
            *asyncio.run(requests(uri, echo.port(), samples)),
            *asyncio.run(fan_out(uri, provider.child.pid, duration_s, max_subscribers)),
            *asyncio.run(transfer(uri, source.port(), transfers)),
        ]
