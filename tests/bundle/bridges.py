"""Agents attached to nodes of ION by bridges that are real processes, with a model of pyion."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from adapters.bundle.agent_settings import make_agent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.settings import DaemonLink, IonSettings
from tests.bundle.agents import LIMIT_S, Running
from tests.bundle.ion_node import IonNodes
from tests.bundle.worlds import node_of

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
