"""NASA ION started again and again: nothing is lost, and no contact shown where there is none.

Needs a real ION (`tests/bundle/ion_live.py`), and no other on this machine, whose memory it would
remove: `python -m tests.stress.ion_restarts neighbour`.
"""

import asyncio
import contextlib
import logging
import tempfile
import time
from argparse import ArgumentParser
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from adapters.bundle import Address, BundleAgent, Ipn, Listen, LtpLink, Neighbour, NodeSettings
from adapters.bundle.node.settings import DaemonLink, IonSettings
from tests.bundle.ion_live import PYTHON, IonNode, missing
from tests.bundle.worlds import HERE, Running, opened
from tests.support.ports import free_udp_ports

ION, OURS = Ipn(1, 1), Ipn(2, 1)
PATIENCE_S: Final = 120.0
SAMPLE_S: Final = 0.1
DOWN_S: Final = 3.0


@dataclass
class Outcome:
    """What a number of restarts has shown.

    Attributes:
        missing: payloads that did not arrive.
        falsely_s: for how long contact was shown at a stretch while ION was down, at most.
        back_s: how long after the start of ION everything of that life was there.
    """

    sent: int = 0
    missing: set[bytes] = field(default_factory=set)
    falsely_s: float = 0.0
    back_s: list[float] = field(default_factory=list)


