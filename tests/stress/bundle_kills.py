"""kill -9 of two bundle agents on real sockets: what `send` returned for arrives, and once.

`python -m tests.stress.bundle_kills` is one agent with its application: the sender writes down each
number that `send` returned for; the receiver each that it was given, once, as an application does
that keeps its own record.
"""

import asyncio
import sys
import time
from collections import Counter
from collections.abc import Callable
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from adapters.bundle import (
    Address,
    BundleAgent,
    IonSettings,
    Ipn,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
)
from adapters.bundle.node.settings import DaemonLink
from sim.processes import HOST
from tests.stress.findings import Findings, Log
from tests.stress.journal import Journal, read_journal
from tests.support.figures import Figure
from tests.support.ports import free_udp_ports
from tests.support.victims import Workplace, workplace

ION: Final = "ion"
LIMIT_S: Final = 60.0
POLL_S: Final = 0.02
ARRIVAL_POLL_S: Final = 0.5
"""Between two reads of whole records: what carries may run in this process, too."""
PAUSE_S: Final = 0.1
"""At most between what calls for a kill and the kill."""


@unique
class Fault(Enum):
    """What must not be."""

    LOST = "taken, and did not arrive"
    DOUBLED = "given twice"


def measure(kills: int, seed: int, log: Log, output: Path | None = None) -> list[Figure]:
    """Return how often a promise was broken where LTP carries."""
    one, two = free_udp_ports(2)
    with workplace(output) as workspace:
        taken, findings = kill_at_random(
            workspace, (f"{one}:{two}", f"{two}:{one}"), kills, seed, log
        )
    return [
        Figure("bundle kills: taken", taken, "bundles", f"{kills} kills"),
        *findings.figures("bundle kills", Fault, f"{kills} kills, seed {seed}"),
    ]


def kill_at_random(
    workspace: Workplace, carriers: tuple[str, str], kills: int, seed: int, log: Log
) -> tuple[int, Findings]:
    """Kill a sender and a receiver at random; return how much was taken, and what is wrong.

    Args:
        workspace: where their stores and records are.
        carriers: of each: ION, or the own port and the other's, of LTP.
        kills: how many.
        seed: of whom, and when.
        log: called with a line on each of the first faults.
    """
    random = Random(seed)
    sent, received = (workspace.folder / f"{role}.jsonl" for role in ("send", "receive"))
    victims = [
        workspace.start(role, "tests.stress.bundle_kills", role, workspace.folder, carrier)
        for role, carrier in zip(("send", "receive"), carriers, strict=True)
    ]

    def grow(path: Path) -> None:
        """Wait until a record has grown: the process runs and works."""
        size = _size(path)
        _until(lambda: _size(path) > size, f"{path.name} does not go on", workspace)

    for _ in range(kills):
        grow(sent)
        grow(received)
        time.sleep(random.uniform(0.0, PAUSE_S))
        random.choice(victims).restart()
    grow(sent)
    victims[0].child.kill()
    taken = {number for (number,) in read_journal(sent)}
    # The sender's store still holds what was not handed on: it goes on from there.
    victims[0].start()
    findings = Findings(log)
    try:
        _until(
            lambda: taken <= {number for _, number in read_journal(received)},
            "not all arrived",
            workspace,
            ARRIVAL_POLL_S,
        )
    except TimeoutError:
        for number in taken - {number for _, number in read_journal(received)}:
            findings.add(Fault.LOST, number)
    for identity, count in Counter(identity for identity, _ in read_journal(received)).items():
        if count > 1:
            findings.add(Fault.DOUBLED, identity)
    return len(taken), findings


def _until(
    done: Callable[[], bool], complaint: str, workspace: Workplace, poll_s: float = POLL_S
) -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while not done():
        workspace.check()
        if time.monotonic() > deadline_s:
            raise TimeoutError(complaint)
        time.sleep(poll_s)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def agent_of(role: str, folder: Path, carrier: str) -> BundleAgent:
    own, other = (1, 2) if role == "send" else (2, 1)
    link: DaemonLink | LtpLink
    listen = daemon = None
    if carrier == ION:
        link, daemon = DaemonLink(Ipn(other, 1), whole=True), IonSettings(whole=True)
    else:
        port, peer = map(int, carrier.split(":"))
        link = LtpLink(Address(HOST, peer), answer_s=0.1)
        listen = Listen(ltp=Address(HOST, port))
    neighbour = Neighbour(Ipn(other, 0), link)
    settings = NodeSettings(Ipn(own, 1), (Ipn(own, 1),), (neighbour,))
    return BundleAgent(settings, folder / f"{role}.db", listen, daemon=daemon)


async def run(role: str, folder: Path, carrier: str) -> None:
    """Be one of the two until killed."""
    agent = agent_of(role, folder, carrier)
    await agent.open(lambda _: None)
    journal = Journal(folder / f"{role}.jsonl")
    if role == "send":
        await send(agent, journal)
    else:
        await receive(agent, journal)


async def send(agent: BundleAgent, journal: Journal) -> None:
    for number in range(len(journal.rows), 1_000_000):
        await agent.send(Ipn(2, 1), b"%d" % number)
        journal.write(number)
        await asyncio.sleep(0.001)


async def receive(agent: BundleAgent, journal: Journal) -> None:
    had = {tuple(row) for row in journal.rows}
    while True:
        async with agent.receive() as delivery:
            row = str(delivery.identity), int(delivery.payload)
            if row not in had:
                had.add(row)
                journal.write(*row)


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], Path(sys.argv[2]), sys.argv[3]))
