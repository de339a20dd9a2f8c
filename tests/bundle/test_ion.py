"""Attached to NASA ION: the application's view, the bridge as a process, and the frames between."""

import os
import signal
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.bundle.agent import BundleAgent
from adapters.bundle.codec.eid import Dtn, Ipn
from adapters.bundle.codec.errors import BundleError, DecodeError
from adapters.bundle.daemons.ion_bridge import Spool
from adapters.bundle.daemons.ion_frames import (
    Frame,
    FrameReader,
    Received,
    Sent,
    decode_frame,
    encode_frame,
)
from adapters.bundle.node.reporting import DeliveryStatus
from adapters.bundle.node.settings import DaemonLink, IonSettings, Neighbour, NodeSettings
from tests.bundle.ion_node import DTN_NOW_MS, bpadmin, ion_nodes
from tests.bundle.worlds import (
    ONE,
    PATIENT,
    QUICK,
    TWO,
    attached,
    bridge_of,
    ended,
    payloads_of,
    send_all,
    stat_of,
)


async def test_ion_receives_the_lifetime_and_has_its_endpoint_closed(tmp_path: Path) -> None:
    async with ion_nodes(tmp_path, 1, 2) as nodes:
        async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
            await one.agent.send(TWO, b"x", lifetime_s=3600.0)
            delivery = await two.take_one()
            assert delivery.source == ONE
            assert delivery.identity.creation.time_ms == DTN_NOW_MS
            assert 3590 < nodes.lifetimes_s[0] <= 3600
        assert sorted(nodes.closed) == ["ipn:1.1", "ipn:2.1"]
        assert nodes.handles == {}


async def test_what_ion_refuses_waits_and_is_offered_again(tmp_path: Path) -> None:
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


async def test_an_ion_without_space_blocks_only_its_own_transmissions(tmp_path: Path) -> None:
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


async def test_one_of_several_nodes_on_a_machine_is_found_by_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "nodes"
    for number in ("1", "2"):
        (folder / number).mkdir(parents=True)
    settings = IonSettings(node_list=str(folder))
    async with ion_nodes(tmp_path, 1, 2) as nodes:
        async with attached(tmp_path, 1, settings) as one, attached(tmp_path, 2, settings) as two:
            await one.agent.send(TWO, b"x")
            assert await two.take(1) == [b"x"]
        assert nodes.folders == {str(folder / "1"), str(folder / "2")}


async def test_an_endpoint_that_another_process_has_open_is_waited_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """pyion opens it all the same; it is the first receive that fails (measured, R10)."""
    async with ion_nodes(tmp_path, 1, 2) as nodes:
        other = nodes.open_endpoint("ipn:1.1", os.getppid())["handle"]
        async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
            await one.until(lambda: "has the endpoint open" in caplog.text)
            del nodes.handles[other]
            await two.agent.send(ONE, b"x")
            assert await one.take(1) == [b"x"]


async def test_an_ion_that_is_started_later_is_found(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with ion_nodes(tmp_path, 1, 2) as nodes:
        await nodes.change(1, stopped=True)
        async with attached(tmp_path, 1) as one, attached(tmp_path, 2) as two:
            assert "Is ION running on this host?" in caplog.text
            await one.agent.send(TWO, b"x")
            assert not one.agent.health().neighbours[0].contact
            await nodes.change(1, stopped=False)
            assert await two.take(1) == [b"x"]
            assert one.agent.health().neighbours[0].contact


async def test_a_missing_pyion_is_reported_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match=r"cannot import pyion: .*Build the pyion of your"):
        async with attached(tmp_path, 1):
            pass


async def test_a_missing_interpreter_setting_is_reported(tmp_path: Path) -> None:
    none = tmp_path / "none"
    text = tmp_path / "text"
    text.write_text("no program")
    for wrong in (none, text, tmp_path):
        with pytest.raises(BundleError, match=rf"^ion.python is {wrong}, .* name the interp"):
            async with attached(tmp_path, 1, IonSettings(python=str(wrong))):
                pass