class Exchange:
    """What was sent to an agent, and what it has received; at least once is enough, twice is not.

    Attributes:
        twice: how many came more than once.
    """

    def __init__(self, receiver: Running) -> None:
        self.got: set[bytes] = set()
        self.twice = 0
        self._task = asyncio.create_task(self._take(receiver))

    async def _take(self, receiver: Running) -> None:
        while True:
            async with receiver.agent.receive() as delivery:
                payload = delivery.payload.rstrip(b"\0")
                self.twice += payload in self.got
                self.got.add(payload)

    async def has(self, payloads: set[bytes]) -> set[bytes]:
        """Wait until all are there; return those that are not."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE_S):
                while not payloads <= self.got:
                    await asyncio.sleep(SAMPLE_S)
        return payloads - self.got

    async def close(self) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)


class Watch:
    """Samples whether contact is shown while ION is down."""

    def __init__(self, running: Running) -> None:
        self.down, self.max_s = False, 0.0
        self._running, self._begun_s = running, 0.0
        self._task = asyncio.create_task(self._poll())

    async def _poll(self) -> None:
        while True:
            contact = self._running.agent.health().neighbours[0].contact
            now_s = time.monotonic()
            if not (self.down and contact):
                self._begun_s = now_s
            self.max_s = max(self.max_s, now_s - self._begun_s)
            await asyncio.sleep(SAMPLE_S)

    async def close(self) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)


@asynccontextmanager
async def embedded(folder: Path, port: int, ion_port: int) -> AsyncIterator[Running]:
    """Have our agent, node 2, with LTP to ION."""
    link = LtpLink(Address(HERE, ion_port), answer_s=1.0, confirm_after_s=5.0)
    settings = NodeSettings(OURS, (OURS,), (Neighbour(Ipn(1, 0), link),))
    agent = BundleAgent(settings, folder / "ours.db", listen=Listen(ltp=Address(HERE, port)))
    async with opened(agent) as running:
        yield running


def attached(folder: Path, node: IonNode) -> contextlib.AbstractAsyncContextManager[Running]:
    """Have an agent attached to ION."""
    settings = NodeSettings(ION, (ION,), (Neighbour(Ipn(2, 0), DaemonLink(OURS)),))
    ion = IonSettings(python=PYTHON, node_list=str(node.list))
    return opened(BundleAgent(settings, folder / "attached.db", daemon=ion))


async def end(node: IonNode, durable: bool) -> None:
    """Cut the power; a database that is to be kept gets its daemons stopped before.

    ION 4.1 does not get over a power cut in the middle of a transaction: ionadmin hangs.
    """
    if durable:
        await node.stop_daemons()
    await node.cut_power()


async def as_neighbour(folder: Path, restarts: int, each: int, durable: bool) -> Outcome:
    """Restart ION as the LTP neighbour of our agent; each life sends some both ways."""
    outcome = Outcome()
    ports = free_udp_ports(2)
    node = IonNode(folder / "nodes", 1, ports[0], {2: ports[1]}, durable)
    node.write()
    async with embedded(folder, ports[1], ports[0]) as ours:
        exchange = Exchange(ours)
        for run in range(restarts + 1):
            down = {b"down %d-%d." % (run, number) for number in range(each)}
            up = [b"up %d-%d." % (run, number) for number in range(each)]
            for text in up:  # while there is no ION
                await ours.agent.send(Ipn(1, 2), text, confirm=True)
            await node.start()
            started_s = time.monotonic()
            async with node.sink(2) as printed:
                typed = "".join(f"{text.decode()}\n" for text in sorted(down))
                await node.run("bpsource", str(OURS), limit_s=PATIENCE_S, typed=typed)
                outcome.missing |= await exchange.has(down)
                outcome.missing |= await printed_there(printed, up)
                outcome.back_s.append(time.monotonic() - started_s)
                outcome.sent += 2 * each
                await end(node, durable)
        await exchange.close()
    return outcome


async def printed_there(printed: Path, texts: list[bytes]) -> set[bytes]:
    """Wait until bpsink has printed all; return what it has not."""
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        there = printed.read_bytes()
        missing = {text for text in texts if text not in there}
        if not missing or time.monotonic() > deadline_s:
            return missing
        await asyncio.sleep(SAMPLE_S)


async def as_daemon(folder: Path, restarts: int, each: int, durable: bool) -> Outcome:
    """Restart ION below an attached agent of ours; both ends send while it is down, and after."""
    outcome = Outcome()
    ports = free_udp_ports(2)
    node = IonNode(folder / "nodes", 1, ports[0], {2: ports[1]}, durable)
    node.write()
    await node.start()
    async with attached(folder, node) as near, embedded(folder, ports[1], ports[0]) as far:
        to_far, to_near, watch = Exchange(far), Exchange(near), Watch(near)
        for run in range(restarts):
            texts = [b"%d-%d" % (run, number) for number in range(each)]
            await end(node, durable)
            watch.down = True
            await send_both(near, far, texts[: each // 2])
            await asyncio.sleep(DOWN_S)
            watch.down = False
            await node.start()
            started_s = time.monotonic()
            await send_both(near, far, texts[each // 2 :])
            outcome.missing |= await to_far.has({b"out " + text for text in texts})
            outcome.missing |= await to_near.has({b"in " + text for text in texts})
            outcome.sent += 2 * each
            outcome.back_s.append(time.monotonic() - started_s)
        outcome.falsely_s = watch.max_s
        for running in (to_far, to_near, watch):
            await running.close()
    await end(node, durable)
    return outcome


async def send_both(near: Running, far: Running, texts: list[bytes]) -> None:
    for text in texts:
        await near.agent.send(OURS, b"out " + text)
        await far.agent.send(ION, b"in " + text)


ROLES: Final = {"neighbour": as_neighbour, "daemon": as_daemon}


def main() -> None:
    """Restart ION in a role, and say what came of it."""
    line = ArgumentParser(description=__doc__)
    line.add_argument("role", choices=ROLES)
    line.add_argument("--restarts", type=int, default=20)
    line.add_argument("--each", type=int, default=50, help="bundles a life, each way")
    line.add_argument("--durable", action="store_true", help="keep the database of ION")
    options = line.parse_args()
    if why := missing():
        raise SystemExit(why)
    logging.basicConfig(level="WARNING", format="%(message)s")
    with tempfile.TemporaryDirectory() as folder:
        measure = ROLES[options.role](Path(folder), options.restarts, options.each, options.durable)
        outcome = asyncio.run(measure)
    print(
        f"{options.role}, database {'kept' if options.durable else 'made anew'}:"
        f" {options.restarts} restarts, {len(outcome.missing)} of {outcome.sent} lost,"
        f" contact shown falsely for {outcome.falsely_s:.1f} s at most,"
        f" complete {max(outcome.back_s):.1f} s after the start at most"
    )


if __name__ == "__main__":
    main()
