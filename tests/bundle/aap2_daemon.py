"""uD3TN daemons as AAP 2.0 shows them, with real messages on real sockets, and their faults."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from google.protobuf.internal.decoder import _DecodeVarint32
from google.protobuf.internal.encoder import _VarintBytes
from google.protobuf.message import Message
from ud3tn_utils.aap2 import (
    AAPMessage,
    AAPResponse,
    BundleADU,
    BundleADUFlags,
    Keepalive,
    ResponseStatus,
    Welcome,
)

DTN_NOW_MS = 848_000_000_000


class _GoneError(Exception):
    """The fault that was asked for: the connection ends here."""


@dataclass
class Faults:
    """What goes wrong next, so many times."""

    lost_before_response: int = 0
    refused: int = 0
    dead: bool = False
    silent: bool = False
    repeats: int = 0
    babbles: tuple[bytes, ...] = ()


@dataclass
class Network:
    """The daemons of a test, which reach one another at once."""

    daemons: dict[str, "Aap2Server"] = field(default_factory=dict)

    def carry(self, adu: BundleADU, payload: bytes) -> None:
        node = adu.dst_eid.rsplit(".", 1)[0]
        daemon = self.daemons[node]
        for _ in range(1 + daemon.faults.repeats):
            daemon.deliver(adu, payload)


class Aap2Server:
    """A daemon: takes what is sent, keeps what arrives until its subscriber has said so."""

    def __init__(self, network: Network, node: int) -> None:
        self.node = f"ipn:{node}"
        self.network, self.faults = network, Faults()
        self.registered: dict[str, list[str]] = {}
        self.waiting: dict[str, deque[tuple[BundleADU, bytes]]] = {}
        self.acknowledged: list[int] = []
        self.sent = 0
        self.keepalives = 0
        self._arrived = asyncio.Event()
        self._count = 0
        self._server: asyncio.Server | None = None
        self._serving: set[asyncio.Task[None]] = set()
        network.daemons[self.node] = self

    async def listen(self, path: Path | None = None) -> int:
        """Listen at a Unix socket, or at a free TCP port, which is returned."""
        if path is not None:
            path.unlink(missing_ok=True)
            self._server = await asyncio.start_unix_server(self._serve, path)
            return 0
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return int(self._server.sockets[0].getsockname()[1])

    async def stop(self) -> None:
        """Die; what waits for subscribers is kept, as with its SQLite storage."""
        if self._server is not None:
            self._server.close()
        for serving in self._serving:
            serving.cancel()
        await asyncio.gather(*self._serving)

    def deliver(self, adu: BundleADU, payload: bytes) -> None:
        self.waiting.setdefault(adu.dst_eid, deque()).append((adu, payload))
        self._arrived.set()

    def deliver_from(
        self, source: str, endpoint: str, payload: bytes, *, report: bool = False
    ) -> None:
        """Have something arrive from a node that has no daemon here."""
        self._count += 1
        flag = (
            BundleADUFlags.BUNDLE_ADU_STATUS_REPORT if report else BundleADUFlags.BUNDLE_ADU_NORMAL
        )
        adu = BundleADU(
            src_eid=source,
            dst_eid=endpoint,
            creation_timestamp_ms=DTN_NOW_MS,
            sequence_number=self._count,
            payload_length=len(payload),
            adu_flags=[flag],
        )
        self.deliver(adu, payload)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(_GoneError, OSError, EOFError, asyncio.CancelledError), self._entered(writer):
            if self.faults.babbles:
                writer.write(self.faults.babbles[0])
                self.faults.babbles = self.faults.babbles[1:]
                return
            if self.faults.dead:
                await reader.read()
                return
            writer.write(b"\x2f")
            _write(writer, AAPMessage(welcome=Welcome(node_id=f"{self.node}.0")))
            config = (await self._message(reader)).config
            secrets = self.registered.setdefault(config.endpoint_id, [])
            if {config.secret, *secrets} != {config.secret}:
                _answer(writer, ResponseStatus.RESPONSE_STATUS_UNAUTHORIZED)
                return
            secrets.append(config.secret)
            try:
                _answer(writer, ResponseStatus.RESPONSE_STATUS_SUCCESS)
                if config.is_subscriber:
                    await self._bring(reader, writer, config.endpoint_id, config.keepalive_seconds)
                else:
                    await self._take(reader, writer, config.endpoint_id)
            finally:
                secrets.remove(config.secret)

    @contextmanager
    def _entered(self, writer: asyncio.StreamWriter) -> Iterator[None]:
        serving = asyncio.current_task()
        assert serving is not None
        self._serving.add(serving)
        try:
            yield
        finally:
            self._serving.discard(serving)
            writer.close()

    async def _take(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, source: str
    ) -> None:
        while True:
            message = await self._message(reader)
            if message.WhichOneof("msg") == "keepalive":
                self.keepalives += 1
                _answer(writer, ResponseStatus.RESPONSE_STATUS_ACK)
                continue
            payload = await reader.readexactly(message.adu.payload_length)
            if self.faults.refused:
                self.faults.refused -= 1
                _answer(writer, ResponseStatus.RESPONSE_STATUS_ERROR)
                continue
            self.sent += 1
            self._count += 1
            self.network.carry(
                BundleADU(
                    src_eid=source,
                    dst_eid=message.adu.dst_eid,
                    creation_timestamp_ms=DTN_NOW_MS,
                    sequence_number=self._count,
                    payload_length=len(payload),
                ),
                payload,
            )
            if self.faults.lost_before_response:
                self.faults.lost_before_response -= 1
                raise _GoneError
            _answer(writer, ResponseStatus.RESPONSE_STATUS_SUCCESS)

    async def _bring(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        endpoint: str,
        keepalive_s: int,
    ) -> None:
        waiting, loop = self.waiting.setdefault(endpoint, deque()), asyncio.get_running_loop()
        while True:
            since_s = loop.time()
            while not waiting or self.faults.silent:
                await self._look(reader)
                if loop.time() - since_s >= keepalive_s and not self.faults.silent:
                    _write(writer, AAPMessage(keepalive=Keepalive()))
                    assert await self._status(reader) == ResponseStatus.RESPONSE_STATUS_ACK
                    since_s = loop.time()
            adu, payload = waiting[0]
            _write(writer, AAPMessage(adu=adu))
            writer.write(payload)
            assert await self._status(reader) == ResponseStatus.RESPONSE_STATUS_SUCCESS
            self.acknowledged.append(adu.sequence_number)
            waiting.popleft()

    async def _look(self, reader: asyncio.StreamReader) -> None:
        """Wait a moment for what arrives; notice a subscriber that has gone."""
        self._arrived.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(0.05):
                await self._arrived.wait()
        if reader.at_eof():
            raise _GoneError

    async def _message(self, reader: asyncio.StreamReader) -> AAPMessage:
        message = AAPMessage()
        message.ParseFromString(await _delimited(reader))
        return message

    async def _status(self, reader: asyncio.StreamReader) -> int:
        response = AAPResponse()
        response.ParseFromString(await _delimited(reader))
        return int(response.response_status)


async def _delimited(reader: asyncio.StreamReader) -> bytes:
    head = bytearray()
    while not head or head[-1] & 0x80:
        head += await reader.readexactly(1)
    return await reader.readexactly(_DecodeVarint32(head, 0)[0])


def _write(writer: asyncio.StreamWriter, message: Message) -> None:
    octets = message.SerializeToString()
    writer.write(_VarintBytes(len(octets)) + octets)


def _answer(writer: asyncio.StreamWriter, status: int) -> None:
    _write(writer, AAPResponse(response_status=status))


@asynccontextmanager
async def daemons(folder: Path, *nodes: int) -> AsyncIterator[dict[int, Aap2Server]]:
    """Have daemons listen at `<node>.socket` for the time of a with."""
    network = Network()
    servers = {node: Aap2Server(network, node) for node in nodes}
    for node, server in servers.items():
        await server.listen(folder / f"{node}.socket")
    try:
        yield servers
    finally:
        for server in servers.values():
            await server.stop()
