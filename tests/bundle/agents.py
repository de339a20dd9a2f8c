"""Embedded agents on real sockets, and a proxy that spoils what is between them."""

import asyncio
import random
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from adapters.bundle.agent import BundleAgent, Delivery
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.links.contact import ContactPlan
from adapters.bundle.node.database import Limits, Synchronous
from adapters.bundle.node.reporting import Notice
from adapters.bundle.node.settings import (
    Address,
    AnyLink,
    Listen,
    Neighbour,
    NodeSettings,
)

HERE = "127.0.0.1"
ANY = Address(HERE, 0)
LIMIT_S = 60.0


def settings_of(number: int, other: int, link: AnyLink, **others: object) -> NodeSettings:
    return NodeSettings(
        Ipn(number, 1),
        (Ipn(number, 1),),
        (Neighbour(Ipn(other, 0), link),),
        **others,  # type: ignore[arg-type]
    )


class Running:
    """An open agent and what it told."""

    def __init__(self, agent: BundleAgent) -> None:
        self.agent = agent
        self.notices: list[Notice] = []

    async def take(self, count: int) -> list[bytes]:
        """Receive so many units."""
        taken: list[bytes] = []
        async with asyncio.timeout(LIMIT_S):
            while len(taken) < count:
                async with self.agent.receive() as delivery:
                    taken.append(delivery.payload)
        return taken

    async def take_one(self) -> Delivery:
        async with asyncio.timeout(LIMIT_S), self.agent.receive() as delivery:
            return delivery

    async def until(self, true: Callable[[], bool]) -> None:
        async with asyncio.timeout(LIMIT_S):
            while not true():
                await asyncio.sleep(0.02)


@asynccontextmanager
async def running(
    folder: Path,
    number: int,
    other: int,
    link: AnyLink,
    listen: Listen,
    *,
    plan: ContactPlan | None = None,
    limits: Limits | None = None,
    **others: object,
) -> AsyncIterator[Running]:
    """Open an agent for the time of a with."""
    agent = BundleAgent(
        settings_of(number, other, link, limits=limits or Limits(), **others),
        folder / f"{number}.db",
        listen,
        plan,
        synchronous=Synchronous.OFF,
    )
    run = Running(agent)
    port: BundleAgent = agent
    await port.open(run.notices.append)
    try:
        yield run
    finally:
        await agent.close()


def port_of(address: Address | None) -> Address:
    assert address is not None
    return address


class Proxy(asyncio.DatagramProtocol):
    """Stands in front of an LTP agent and spoils what comes to it."""

    def __init__(self, chance: random.Random, loss: float, duplicate: float) -> None:
        self.chance, self.loss, self.duplicate = chance, loss, duplicate
        self.dark = False
        self.target: Address | None = None
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> Address:
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: self, local_addr=(HERE, 0)
        )
        self._transport = transport
        return Address(*transport.get_extra_info("sockname")[:2])

    async def close(self) -> None:
        if self._transport is not None:
            self._transport.close()
            await asyncio.sleep(0)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        for _ in range(2 if self.chance.random() < self.duplicate else 1):
            if not self.dark and self.chance.random() >= self.loss:
                delay_s = self.chance.uniform(0.0, 0.02)
                asyncio.get_running_loop().call_later(delay_s, self._pass_on, data)

    def _pass_on(self, data: bytes) -> None:
        if self._transport is not None and self.target is not None:
            self._transport.sendto(data, (self.target.host, self.target.port))


async def send_all(run: Running, destination: Ipn, payloads: list[bytes]) -> None:
    await asyncio.gather(*(run.agent.send(destination, payload) for payload in payloads))


def payloads_of(count: int) -> list[bytes]:
    return [b"%06d" % number for number in range(count)]
