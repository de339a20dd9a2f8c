"""Agents on real sockets or attached to ION, two of them joined; what is between them can fail."""

import asyncio
import random
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from enum import Enum
from pathlib import Path
from typing import Any

from adapters.bundle.agent import BundleAgent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.database import StoreLimits
from adapters.bundle.node.reporting import DeliveryNotice
from adapters.bundle.node.settings import (
    Address,
    AnyLink,
    DaemonLink,
    IonSettings,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
)
from adapters.bundle.node.store import Delivery
from tests.bundle.ion_node import IonNodes, ion_nodes
from tests.support.ports import free_udp_ports
from tests.support.unsynced import UNSYNCED

HERE = "127.0.0.1"
ANY = Address(HERE, 0)
LIMIT_S = 60.0


def settings_of(number: int, other: int, link: AnyLink, **others: object) -> NodeSettings:
    neighbours = (Neighbour(Ipn(other, 0), link),)
    return NodeSettings(Ipn(number, 1), (Ipn(number, 1),), neighbours, **others)  # type: ignore[arg-type]


class Running:
    """An open agent and what it told."""

    def __init__(self, agent: BundleAgent) -> None:
        self.agent = agent
        self.notices: list[DeliveryNotice] = []

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
async def opened(agent: BundleAgent) -> AsyncIterator[Running]:
    """Have an agent open for the time of a with."""
    running = Running(agent)
    await agent.open(running.notices.append)
    try:
        yield running
    finally:
        await agent.close()


def running(
    folder: Path, number: int, other: int, link: AnyLink, listen: Listen
) -> AbstractAsyncContextManager[Running]:
    """Open an agent with a link of its own."""
    settings = settings_of(number, other, link)
    path = folder / f"{number}.db"
    return opened(BundleAgent(settings, path, listen, system=UNSYNCED))


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


ONE, TWO = Ipn(1, 1), Ipn(2, 1)
NO_LIMITS: Mapping[int, StoreLimits] = {}


class Kind(Enum):
    """What carries."""

    EMBEDDED = "embedded"
    ION = "ion"
    ION_WHOLE = "ion, whole"


ATTACHED_BY_PAYLOAD = (Kind.ION,)
CONFIRMING = (Kind.EMBEDDED, Kind.ION_WHOLE)


class World(ABC):
    """Makes agents, each with its store; one made for the same node again goes on with it."""

    def __init__(self, folder: Path, limits: Mapping[int, StoreLimits]) -> None:
        self._folder, self._limits = folder, limits

    def agent(self, number: int) -> AbstractAsyncContextManager[Running]:
        """Have a node's agent open for the time of a with."""
        link, others = self._link(number)
        limits = self._limits.get(number, StoreLimits())
        settings = settings_of(number, 3 - number, link, limits=limits)
        path = self._folder / f"{number}.db"
        return opened(BundleAgent(settings, path, system=UNSYNCED, **others))

    @asynccontextmanager
    async def both(self) -> AsyncIterator[tuple[Running, Running]]:
        async with self.agent(1) as one, self.agent(2) as two:
            yield one, two

    @abstractmethod
    def _link(self, number: int) -> tuple[AnyLink, dict[str, Any]]:
        """Return the link to the other node, and what else its agent is made with."""

    @abstractmethod
    async def darken(self, dark: bool = True) -> None:
        """Let nothing through, or everything again."""

    @abstractmethod
    async def repeat(self) -> None:
        """Bring everything twice from now on."""


class _Proxies(World):
    """Agents with LTP links, a proxy in front of each."""

    async def open(self) -> None:
        self._proxies = {number: Proxy(random.Random(number), 0.0, 0.0) for number in (1, 2)}
        for proxy, port in zip(self._proxies.values(), free_udp_ports(2), strict=True):
            proxy.target = Address(HERE, port)
        self._fronts = {number: await proxy.open() for number, proxy in self._proxies.items()}

    async def close(self) -> None:
        for proxy in self._proxies.values():
            await proxy.close()

    def _link(self, number: int) -> tuple[AnyLink, dict[str, Any]]:
        link = LtpLink(self._fronts[3 - number], answer_s=0.1)
        return link, {"listen": Listen(ltp=self._proxies[number].target)}

    async def darken(self, dark: bool = True) -> None:
        for proxy in self._proxies.values():
            proxy.dark = dark

    async def repeat(self) -> None:
        for proxy in self._proxies.values():
            proxy.duplicate = 1.0


class _Ion(World):
    """Attached agents; ION has no room while it is dark."""

    def __init__(
        self, folder: Path, limits: Mapping[int, StoreLimits], nodes: IonNodes, whole: bool
    ) -> None:
        super().__init__(folder, limits)
        self._nodes, self._settings = nodes, IonSettings(whole=whole, answer_s=2.0)

    def _link(self, number: int) -> tuple[AnyLink, dict[str, Any]]:
        return DaemonLink(Ipn(3 - number, 1), self._settings.whole), {"daemon": self._settings}

    async def darken(self, dark: bool = True) -> None:
        for number in (1, 2):
            await self._nodes.change(number, full=dark)

    async def repeat(self) -> None:
        for number in (1, 2):
            await self._nodes.change(number, repeats=1)


@asynccontextmanager
async def world(
    kind: Kind, folder: Path, limits: Mapping[int, StoreLimits] = NO_LIMITS
) -> AsyncIterator[World]:
    """Have what carries for the time of a with; some stores may be small."""
    if kind is Kind.EMBEDDED:
        proxies = _Proxies(folder, limits)
        await proxies.open()
        try:
            yield proxies
        finally:
            await proxies.close()
    else:
        async with ion_nodes(folder, 1, 2) as nodes:
            yield _Ion(folder, limits, nodes, whole=kind is Kind.ION_WHOLE)


QUICK = IonSettings(answer_s=1.5, poll_period_s=0.1)
PATIENT = IonSettings(answer_s=20.0)


def attached(
    folder: Path, number: int, settings: IonSettings = PATIENT
) -> AbstractAsyncContextManager[Running]:
    """Have an agent attached to a node of ION for the time of a with."""
    node = settings_of(number, 3 - number, DaemonLink(Ipn(3 - number, 1), settings.whole))
    return opened(BundleAgent(node, folder / f"{number}.db", daemon=settings))


def bridge_of(nodes: IonNodes, eid: str) -> int:
    """Return the process that has an endpoint open."""
    return max(handle.pid for handle in nodes.handles.values() if handle.eid == eid)


async def ended(pid: int) -> None:
    async with asyncio.timeout(LIMIT_S):
        while Path(f"/proc/{pid}/stat").exists() and ") Z " not in stat_of(pid):
            await asyncio.sleep(0.02)


def stat_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ") Z "
