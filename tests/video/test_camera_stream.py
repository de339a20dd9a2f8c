"""The simulated camera's stream: sent only where somebody listens; and `rover video`, who does."""

import io
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image

from adapters.cli.main import main
from adapters.video import JpegStream
from sim.ros.video_stream import VideoError, VideoStream
from tests.video.test_forwarder import HOST, free_port, udp_socket
from tests.video.test_pictures import jpeg, picture

ROVER = "from adapters.cli.main import main; main()"
SIZE = (320, 240)


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def stream(port: int) -> Iterator[VideoStream]:
    with closing(VideoStream(HOST, port, *SIZE)) as stream:
        yield stream


def test_sends_only_while_somebody_listens(stream: VideoStream, port: int) -> None:
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
    with pytest.raises(VideoError, match=why):
        VideoStream(host, 5004, *size)


def test_rover_video_keeps_the_last_picture(stream: VideoStream, port: int, tmp_path: Path) -> None:
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
        said = watching.stdout.read() if watching.stdout else ""
    assert watching.returncode == 0
    first, *_, last = said.splitlines()
    assert first == f"the first picture is in {file}"
    assert last.startswith("3 pictures, ")
    assert Image.open(io.BytesIO(file.read_bytes())).size == SIZE
    assert list(tmp_path.iterdir()) == [file]


def test_tells_a_player() -> None:
    result = CliRunner().invoke(main, ["video", "--at", "192.0.2.7:6000", "--sdp"])
    assert result.exit_code == 0
    assert "c=IN IP4 192.0.2.7\n" in result.output
    assert "m=video 6000 RTP/AVP 26\n" in result.output


def test_a_port_that_is_taken(port: int) -> None:
    with udp_socket(port):
        result = CliRunner().invoke(main, ["video", "--at", f"{HOST}:{port}"])
    assert result.exit_code == 1
    assert "Address already in use" in result.output
