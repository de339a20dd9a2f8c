"""The embedded agent over TCPCL on real sockets, and sessions that break."""

import asyncio
import random
import socket
from pathlib import Path

import pytest

from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.settings import Address, Listen, TcpclLink
from tests.bundle.agents import ANY, payloads_of, port_of, running, send_all

ONE, TWO = Ipn(1, 1), Ipn(2, 1)


@pytest.mark.parametrize("acknowledge", [True, False])
def test_tcpcl_brings_both_ways_whoever_dials(tmp_path: Path, acknowledge: bool) -> None:
    async def run() -> None:
        waits = TcpclLink(None, acknowledge=acknowledge)
        async with running(tmp_path, 2, 1, waits, Listen(tcpcl=ANY)) as two:
            address = port_of(two.agent.listens.tcpcl)
            dials = TcpclLink(address, acknowledge=acknowledge)
            async with running(tmp_path, 1, 2, dials, Listen()) as one:
                payloads = [bytes(200_000), *payloads_of(1000)]
                await asyncio.gather(send_all(one, TWO, payloads), send_all(two, ONE, payloads))
                assert sorted(await two.take(1001)) == sorted(payloads)
                assert sorted(await one.take(1001)) == sorted(payloads)
                await one.until(lambda: one.agent.health().queued == 0)

    asyncio.run(run())


class Cutter:
    """Passes TCP on in odd pieces and cuts it, often."""

    def __init__(self, target: Address, chance: random.Random) -> None:
        self.target, self.chance = target, chance
        self.cuts = 0
        self._writers: list[asyncio.StreamWriter] = []
        self._calls: set[asyncio.Task[None] | None] = set()

    async def serve(self) -> tuple[asyncio.Server, Address]:
        server = await asyncio.start_server(self._call, "127.0.0.1", 0)
        return server, Address(*server.sockets[0].getsockname()[:2])

    async def close(self, server: asyncio.Server) -> None:
        server.close()
        await asyncio.sleep(0)
        while any(call and not call.done() for call in self._calls):
            for writer in self._writers:
                writer.transport.abort()
            await asyncio.sleep(0)
        await asyncio.sleep(0)

    async def _call(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        self._calls.add(asyncio.current_task())
        left = self.chance.randrange(2_000, 60_000)
        try:
            far_reader, far_writer = await asyncio.open_connection(
                self.target.host, self.target.port
            )
            self._writers.append(far_writer)
            await asyncio.gather(
                self._pass_on(reader, far_writer, left), self._pass_on(far_reader, writer, left)
            )
            far_writer.transport.abort()
        finally:
            writer.transport.abort()

    async def _pass_on(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, left: int
    ) -> None:
        try:
            while octets := await reader.read(self.chance.randrange(1, 3000)):
                left -= len(octets)
                if left < 0:
                    self.cuts += 1
                    writer.transport.abort()
                    break
                writer.write(octets)
                await writer.drain()
        except OSError:
            pass
        writer.close()


def test_tcpcl_loses_nothing_where_sessions_break(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(
            tmp_path, 2, 1, TcpclLink(None, window_octets=5000), Listen(tcpcl=ANY)
        ) as two:
            cutter = Cutter(port_of(two.agent.listens.tcpcl), random.Random(3))
            server, address = await cutter.serve()
            dials = TcpclLink(address, redial_s=0.02, segment_octets=50, window_octets=5000)
            async with running(tmp_path, 1, 2, dials, Listen()) as one:
                payloads = payloads_of(1500)
                await asyncio.gather(send_all(one, TWO, payloads), send_all(two, ONE, payloads))
                assert sorted(await two.take(1500)) == payloads
                assert sorted(await one.take(1500)) == payloads
                assert cutter.cuts > 2
            server.close()

    asyncio.run(run())


@pytest.mark.parametrize(
    "octets", [b"GET / HTTP/1.1\r\n\r\n", b"dtn!\x04", b"dtn!\x03\x00\x00\x00\x07ipn:9.0"]
)
def test_tcpcl_hangs_up_on_strangers(tmp_path: Path, octets: bytes) -> None:
    async def run() -> None:
        async with running(tmp_path, 2, 1, TcpclLink(None), Listen(tcpcl=ANY)) as two:
            where = port_of(two.agent.listens.tcpcl)
            reader, writer = await asyncio.open_connection(where.host, where.port)
            writer.write(octets)
            async with asyncio.timeout(10.0):
                while await reader.read(100):
                    pass
            writer.close()

    asyncio.run(run())


def test_ends_that_do_not_agree_on_acknowledgements_say_so_and_lose_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        waits = TcpclLink(None, acknowledge=False)
        async with running(tmp_path, 2, 1, waits, Listen(tcpcl=ANY)) as two:
            dials = TcpclLink(port_of(two.agent.listens.tcpcl), redial_s=0.02)
            async with running(tmp_path, 1, 2, dials, Listen()) as one:
                await one.agent.send(TWO, b"x")
                await one.until(lambda: "acknowledge has to be false here, too" in caplog.text)
                assert one.agent.health().queued == 1
                assert one.notices == []

    asyncio.run(run())


def test_who_is_not_there_is_told_of_once_and_dialled_until_there(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        with socket.socket() as held:  # bound, and nobody listens
            held.bind(("127.0.0.1", 0))
            where = Address(*held.getsockname())
            dials = TcpclLink(where, redial_s=0.02)
            async with running(tmp_path, 1, 2, dials, Listen()) as one:
                await one.until(lambda: "ipn:2.0 at 127.0.0.1" in caplog.text)
                await one.agent.send(TWO, b"x")
                assert not one.agent.health().neighbours[0].contact
                held.close()
                async with running(tmp_path, 2, 1, TcpclLink(None), Listen(tcpcl=where)) as two:
                    assert await two.take(1) == [b"x"]
                    assert one.agent.health().neighbours[0].contact
        assert caplog.text.count("ipn:2.0 at 127.0.0.1") == 1

    asyncio.run(run())
