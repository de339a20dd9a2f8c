"""Twelve parameters at 10 Hz to subscribers that each have a connection of their own."""

import asyncio
import time
from typing import Final

import psutil

from adapters.mal.consumer import Consumer
from adapters.mal.mal_area import Subscription, UpdateHeader
from adapters.mrs.specification import mrs_specification
from adapters.mrs.types import ParameterValue
from executive.parameters import Parameter
from sim.bench.figures import Figure, Goal, quantile

SUBSCRIBERS: Final = (1, 10, 50)
SETTLE_S: Final = 0.5
MS: Final = 1000.0


class Listener:
    """One subscriber, and what it got."""

    def __init__(self) -> None:
        """Have heard nothing yet."""
        self.heard: set[tuple[int, str]] = set()
        self.delays_s: list[float] = []

    def hear(self, _: UpdateHeader, value: ParameterValue) -> None:
        """Take an update."""
        assert value.value is not None
        self.delays_s.append((time.monotonic_ns() - value.timestamp) / 1e9)
        self.heard.add((int(value.value.value), value.name))


async def fan_out(uri: str, provider_pid: int, duration_s: float) -> list[Figure]:
    """Return latency, losses and the provider's CPU for each number of subscribers."""
    figures = []
    for count in SUBSCRIBERS:
        figures += await _to(count, uri, psutil.Process(provider_pid), duration_s)
    return figures


async def _to(count: int, uri: str, provider: psutil.Process, duration_s: float) -> list[Figure]:
    consumers = [await Consumer.connect(mrs_specification(), uri) for _ in range(count)]
    listeners = [Listener() for _ in consumers]
    for consumer, listener in zip(consumers, listeners, strict=True):
        subscription = Subscription(subscriptionId="bench")
        await consumer.subscribe("Monitoring", "monitorValue", subscription, listener.hear)
    await asyncio.sleep(SETTLE_S)
    for listener in listeners:
        listener.delays_s.clear()
        listener.heard.clear()
    began_s, before_s = time.monotonic(), _cpu_s(provider)
    await asyncio.sleep(duration_s)
    cpu = 100 * (_cpu_s(provider) - before_s) / (time.monotonic() - began_s)
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
    rounds = [[number for number, _ in listener.heard] for listener in listeners]
    whole = {
        (number, parameter.value)
        for number in range(max(map(min, rounds)) + 1, min(map(max, rounds)))
        for parameter in Parameter
    }
    return sum(len(whole - listener.heard) for listener in listeners)


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
