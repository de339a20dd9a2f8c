"""Attached to NASA ION, as an application sees it; the bridge has a model of pyion in it."""

import asyncio
import os
from pathlib import Path

import pytest

from adapters.bundle.agent_settings import make_agent
from adapters.bundle.codec.eid import Dtn, Ipn
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.node.reporting import DeliveryStatus
from adapters.bundle.node.settings import DaemonLink, IonSettings, Neighbour, NodeSettings
from tests.bundle.agents import payloads_of, send_all
from tests.bundle.bridges import PATIENT, attached
from tests.bundle.ion_node import DTN_NOW_MS, ion_nodes
from tests.bundle.worlds import ONE, TWO


def test_ion_hears_the_lifetime_and_has_its_endpoint_closed(tmp_path: Path) -> None:
    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
                await one.agent.send(TWO, b"x", lifetime_s=3600.0)
                delivery = await two.take_one()
                assert delivery.source == ONE
                assert delivery.identity.creation.time_ms == DTN_NOW_MS
                assert 3590 < nodes.lifetimes_s[0] <= 3600
            assert sorted(nodes.closed) == ["ipn:1.1", "ipn:2.1"]
            assert nodes.handles == {}

    asyncio.run(run())


def test_what_ion_refuses_waits_and_is_offered_again(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            ion_nodes(tmp_path, 1, 2) as nodes,
            attached(tmp_path, 1) as one,
            attached(tmp_path, 2) as two,
        ):
            await nodes.change(1, refused=1)
            await send_all(one, TWO, [b"refused", b"taken"])
            assert await two.take(1) == [b"taken"]
            assert await two.take(1) == [b"refused"]
            await one.until(lambda: one.agent.health().queued == 0)
            assert {notice.status for notice in one.notices} == {DeliveryStatus.HANDED_ON}

    asyncio.run(run())


def test_an_ion_without_room_holds_up_what_is_sent_and_nothing_else(tmp_path: Path) -> None:
    async def run() -> None:
        async with (
            ion_nodes(tmp_path, 1, 2) as nodes,
            attached(tmp_path, 1) as one,
            attached(tmp_path, 2) as two,
        ):
            await nodes.change(1, full=True)
            payloads = payloads_of(40)
            await send_all(one, TWO, payloads)
            await two.agent.send(ONE, b"the other way")
            assert await one.take(1) == [b"the other way"]
            assert one.agent.health().queued == 40
            await nodes.change(1, full=False)
            assert sorted(await two.take(40)) == payloads

    asyncio.run(run())


def test_one_of_several_nodes_on_a_machine_is_found_by_its_folder(tmp_path: Path) -> None:
    async def run() -> None:
        folder = tmp_path / "nodes"
        for number in ("1", "2"):
            (folder / number).mkdir(parents=True)
        settings = IonSettings(node_list=str(folder))
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            async with (
                attached(tmp_path, 1, settings) as one,
                attached(tmp_path, 2, settings) as two,
            ):
                await one.agent.send(TWO, b"x")
                assert await two.take(1) == [b"x"]
            assert nodes.folders == {str(folder / "1"), str(folder / "2")}

    asyncio.run(run())


def test_an_endpoint_that_another_process_has_open_is_waited_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """pyion opens it all the same; it is the first receive that fails (measured, R10)."""

    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            other = nodes._open("ipn:1.1", os.getppid())["handle"]
            async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
                await one.until(lambda: "has the endpoint open" in caplog.text)
                del nodes.handles[other]
                await two.agent.send(ONE, b"x")
                assert await one.take(1) == [b"x"]

    asyncio.run(run())


def test_an_ion_that_is_started_later_is_found(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        async with ion_nodes(tmp_path, 1, 2) as nodes:
            await nodes.change(1, stopped=True)
            async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
                assert "Is ION running on this host?" in caplog.text
                await one.agent.send(TWO, b"x")
                assert not one.agent.health().neighbours[0].contact
                await nodes.change(1, stopped=False)
                assert await two.take(1) == [b"x"]
                assert one.agent.health().neighbours[0].contact

    asyncio.run(run())


def test_who_has_no_pyion_hears_what_to_do(tmp_path: Path) -> None:
    async def run() -> None:
        with pytest.raises(BundleError, match=r"cannot import pyion: .*Build the pyion of your"):
            async with attached(tmp_path, 1):
                pass

    asyncio.run(run())


def test_who_names_no_interpreter_hears_so(tmp_path: Path) -> None:
    none = tmp_path / "none"
    text = tmp_path / "text"
    text.write_text("no program")

    async def run() -> None:
        for wrong in (none, text, tmp_path):
            with pytest.raises(BundleError, match=rf"^ion.python is {wrong}, .* name the interp"):
                async with attached(tmp_path, 1, IonSettings(python=str(wrong))):
                    pass

    asyncio.run(run())


def test_ion_has_numbers_for_nodes(tmp_path: Path) -> None:
    async def run() -> None:
        own, other = Dtn("//rover/relay"), Dtn("//orbiter/relay")
        neighbour = Neighbour(Dtn("//orbiter/"), DaemonLink(other))
        settings = NodeSettings(own, (own,), (neighbour,))
        agent = make_agent(settings, tmp_path / "1.db", PATIENT)
        with pytest.raises(BundleError, match=r"ipn endpoints, not dtn://rover"):
            await agent.open(lambda _: None)

    asyncio.run(run())


def test_a_daemon_has_one_endpoint(tmp_path: Path) -> None:
    settings = NodeSettings(ONE, (ONE, Ipn(1, 2)), (Neighbour(Ipn(2, 0), DaemonLink(TWO)),))
    with pytest.raises(BundleError, match="no other endpoint"):
        make_agent(settings, tmp_path / "1.db", PATIENT)
