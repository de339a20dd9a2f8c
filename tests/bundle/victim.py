"""An agent with an application, as a process to be killed.

The sender writes down each number that `send` returned for; the receiver each that it was given,
once, as an application does that keeps its own record.
"""

import asyncio
import sys
from pathlib import Path
from typing import TextIO

from adapters.bundle.agent import BundleAgent
from adapters.bundle.agent_settings import make_agent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.settings import Address, DaemonLink, IonSettings, Listen, LtpLink
from tests.bundle.worlds import HERE, settings_of


def lines(path: Path) -> list[str]:
    """Return the whole lines of a file; the last may have been cut by a kill."""
    text = path.read_text() if path.exists() else ""
    return [line for line in text.splitlines(keepends=True) if line.endswith("\n")]


def agent_of(role: str, folder: Path, carrier: str) -> BundleAgent:
    """Return an agent over LTP, by the ports of both sides, or attached to a daemon."""
    own, other = (1, 2) if role == "send" else (2, 1)
    path = folder / f"{role}.db"
    if carrier == "ion":
        node = settings_of(own, other, DaemonLink(Ipn(other, 1), whole=True))
        return make_agent(node, path, IonSettings(whole=True))
    port, peer = map(int, carrier.split(":"))
    link = LtpLink(Address(HERE, peer), answer_s=0.1)
    return make_agent(settings_of(own, other, link), path, listen=Listen(ltp=Address(HERE, port)))


async def run(role: str, folder: Path, carrier: str) -> None:
    agent = agent_of(role, folder, carrier)
    await agent.open(lambda _: None)
    path = folder / role
    begun = lines(path)
    whole = path.with_suffix(".whole")
    whole.write_text("".join(begun))
    whole.replace(path)
    with path.open("a") as record:
        if role == "send":
            await send(agent, record, len(begun))
        else:
            await receive(agent, record, set(begun))


async def send(agent: BundleAgent, record: TextIO, begin: int) -> None:
    for number in range(begin, 1_000_000):
        await agent.send(settings_of(2, 1, LtpLink(Address(HERE, 9))).sender, b"%d" % number)
        record.write(f"{number}\n")
        record.flush()
        await asyncio.sleep(0.001)


async def receive(agent: BundleAgent, record: TextIO, had: set[str]) -> None:
    while True:
        async with agent.receive() as delivery:
            line = f"{delivery.identity} {delivery.payload.decode()}\n"
            if line not in had:
                had.add(line)
                record.write(line)
                record.flush()


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], Path(sys.argv[2]), sys.argv[3]))
