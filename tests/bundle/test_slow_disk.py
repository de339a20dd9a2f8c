"""During a sync of the disk timers run and stops pass; other bundles wait, and none gets lost."""

import asyncio
import socket
import threading
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from adapters.bundle.agent import BundleAgent
from adapters.bundle.links.ltp_segment import decode_segment
from adapters.bundle.node.database import BundleDatabase
from adapters.bundle.node.node import BundleNode
from adapters.bundle.node.settings import Address, Listen, LtpLink, TcpclLink
from tests.bundle import nodes
from tests.bundle.nodes import START_UTC_MS, Clock
from tests.bundle.worlds import ANY, HERE, LIMIT_S, ONE, TWO, Running, opened, settings_of
from tests.support.ports import free_udp_ports
from tests.support.unsynced import UNSYNCED, HeldDisk, PowerLoss

STOP, ORDINARY = b"stop", b"ordinary"


def _ltp() -> dict[int, tuple[LtpLink, Listen]]:
    one, two = (Address(HERE, port) for port in free_udp_ports(2))
    return {1: (LtpLink(two), Listen(ltp=one)), 2: (LtpLink(one), Listen(ltp=two))}


def _tcpcl() -> dict[int, tuple[TcpclLink, Listen]]:
    where = Address(HERE, free_udp_ports(1)[0])
    dials = TcpclLink(where, keepalive_s=1, redial_s=0.05)
    return {1: (TcpclLink(None, keepalive_s=1), Listen(tcpcl=where)), 2: (dials, Listen())}


@asynccontextmanager
async def _pair(
    folder: Path, links: dict[int, tuple[Any, Listen]], disk: HeldDisk
) -> AsyncIterator[tuple[Running, Running]]:
    async with AsyncExitStack() as stack:
        one, two = [
            await stack.enter_async_context(
                opened(
                    BundleAgent(
                        settings_of(number, 3 - number, link),
                        folder / f"{number}.db",
                        listen,
                        system=disk,
                    )
                )
            )
            for number, (link, listen) in links.items()
        ]
        yield one, two
        disk.free.set()


@pytest.mark.parametrize("links", [_ltp, _tcpcl])
async def test_a_stop_passes_while_the_disk_syncs(tmp_path: Path, links: Any) -> None:
    disk = HeldDisk()
    async with _pair(tmp_path, links(), disk) as (one, two):
        disk.free.clear()
        sent = [asyncio.create_task(one.agent.send(TWO, ORDINARY))]
        sent += [asyncio.create_task(one.agent.send(TWO, STOP, expedited=True))]
        assert (await two.take_one()).payload == STOP
        assert not any(each.done() for each in sent)
        disk.free.set()
        await asyncio.gather(*sent)
        assert (await two.take_one()).payload == ORDINARY
        await one.until(lambda: not one.agent.health().queued)
        await two.agent.settle()
        assert not two.agent.health().undelivered


async def test_a_session_is_kept_alive_while_the_disk_syncs(tmp_path: Path) -> None:
    disk = HeldDisk()
    async with _pair(tmp_path, _tcpcl(), disk) as (one, two):
        await one.agent.send(TWO, ORDINARY)
        await two.take_one()
        disk.free.clear()
        sent = asyncio.create_task(two.agent.send(ONE, ORDINARY))
        silent_s = [0.0]

        def received_thrice() -> bool:
            silent_s.append(one.agent.health().neighbours[0].last_received_s or 0.0)
            return sum(now < before for before, now in pairwise(silent_s)) >= 3

        await one.until(received_thrice)
        assert not sent.done()
        disk.free.set()
        await sent
        assert (await one.take_one()).payload == ORDINARY


class HeldThread(HeldDisk):
    """A computer with syncs that wait on the agent's second thread only.

    Attributes:
        waits: set once a sync waits.
    """

    def __init__(self) -> None:
        super().__init__()
        self.waits = threading.Event()

    def sync(self, database: Path) -> None:
        if threading.current_thread() is not threading.main_thread():
            if not self.free.is_set():
                self.waits.set()
            super().sync(database)


async def test_an_agent_that_was_closed_during_a_sync_opens_again(tmp_path: Path) -> None:
    disk = HeldThread()
    (link, listen), _ = _ltp().values()
    agent = BundleAgent(settings_of(1, 2, link), tmp_path / "1.db", listen, system=disk)
    async with asyncio.timeout(LIMIT_S):
        async with opened(agent) as one:
            disk.free.clear()
            sent = asyncio.create_task(agent.send(TWO, ORDINARY))
            await one.until(disk.waits.is_set)
            asyncio.get_running_loop().call_soon(disk.free.set)
        await sent
        async with opened(agent):
            await agent.send(TWO, ORDINARY)


@pytest.mark.parametrize(
    ("utc_ms", "held"),
    [(START_UTC_MS, (False, True, False)), (0, (True, True))],
    ids=["stopped clock", "first starts before 2000"],
)
def test_sequence_numbers_are_not_used_again_after_losses_of_power(
    utc_ms: int, held: tuple[bool, ...], tmp_path: Path
) -> None:
    disk, path, clock = PowerLoss(tmp_path / "synced"), tmp_path / "1.db", Clock()
    clock.utc_ms = utc_ms
    identities: list[str] = []
    for is_held in held:
        database = BundleDatabase(path, system=disk)
        node = BundleNode(nodes.settings_of(1, 2), database, clock, lambda _: None)
        disk.holds = is_held
        identities.append(str(node.put(TWO, STOP, expedited=True)))
        node.transaction.commit()
        database.close()
        disk.holds = False
        disk.cut_power(path)
    assert len(set(identities)) == len(held)


async def test_ltp_sessions_are_not_used_again_after_losses_of_power(tmp_path: Path) -> None:
    disk, path, loop = PowerLoss(tmp_path / "synced"), tmp_path / "1.db", asyncio.get_running_loop()
    sessions: list[int] = []
    for is_held in (False, True, False):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.bind((HERE, 0))
            peer.setblocking(False)
            settings = settings_of(1, 2, LtpLink(Address(*peer.getsockname())))
            agent = BundleAgent(settings, path, Listen(ltp=ANY), system=disk)
            async with opened(agent), asyncio.timeout(LIMIT_S):
                disk.holds = is_held
                await agent.send(TWO, STOP, expedited=True)
                sessions.append(decode_segment(await loop.sock_recv(peer, 2048)).session.number)
        disk.holds = False
        disk.cut_power(path)
    assert len(set(sessions)) == 3


def test_a_sync_releases_only_bundles_that_were_committed_before(tmp_path: Path) -> None:
    database = BundleDatabase(tmp_path / "1.db", system=UNSYNCED)
    node = BundleNode(nodes.settings_of(1, 2), database, Clock(), lambda _: None)
    node.put(TWO, ORDINARY)
    node.transaction.write()
    node.put(TWO, ORDINARY)
    node.transaction.begin_sync()
    node.transaction.end_sync()
    node.transaction.release()
    assert database.durable["outbox"] == 1
    node.transaction.commit()
    assert database.durable["outbox"] == 2
    database.close()
