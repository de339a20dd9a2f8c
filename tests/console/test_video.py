"""Pictures of a camera, by UDP to the console and from there to pages."""

import asyncio
import socket
import struct
import time
from pathlib import Path

import pytest
from aiohttp import ClientSession, WSCloseCode

from sim.ros.video_stream import RtpJpegSender
from tests.console.consoles import served
from tests.support.ports import free_udp_ports
from tests.video.test_pictures import jpeg, picture, seen

UNREACHABLE = "127.0.0.1:1"


async def test_pages_get_the_newest_picture(tmp_path: Path) -> None:
    (port,) = free_udp_ports(1)
    sender, sent = RtpJpegSender(1), [jpeg(picture(320, 240, seed)) for seed in range(3)]
    async with (
        served(tmp_path, UNREACHABLE, video={"jackal": ("127.0.0.1", port)}) as address,
        ClientSession() as browser,
    ):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as camera:

            async def show(number: int) -> None:
                for packet in sender.packets(sent[number], float(number)):
                    camera.sendto(packet, ("127.0.0.1", port))
                await asyncio.sleep(0)

            for _ in range(2):  # the port is free in between
                async with (
                    browser.ws_connect(f"{address}ws/video/jackal") as one,
                    browser.ws_connect(f"{address}ws/video/jackal") as other,
                ):
                    for number in range(3):
                        await show(number)
                        for page in (one, other):
                            message = await page.receive_bytes(timeout=60)
                            (utc_s,) = struct.unpack(">d", message[:8])
                            assert abs(time.time() - utc_s) < 60
                            assert seen(message[8:]).tobytes() == seen(sent[number]).tobytes()
                await _until_free(port)


async def _until_free(port: int) -> None:
    async with asyncio.timeout(60):
        while True:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                try:
                    probe.bind(("127.0.0.1", port))
                except OSError:
                    await asyncio.sleep(0.02)
                else:
                    return


@pytest.mark.parametrize(("asset", "text"), [("scout", "no video"), ("jackal", "cannot listen")])
async def test_without_video_the_reason_is_shown(asset: str, text: str, tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        video = {"jackal": taken.getsockname()}
        async with (
            served(tmp_path, UNREACHABLE, video=video) as address,
            ClientSession() as browser,
            browser.ws_connect(f"{address}ws/video/{asset}") as page,
        ):
            message = await page.receive()
            assert page.close_code == WSCloseCode.TRY_AGAIN_LATER
            assert text in str(message.extra)
