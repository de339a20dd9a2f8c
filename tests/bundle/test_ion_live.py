"""With NASA ION itself, where there is one: `pytest -m ion`."""

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from adapters.bundle.agent import BundleAgent
from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.integrity import IntegrityVariant, Key
from adapters.bundle.node.reporting import DeliveryStatus
from adapters.bundle.node.security import KeySettings, PolicySettings, Security, SecuritySettings
from adapters.bundle.node.settings import (
    Address,
    DaemonLink,
    IonSettings,
    Listen,
    LtpLink,
    Neighbour,
    NodeSettings,
)
from tests.bundle.ion_live import PYTHON, IonNode, ion_node, missing
from tests.bundle.worlds import HERE, LIMIT_S, Running, opened, payloads_of, send_all
from tests.support.ports import free_udp_ports

pytestmark = [
    pytest.mark.ion,
    pytest.mark.slow,
    pytest.mark.skipif(missing() is not None, reason=str(missing())),
]

ION, OURS = Ipn(1, 1), Ipn(2, 1)
RULE = """1
a {"event_set" : {"name" : "es0", "desc":"none"}}
a {"policyrule":{"filter":{"rule_id":"1","role":"s","src":"ipn:1.1","dest":"ipn:2.*","tgt":1},\
"spec":{"svc":"bib-integrity","sc_id":1,"sc_parms":[{"key_name":"k"},{"sha_variant":"5"},\
{"scope_flags":"7"}]},"es_ref":"es0"}}
q
"""


@asynccontextmanager
async def beside_ion(
    folder: Path, *, max_octets: int = 0, security: Security | None = None
) -> AsyncIterator[tuple[IonNode, Running]]:
    """Node 1 of ION, and our embedded agent as node 2, with LTP between them."""
    ports = free_udp_ports(2)
    link = LtpLink(Address(HERE, ports[0]), answer_s=2.0, confirm_after_s=10.0)
    settings = NodeSettings(OURS, (OURS,), (Neighbour(Ipn(1, 0), link),))
    listen = Listen(ltp=Address(HERE, ports[1]))
    agent = BundleAgent(settings, folder / "ours.db", listen=listen, security=security)
    async with (
        ion_node(folder / "nodes", 1, ports[0], {2: ports[1]}, max_octets) as node,
        opened(agent) as ours,
    ):
        yield node, ours


@asynccontextmanager
async def attached(folder: Path, node: IonNode) -> AsyncIterator[Running]:
    """An agent of ours attached to the node of ION."""
    settings = NodeSettings(ION, (ION,), (Neighbour(Ipn(2, 0), DaemonLink(OURS)),))
    ion = IonSettings(python=PYTHON, node_list=str(node.list))
    async with opened(BundleAgent(settings, folder / "attached.db", daemon=ion)) as running:
        yield running


async def test_embedded_to_ion_and_back_over_ltp(tmp_path: Path) -> None:
    async with beside_ion(tmp_path) as (node, ours):
        async with node.sink(2) as printed:
            await ours.agent.send(Ipn(1, 2), b"by LTP to ION")
            await ours.until(lambda: b"by LTP to ION" in printed.read_bytes())
            await ours.until(lambda: ours.agent.health().queued == 0)
        assert {notice.status for notice in ours.notices} == {DeliveryStatus.HANDED_ON}
        await node.run("bpsource", str(OURS), "by LTP from ION", limit_s=LIMIT_S)
        delivery = await ours.take_one()
        assert delivery.payload.rstrip(b"\0") == b"by LTP from ION"


async def test_ion_reports_what_its_application_has(tmp_path: Path) -> None:
    async with beside_ion(tmp_path) as (node, ours), node.sink(2):
        await ours.agent.send(Ipn(1, 2), b"confirmed", confirm=True)
        await ours.until(lambda: ours.agent.health().queued == 0)
        assert ours.notices[-1].status is DeliveryStatus.DELIVERED


async def test_attached_to_ion_and_embedded_exchange_everything_once(tmp_path: Path) -> None:
    async with beside_ion(tmp_path) as (node, ours), attached(tmp_path, node) as theirs:
        payloads = payloads_of(200)
        await asyncio.gather(send_all(ours, ION, payloads), send_all(theirs, OURS, payloads))
        assert sorted(await theirs.take(200)) == payloads
        assert sorted(await ours.take(200)) == payloads
        await theirs.agent.send(OURS, b"last")
        last = await ours.take_one()
        assert (last.payload, last.source) == (b"last", ION)


async def test_a_bundle_that_arrives_while_detached_is_delivered_later(tmp_path: Path) -> None:
    async with beside_ion(tmp_path) as (node, ours):
        async with attached(tmp_path, node) as theirs:
            await theirs.agent.send(OURS, b"first")
            assert await ours.take(1) == [b"first"]
        await send_all(ours, ION, payloads_of(10))
        await ours.until(lambda: ours.agent.health().queued == 0)
        async with attached(tmp_path, node) as theirs:
            assert sorted(await theirs.take(10)) == payloads_of(10)


async def test_the_second_at_an_endpoint_of_ion_waits(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with beside_ion(tmp_path) as (node, ours), attached(tmp_path, node) as first:
        folder = tmp_path / "second"
        async with attached(folder, node) as second:
            await second.until(lambda: "cannot receive" in caplog.text)
            await ours.agent.send(ION, b"for the first")
            assert await first.take(1) == [b"for the first"]


async def test_the_fragments_of_ion_are_put_together(tmp_path: Path) -> None:
    chance = random.Random(1)
    files = [chance.randbytes(20_000) for _ in range(5)]
    async with beside_ion(tmp_path, max_octets=1500) as (node, ours):
        for number, content in enumerate(files):
            (node.home / f"{number}.sent").write_bytes(content)
            await node.run("bpsendfile", "ipn:1.2", str(OURS), f"{number}.sent", limit_s=LIMIT_S)
        assert sorted(await ours.take(5)) == sorted(files)


async def test_an_ion_that_signs_with_null_cipher_suites_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    keys = {"k": Key(bytes(range(32)), IntegrityVariant.ION)}
    policies = SecuritySettings(
        keys={"k": KeySettings(file="k", form=IntegrityVariant.ION)},
        policies=(PolicySettings(key="k"),),
    )
    security = Security(Ipn(2, 0), policies, keys)
    async with beside_ion(tmp_path, security=security) as (node, ours), node.sink(2) as printed:
        await ours.agent.send(Ipn(1, 2), b"signed for ION")
        await ours.until(lambda: b"signed for ION" in printed.read_bytes())
        (node.home / "k").write_bytes(keys["k"].octets)
        await node.run("ionsecadmin", limit_s=LIMIT_S, typed="a key k k\nq\n")
        await node.run("bpsecadmin", limit_s=LIMIT_S, typed=RULE)
        await node.run("bpsendfile", "ipn:1.1", str(OURS), "k", limit_s=LIMIT_S)
        await ours.until(lambda: ours.agent.health().refused > 0)
        assert "NULL cipher suites" in caplog.text
