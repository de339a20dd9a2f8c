"""The simulated camera's stream: sent only where somebody listens, put together on the ground."""

import io
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from random import Random

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from adapters.cli.main import main
from adapters.video import JpegStream
from executive.settings import SettingsError
from sim.ros.video_stream import MAX_SCAN_OCTETS, RtpJpegSender, VideoStream
from tests.support.ports import free_udp_ports
from tests.video.test_forwarder import HOST, udp_socket

RTP_HEADER = 12


def picture(width: int = 320, height: int = 240, seed: int = 0) -> Image.Image:
    """Return a picture with edges, slopes and noise."""
    noise = np.random.default_rng(seed).integers(0, 60, (height, width, 3))
    slope = np.linspace(0, 190, width)[None, :, None] * np.ones((height, 1, 1))
    pixels = (slope + noise).astype(np.uint8)
    pixels[height // 4 : height // 2, width // 4 : width // 2] = (200, 30, 10)
    return Image.fromarray(pixels)


def jpeg(image: Image.Image, quality: int = 85, subsampling: str = "4:2:0") -> bytes:
    file = io.BytesIO()
    image.save(file, "JPEG", quality=quality, subsampling=subsampling)
    return file.getvalue()


def seen(file: bytes) -> Image.Image:
    image = Image.open(io.BytesIO(file))
    image.load()
    return image


def together(stream: JpegStream, packets: list[bytes]) -> list[bytes]:
    return [file for packet in packets if (file := stream.add(packet)) is not None]


@pytest.mark.parametrize("subsampling", ["4:2:0", "4:2:2"])
@pytest.mark.parametrize("quality", [20, 85, 95])
@pytest.mark.parametrize("size", [(8, 8), (320, 240), (640, 480), (2040, 16)])
def test_arrives_as_it_was_pixel_for_pixel(
    subsampling: str, quality: int, size: tuple[int, int]
) -> None:
    sent = jpeg(picture(*size), quality, subsampling)
    (file,) = together(JpegStream(), list(RtpJpegSender(1).packets(sent, 0.0)))
    assert seen(file).size == size
    assert seen(file).tobytes() == seen(sent).tobytes()


def test_packets_are_numbered_timed_and_short() -> None:
    sender = RtpJpegSender(0xDEADBEEF)
    packets = [*sender.packets(jpeg(picture()), 1.0), *sender.packets(jpeg(picture()), 1.2)]
    sequence = [int.from_bytes(packet[2:4]) for packet in packets]
    assert sequence == list(range(len(packets)))
    assert {packet[8:12] for packet in packets} == {bytes.fromhex("deadbeef")}
    assert {int.from_bytes(packet[4:8]) for packet in packets} == {90_000, 108_000}
    assert [packet[1] for packet in packets].count(0x80 | 26) == 2
    assert max(map(len, packets)) <= MAX_SCAN_OCTETS + RTP_HEADER + 8 + 4 + 128


def test_numbers_and_times_wrap() -> None:
    sender, stream = RtpJpegSender(1), JpegStream()
    sent = jpeg(picture(640, 480), 95)
    total = 0
    while total < 70_000:
        packets = list(sender.packets(sent, 1e6 + total))
        total += len(packets)
        assert len(together(stream, packets)) == 1


def test_order_within_a_picture_does_not_matter() -> None:
    sent = jpeg(picture())
    packets = list(RtpJpegSender(1).packets(sent, 0.0))
    Random(1).shuffle(packets)
    (file,) = together(JpegStream(), packets)
    assert seen(file).tobytes() == seen(sent).tobytes()


def test_a_lost_packet_costs_its_picture_only() -> None:
    sender, stream = RtpJpegSender(1), JpegStream()
    files = []
    for number in range(6):
        packets = list(sender.packets(jpeg(picture(seed=number)), number / 5))
        if number in (1, 3):
            del packets[number * len(packets) // 4]
        files += together(stream, packets)
    assert [seen(file).tobytes() for file in files] == [
        seen(jpeg(picture(seed=number))).tobytes() for number in (0, 2, 4, 5)
    ]
    assert stream.lost == 2


def test_an_invalid_picture_is_skipped() -> None:
    random, stream = Random(3), JpegStream()
    packets = list(RtpJpegSender(1).packets(jpeg(picture()), 0.0))
    for packet in packets:
        for length in (0, 1, 11, 12, 15, 19, 22, 30):
            stream.add(packet[:length])
        stream.add(random.randbytes(200))
        garbled = bytearray(packet)
        garbled[random.randrange(len(garbled))] ^= 0xFF
        stream.add(bytes(garbled))
    fresh = list(RtpJpegSender(2).packets(jpeg(picture()), 9.0))
    assert len(together(stream, fresh)) == 1


@pytest.mark.parametrize("size", [(12, 8), (8, 2048)])
def test_a_size_beyond_rtp_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="RTP carries no JPEG of"):
        list(RtpJpegSender(1).packets(jpeg(picture(*size)), 0.0))


def test_a_sampling_beyond_rtp_is_refused() -> None:
    with pytest.raises(ValueError, match="sampled 0x11"):
        list(RtpJpegSender(1).packets(jpeg(picture(), subsampling="4:4:4"), 0.0))


ROVER = "from adapters.cli.main import main; main()"
SIZE = (320, 240)


@pytest.fixture
def port() -> int:
    (port,) = free_udp_ports(1)
    return port


@pytest.fixture
def stream(port: int) -> Iterator[VideoStream]:
    with closing(VideoStream(HOST, port, *SIZE)) as stream:
        yield stream


def test_sends_only_to_listeners(stream: VideoStream, port: int) -> None:
    assert [stream.watched for _ in range(3)] == [False] * 3
    for _ in range(3):
        with udp_socket(port) as receiver:
            assert [stream.watched for _ in range(3)] == [False, True, True]
            stream.send(jpeg(picture()), 1.0)
            pictures, parts = None, JpegStream()
            while pictures is None:
                pictures = parts.add(receiver.recv(1 << 16))
            assert Image.open(io.BytesIO(pictures)).size == SIZE
        stream.send(jpeg(picture()), 1.2)
        assert [stream.watched for _ in range(3)] == [False] * 3


@pytest.mark.parametrize(
    ("host", "size", "why"),
    [
        (HOST, (322, 240), "RTP carries no JPEG of 322 x 240"),
        (HOST, (4096, 240), "RTP carries no JPEG of 4096 x 240"),
        ("256.0.0.1.", SIZE, "no video to 256"),
    ],
)
def test_a_stream_that_cannot_be(host: str, size: tuple[int, int], why: str) -> None:
    with pytest.raises(SettingsError, match=why):
        VideoStream(host, 5004, *size)


def test_rover_video_stores_the_last_picture(
    stream: VideoStream, port: int, tmp_path: Path
) -> None:
    file = tmp_path / "now.jpg"
    options = ("video", "--at", f"{HOST}:{port}", "--save", str(file), "--pictures", "3")
    with subprocess.Popen(
        [sys.executable, "-c", ROVER, *options], stdout=subprocess.PIPE, text=True
    ) as watching:
        number = 0
        while watching.poll() is None:
            if stream.watched:
                number += 1
                stream.send(jpeg(picture(seed=number)), number / 5)
        message = watching.stdout.read() if watching.stdout else ""
    assert watching.returncode == 0
    first, *_, last = message.splitlines()
    assert first == f"the first picture is in {file}"
    assert last.startswith("3 pictures, ")
    assert Image.open(io.BytesIO(file.read_bytes())).size == SIZE
    assert list(tmp_path.iterdir()) == [file]


def test_prints_a_player() -> None:
    result = CliRunner().invoke(main, ["video", "--at", "192.0.2.7:6000", "--sdp"])
    assert result.exit_code == 0
    assert "c=IN IP4 192.0.2.7\n" in result.output
    assert "m=video 6000 RTP/AVP 26\n" in result.output


def test_a_port_that_is_taken(port: int) -> None:
    with udp_socket(port):
        result = CliRunner().invoke(main, ["video", "--at", f"{HOST}:{port}"])
    assert result.exit_code == 1
    assert "Address already in use" in result.output
