"""Agents on real sockets or attached to ION, two of them joined; what is between them can fail."""

import asyncio
import random
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from enum import Enum
from pathlib import Path
from typing import Protocol, assert_never

from adapters.bundle.agent import BundleAgent, Delivery
from adapters.bundle.agent_settings import make_agent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.links.contact import ContactPlan
from adapters.bundle.node.database import Limits, Synchronous
from adapters.bundle.node.reporting import Notice
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
from tests.bundle.ion_node import IonNodes, ion_nodes
from tests.support.ports import free_udp_ports

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


ONE, TWO = Ipn(1, 1), Ipn(2, 1)
NO_LIMITS: Mapping[int, Limits] = {}


class Kind(Enum):
    """What carries."""

    EMBEDDED = "embedded"
    ION = "ion"
    ION_WHOLE = "ion, whole"


ATTACHED_BY_PAYLOAD = (Kind.ION,)
CONFIRMING = (Kind.EMBEDDED, Kind.ION_WHOLE)


class Sky(Protocol):
    """What is between the nodes."""

    async def darken(self) -> None:
        """Let nothing through."""
        ...

    async def clear(self) -> None:
        """Let everything through."""
        ...

    async def repeat(self) -> None:
        """Bring everything twice from now on."""
        ...


class World:
    """Makes agents; one made for the same node again goes on with its store."""

    def __init__(self, folder: Path, sky: Sky, make: Callable[[int], BundleAgent]) -> None:
        self.folder, self.sky, self._make = folder, sky, make

    @asynccontextmanager
    async def agent(self, number: int) -> AsyncIterator[Running]:
        """Have a node's agent open for the time of a with."""
        running = Running(self._make(number))
        await running.agent.open(running.notices.append)
        try:
            yield running
        finally:
            await running.agent.close()

    @asynccontextmanager
    async def both(self) -> AsyncIterator[tuple[Running, Running]]:
        async with self.agent(1) as one, self.agent(2) as two:
            yield one, two


@asynccontextmanager
async def world(
    kind: Kind, folder: Path, limits: Mapping[int, Limits] = NO_LIMITS
) -> AsyncIterator[World]:
    """Have what carries for the time of a with; some stores may be small."""

    def attached(daemon: Callable[[int], IonSettings]) -> Callable[[int], BundleAgent]:
        def make(number: int) -> BundleAgent:
            settings = daemon(number)
            other = Ipn(3 - number, 1)
            node = node_of(number, DaemonLink(other, settings.whole), limits.get(number))
            return make_agent(node, folder / f"{number}.db", settings, synchronous=Synchronous.OFF)

        return make

    match kind:
        case Kind.EMBEDDED:
            sky = _Proxies()
            ports = await sky.open()
            try:
                yield World(
                    folder, sky, lambda number: _embedded(folder, number, sky, ports, limits)
                )
            finally:
                await sky.close()
        case Kind.ION | Kind.ION_WHOLE:
            ion = IonSettings(whole=kind is Kind.ION_WHOLE, answer_s=2.0)
            async with ion_nodes(folder, 1, 2) as nodes:
                yield World(folder, _Ion(nodes), attached(lambda _: ion))
        case _:
            assert_never(kind)


def node_of(number: int, link: AnyLink, limits: Limits | None = None) -> NodeSettings:
    """Return the settings of a node whose only neighbour is the other."""
    own = Ipn(number, 1)
    neighbour = Neighbour(Ipn(3 - number, 0), link)
    return NodeSettings(own, (own,), (neighbour,), limits=limits or Limits())


def _embedded(
    folder: Path,
    number: int,
    sky: "_Proxies",
    ports: dict[int, Address],
    limits: Mapping[int, Limits],
) -> BundleAgent:
    link = LtpLink(ports[3 - number], answer_s=0.1)
    listen = Listen(ltp=sky.agents[number])
    return make_agent(
        node_of(number, link, limits.get(number)),
        folder / f"{number}.db",
        listen=listen,
        synchronous=Synchronous.OFF,
    )


class _Proxies:
    """The sky of embedded agents: a proxy in front of each."""

    def __init__(self) -> None:
        self._proxies = {number: Proxy(random.Random(number), 0.0, 0.0) for number in (1, 2)}
        ports = free_udp_ports(2)
        self.agents = {number: Address(HERE, ports[number - 1]) for number in (1, 2)}

    async def open(self) -> dict[int, Address]:
        """Return where the proxies in front of the agents are."""
        for number, proxy in self._proxies.items():
            proxy.target = self.agents[number]
        return {number: await proxy.open() for number, proxy in self._proxies.items()}

    async def close(self) -> None:
        for proxy in self._proxies.values():
            await proxy.close()

    async def darken(self) -> None:
        for proxy in self._proxies.values():
            proxy.dark = True

    async def clear(self) -> None:
        for proxy in self._proxies.values():
            proxy.dark = False

    async def repeat(self) -> None:
        for proxy in self._proxies.values():
            proxy.duplicate = 1.0


class _Ion:
    """The sky of attached agents, where ION has no room while it is dark."""

    def __init__(self, nodes: IonNodes) -> None:
        self._nodes = nodes

    async def darken(self) -> None:
        for number in (1, 2):
            await self._nodes.change(number, full=True)

    async def clear(self) -> None:
        for number in (1, 2):
            await self._nodes.change(number, full=False)

    async def repeat(self) -> None:
        for number in (1, 2):
            await self._nodes.change(number, repeats=1)


QUICK = IonSettings(answer_s=1.5, look_s=0.1)
PATIENT = IonSettings(answer_s=20.0)


@asynccontextmanager
async def attached(
    folder: Path, number: int, settings: IonSettings = PATIENT
) -> AsyncIterator[Running]:
    """Have an agent attached to a node of ION for the time of a with."""
    node = node_of(number, DaemonLink(Ipn(3 - number, 1), settings.whole))
    running = Running(make_agent(node, folder / f"{number}.db", settings))
    await running.agent.open(running.notices.append)
    try:
        yield running
    finally:
        await running.agent.close()


def bridge_of(nodes: IonNodes, eid: str) -> int:
    """Return the process that has an endpoint open."""
    return max(handle.pid for handle in nodes.handles.values() if handle.eid == eid)


async def gone(pid: int) -> None:
    async with asyncio.timeout(LIMIT_S):
        while Path(f"/proc/{pid}/stat").exists() and ") Z " not in stat_of(pid):
            await asyncio.sleep(0.02)


def stat_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ") Z "
