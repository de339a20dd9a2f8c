"""`/ws/video/{asset}`: live pictures of a rover's camera; a slow page skips to the newest.

The stream arrives by UDP, after the rover's VIDEO ON. The port is bound only while a page is
connected, so that other receivers can use it otherwise. A message is the reception time (seconds
since 1970 UTC, 8 octets, big-endian float) and a JPEG file.
"""

import asyncio
import logging
import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final

from aiohttp import WSCloseCode, WSMsgType, web

from adapters.video import JpegStream

_LOG: Final = logging.getLogger(__name__)

HEARTBEAT_S: Final = 20.0
TIME: Final = struct.Struct(">d")

Address = tuple[str, int]


class FrameAssembler(asyncio.DatagramProtocol):
    """Assembles the pictures of a stream, and holds the newest."""

    def __init__(self, utc: Callable[[], float]) -> None:
        self._stream, self._utc = JpegStream(), utc
        self._newest = b""
        self._number = 0
        self._more = asyncio.Event()
        self.watchers = 0

    def datagram_received(self, data: bytes, _: object) -> None:
        """Add a datagram to the stream."""
        picture = self._stream.add(data)
        if picture is None:
            return
        self._newest = TIME.pack(self._utc()) + picture
        self._number += 1
        more, self._more = self._more, asyncio.Event()
        more.set()

    async def after(self, number: int) -> tuple[int, bytes]:
        """Wait until a picture has a higher number; return the newest number and picture."""
        while self._number <= number:
            await self._more.wait()
        return self._number, self._newest


class VideoRequests:
    """Serves the streams.

    Args:
        given: UDP addresses of assets' streams, from the command line.
        of_settings: returns the UDP address of an asset's settings; None if there is none.
        utc: clock, s since 1970 UTC.
    """

    def __init__(
        self,
        given: Mapping[str, Address],
        of_settings: Callable[[str], Address | None],
        utc: Callable[[], float],
    ) -> None:
        self._given, self._of_settings, self._utc = given, of_settings, utc
        self._streams: dict[Address, tuple[asyncio.DatagramTransport, FrameAssembler]] = {}
        self._listening = asyncio.Lock()

    def routes(self) -> list[web.RouteDef]:
        """Return the route."""
        return [web.get("/ws/video/{asset}", self._serve)]

    async def _serve(self, request: web.Request) -> web.WebSocketResponse:
        asset = request.match_info["asset"]
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, compress=False, max_msg_size=1024)
        await socket.prepare(request)
        address = self._given.get(asset) or self._of_settings(asset)
        if address is None:
            await self._refuse(socket, f"no video address for {asset}: give --video")
            return socket
        try:
            pictures = await self._listen(address)
        except OSError as error:
            where = f"{address[0]}:{address[1]}"
            await self._refuse(
                socket, f"cannot listen at {where} ({error.strerror}): `rover video`?"
            )
            return socket
        sending = asyncio.create_task(_send(socket, pictures))
        try:
            while (await socket.receive()).type is WSMsgType.TEXT:
                pass  # messages of the page are ignored
        finally:
            sending.cancel()
            self._leave(address)
        return socket

    async def _refuse(self, socket: web.WebSocketResponse, why: str) -> None:
        await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=why.encode()[:120])

    async def _listen(self, address: Address) -> FrameAssembler:
        async with self._listening:
            if address not in self._streams:
                loop = asyncio.get_running_loop()
                transport, pictures = await loop.create_datagram_endpoint(
                    lambda: FrameAssembler(self._utc), local_addr=address
                )
                self._streams[address] = transport, pictures
                _LOG.info("listening for video at %s:%d", *address)
        pictures = self._streams[address][1]
        pictures.watchers += 1
        return pictures

    def _leave(self, address: Address) -> None:
        transport, pictures = self._streams[address]
        pictures.watchers -= 1
        if pictures.watchers == 0:
            del self._streams[address]
            transport.close()


async def _send(socket: web.WebSocketResponse, pictures: FrameAssembler) -> None:
    number = 0
    with suppress(ConnectionError):
        while True:
            number, picture = await pictures.after(number)
            await socket.send_bytes(picture)