async def test_ion_has_numbers_for_nodes(tmp_path: Path) -> None:
    own, other = Dtn("//rover/relay"), Dtn("//orbiter/relay")
    neighbour = Neighbour(Dtn("//orbiter/"), DaemonLink(other))
    settings = NodeSettings(own, (own,), (neighbour,))
    agent = BundleAgent(settings, tmp_path / "1.db", daemon=PATIENT)
    with pytest.raises(BundleError, match=r"ipn endpoints, not dtn://rover"):
        await agent.open(lambda _: None)


def test_a_daemon_has_one_endpoint(tmp_path: Path) -> None:
    settings = NodeSettings(ONE, (ONE, Ipn(1, 2)), (Neighbour(Ipn(2, 0), DaemonLink(TWO)),))
    with pytest.raises(BundleError, match="the only endpoint"):
        BundleAgent(settings, tmp_path / "1.db", daemon=PATIENT)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_a_bridge_ends_on_request_and_closes_its_endpoint_and_another_follows(
    tmp_path: Path, number: signal.Signals
) -> None:
    async with (
        ion_nodes(tmp_path, 1, 2) as nodes,
        attached(tmp_path, 1) as one,
        attached(tmp_path, 2) as two,
    ):
        first = bridge_of(nodes, "ipn:2.1")
        os.kill(first, number)
        await ended(first)
        assert nodes.closed == ["ipn:2.1"]
        await one.agent.send(TWO, b"meanwhile")
        assert await two.take(1) == [b"meanwhile"]
        assert bridge_of(nodes, "ipn:2.1") != first


async def test_data_lost_by_ion_but_not_by_the_agent_is_resent_from_the_spool(
    tmp_path: Path,
) -> None:
    left = Received("ipn:2.1", DTN_NOW_MS, 7, b"left")
    spool = Spool(tmp_path / "1.received")
    spool.save(left)
    assert spool.load() == left
    async with ion_nodes(tmp_path, 1, 2) as nodes:
        async with attached(tmp_path, 1) as one:
            delivery = await one.take_one()
            assert (delivery.payload, delivery.source) == (b"left", TWO)
            await one.until(lambda: spool.load() is None)
        spool.save(left)
        async with attached(tmp_path, 1) as one:
            nodes.bring("ipn:2.1", "ipn:1.1", b"next")
            await nodes.change(1)
            assert await one.take(1) == [b"next"]


def test_half_a_spool_is_no_unit(tmp_path: Path) -> None:
    path = tmp_path / "spool"
    Spool(path).save(Received("ipn:2.1", 1, 2, b"payload"))
    path.write_bytes(path.read_bytes()[:-3])
    assert Spool(path).load() is None
    Spool(path).clear()
    assert Spool(path).load() is None


async def test_a_locked_database_is_detected_without_killing_a_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpadmin(tmp_path, 1)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    async with (
        ion_nodes(tmp_path, 1, 2) as nodes,
        attached(tmp_path, 2) as two,
        attached(tmp_path, 1, QUICK) as one,
    ):
        bridge = bridge_of(nodes, "ipn:1.1")
        await nodes.change(1, locked=True)
        await one.until(lambda: not one.agent.health().neighbours[0].contact)
        await one.agent.send(TWO, b"x")
        await nodes.change(1, locked=False)
        assert await two.take(1) == [b"x"]
        await one.until(lambda: one.agent.health().neighbours[0].contact)
        assert bridge_of(nodes, "ipn:1.1") == bridge


