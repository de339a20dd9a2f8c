"""Two nodes, ipn:1.1 and ipn:2.1, behind each of the ways; what is between them can fail."""

import random
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from enum import Enum
from pathlib import Path
from typing import Protocol, assert_never

from adapters.bundle.agent import BundleAgent
from adapters.bundle.agent_settings import make_agent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.database import Limits, Synchronous
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
from tests.bundle.agents import HERE, Proxy, Running
from tests.bundle.ion_node import IonNodes, ion_nodes
from tests.support.ports import free_udp_ports

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