@pytest.mark.parametrize("fresh", [False, True])
async def test_an_ion_that_is_started_again_is_noticed_and_attached_to_again(
    tmp_path: Path, fresh: bool
) -> None:
    """The bridge heard nothing, "contact" stayed, and 40 of 40 units went into lost memory."""
    async with (
        ion_nodes(tmp_path, 1, 2) as nodes,
        attached(tmp_path, 1, QUICK) as one,
        attached(tmp_path, 2, QUICK) as two,
    ):
        for run in range(3):
            await nodes.restart(1, fresh)
            payloads = [b"%d-%02d" % (run, number) for number in range(20)]
            await send_all(one, TWO, payloads)
            assert sorted(await two.take(20)) == payloads
            await two.agent.send(ONE, b"back")
            assert await one.take(1) == [b"back"]
            await one.until(lambda: one.agent.health().neighbours[0].contact)


async def test_an_ion_that_has_ended_is_no_contact(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bpadmin(tmp_path, 1)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    async with ion_nodes(tmp_path, 1, 2) as nodes, attached(tmp_path, 1, QUICK) as one:
        await one.until(lambda: one.agent.health().neighbours[0].contact)
        await nodes.change(1, stopped=True)
        await one.until(lambda: not one.agent.health().neighbours[0].contact)
        await one.until(lambda: "Is ION running on this host?" in caplog.text)
        assert "ION is not running" in caplog.text or "ION has ended" in caplog.text
        await nodes.change(1, stopped=False)
        await one.until(lambda: one.agent.health().neighbours[0].contact)


async def test_a_bridge_that_hangs_is_detected_requested_to_end_and_never_killed(
    tmp_path: Path,
) -> None:
    """A process that is stopped stands for one that waits within ION, holding Python's lock."""
    async with (
        ion_nodes(tmp_path, 1, 2) as nodes,
        attached(tmp_path, 1, QUICK) as one,
        attached(tmp_path, 2) as two,
    ):
        await one.until(lambda: one.agent.health().neighbours[0].contact)
        bridge = bridge_of(nodes, "ipn:1.1")
        os.kill(bridge, signal.SIGSTOP)
        try:
            await one.until(lambda: not one.agent.health().neighbours[0].contact)
            await one.agent.send(TWO, b"x")
            assert ") T " in stat_of(bridge)
        finally:
            os.kill(bridge, signal.SIGCONT)
        await ended(bridge)
        assert nodes.closed == ["ipn:1.1"]
        assert await two.take(1) == [b"x"]
        await one.until(lambda: one.agent.health().neighbours[0].contact)


async def test_closing_while_ion_hangs_leaves_the_bridge_to_end_by_itself(
    tmp_path: Path,
) -> None:
    async with ion_nodes(tmp_path, 1, 2) as nodes:
        async with attached(tmp_path, 1, QUICK):
            bridge = bridge_of(nodes, "ipn:1.1")
            await nodes.change(1, locked=True)
        assert ") S " in stat_of(bridge)
        await nodes.change(1, locked=False)
        await ended(bridge)
        assert nodes.closed == ["ipn:1.1"]


numbers = st.integers(0, 2**64 - 1)
values = {int: numbers, str: st.text(), bytes: st.binary(), bool: st.booleans()}
frames = st.one_of(
    *(
        st.builds(kind, *(values[field.type] for field in kind.__dataclass_fields__.values()))
        for kind in get_args(Frame)
    )
)


@given(st.lists(frames), st.data())
def test_a_stream_cut_anywhere_holds_the_frames_that_were_written(
    sent: list[Frame], data: st.DataObject
) -> None:
    octets = b"".join(map(encode_frame, sent))
    reader, got = FrameReader(), list[Frame]()
    while octets:
        cut = data.draw(st.integers(1, len(octets)))
        got += reader.feed(octets[:cut])
        octets = octets[cut:]
    assert got == sent


@given(st.binary())
def test_an_invalid_frame_is_refused(body: bytes) -> None:
    try:
        frame = decode_frame(body)
    except DecodeError:
        return
    assert encode_frame(frame)[4:] == body


def test_a_frame_ends_where_it_ends() -> None:
    body = encode_frame(Sent(7))[4:]
    for wrong in (body + b"\0", body[:-1], b"\x18\x63"):
        with pytest.raises(DecodeError):
            decode_frame(wrong)
