"""The forwarder between real sockets."""

import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import click
import pytest
import yaml
from click.testing import CliRunner

from adapters.cli.main import main as rover
from adapters.onboard.process import main
from adapters.video import VideoForwarder
from adapters.video.forwarder import ForwardingThread
from executive.settings import SettingsError, VideoSettings, config_folder, load_settings
from sim.ros.process import main as rover_sim
from tests.support.ports import free_udp_ports

HOST: Final = "127.0.0.1"
ANSWER_S: Final = 60.0


def udp_socket(port: int = 0, host: str = HOST) -> socket.socket:
    """Return a bound socket that gives up waiting in the end."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind((host, port))
    bound.settimeout(ANSWER_S)
    return bound


def wait_for(done: Callable[[], bool]) -> None:
    """Wait until something holds that another thread brings about."""
    end_s = time.monotonic() + ANSWER_S
    while not done():
        assert time.monotonic() < end_s, "waited in vain"
        time.sleep(0.001)


MAX_OCTETS = 65507


@pytest.fixture
def ground() -> Iterator[socket.socket]:
    """Give where the stream is to arrive."""
    with udp_socket() as receiver:
        yield receiver


@pytest.fixture
def settings(ground: socket.socket) -> VideoSettings:
    (port,) = free_udp_ports(1)
    return VideoSettings(HOST, port, *ground.getsockname())


@pytest.fixture
def forwarder(settings: VideoSettings) -> Iterator[VideoForwarder]:
    with closing(VideoForwarder(settings)) as forwarder:
        yield forwarder


@pytest.fixture
def source(settings: VideoSettings) -> Iterator[socket.socket]:
    """Give a source that sends to the port aboard."""
    with udp_socket() as sender:
        sender.connect((settings.listen_host, settings.listen_port))
        yield sender


def to(receiver: socket.socket) -> dict[str, Any]:
    """Return the part of the settings that leads to a receiver."""
    host, port = receiver.getsockname()
    return {"to_host": host, "to_port": port}


def refused(source: socket.socket) -> bool:
    """Whether nobody listens at the port aboard."""
    try:
        for _ in range(2):  # the answer to the first comes with the second
            source.send(b"anybody?")
    except ConnectionRefusedError:
        return True
    return False


@pytest.mark.parametrize("length", [0, 1, 12, 1400, MAX_OCTETS])
def test_forwards_octet_for_octet(
    forwarder: VideoForwarder, source: socket.socket, ground: socket.socket, length: int
) -> None:
    forwarder.set_enabled(True)
    sent = bytes(index * 7 % 251 for index in range(length))
    source.send(sent)
    assert ground.recv(1 << 16) == sent


def test_forwards_in_order(
    forwarder: VideoForwarder, settings: VideoSettings, ground: socket.socket
) -> None:
    forwarder.set_enabled(True)
    with udp_socket() as one, udp_socket() as other:
        for number in range(500):
            message = number.to_bytes(2)
            (one, other)[number % 2].sendto(message, (HOST, settings.listen_port))
            assert ground.recv(10) == message


def test_off_closes_the_port_and_on_opens_it_again(
    forwarder: VideoForwarder, source: socket.socket, ground: socket.socket
) -> None:
    assert not forwarder.enabled
    assert refused(source)
    for _ in range(3):
        forwarder.set_enabled(True)
        forwarder.set_enabled(True)
        source.send(b"picture")
        states = [forwarder.enabled]
        assert ground.recv(100) == b"picture"
        forwarder.set_enabled(False)
        forwarder.set_enabled(False)
        assert [*states, forwarder.enabled] == [True, False]
        assert refused(source)


def test_off_reports_the_sent_amount(
    forwarder: VideoForwarder,
    source: socket.socket,
    ground: socket.socket,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    forwarder.set_enabled(True)
    for message in (b"abc", b"de"):
        source.send(message)
        ground.recv(100)
    forwarder.set_enabled(False)
    assert "video off: 2 datagrams, 5 octets forwarded, 0 datagrams lost" in caplog.messages


def test_a_port_that_is_taken(forwarder: VideoForwarder, settings: VideoSettings) -> None:
    with udp_socket(settings.listen_port):
        with pytest.raises(OSError, match="in use") as raised:
            forwarder.set_enabled(True)
        states = [forwarder.enabled]
    assert raised.value.strerror == (
        f"cannot listen at UDP {HOST}:{settings.listen_port}: Address already in use"
    )
    forwarder.set_enabled(True)
    assert [*states, forwarder.enabled] == [False, True]


def test_an_address_that_is_not_here(settings: VideoSettings) -> None:
    forwarder = VideoForwarder(replace(settings, listen_host="192.0.2.1"))
    with pytest.raises(OSError, match="cannot listen at UDP 192"):
        forwarder.set_enabled(True)


@pytest.mark.parametrize(
    ("listen", "to"), [(HOST, HOST), ("0.0.0.0", HOST), ("0.0.0.0", "127.255.255.255")]
)
def test_a_loop_is_refused(settings: VideoSettings, listen: str, to: str) -> None:
    looped = replace(settings, listen_host=listen, to_host=to, to_port=settings.listen_port)
    forwarder = VideoForwarder(looped)
    with pytest.raises(OSError, match="is its own port: a loop"):
        forwarder.set_enabled(True)
    assert not forwarder.enabled


def test_a_destination_that_refuses_does_not_end_it(
    settings: VideoSettings, source: socket.socket, ground: socket.socket
) -> None:
    address = ground.getsockname()
    ground.close()
    with closing(VideoForwarder(settings)) as forwarder:
        forwarder.set_enabled(True)
        for _ in range(100):
            source.send(b"into the void")
        with udp_socket(address[1]) as late:
            for _ in range(100):  # what is on its way when it opens may come too
                source.send(b"now")
            while late.recv(100) != b"now":
                pass
        assert forwarder.enabled


def test_an_unsendable_picture_is_counted_and_reported_once(
    settings: VideoSettings, source: socket.socket, caplog: pytest.LogCaptureFixture
) -> None:
    receiver, sink = udp_socket(settings.listen_port), udp_socket()
    with closing(
        ForwardingThread(receiver, sink, ("192.0.2.1", 1))
    ) as relay:  # no way from loopback
        for _ in range(5):
            source.send(b"x")
        wait_for(lambda: relay.lost == 5)
        assert relay.runs
        assert relay.datagrams == 0
    (reported,) = caplog.messages
    assert reported.startswith("video cannot be sent to 192.0.2.1: ")


def test_goes_to_a_broadcast_address(settings: VideoSettings, source: socket.socket) -> None:
    with (
        udp_socket(host="127.255.255.255") as listener,
        closing(VideoForwarder(replace(settings, **to(listener)))) as forwarder,
    ):
        forwarder.set_enabled(True)
        source.send(b"to all")
        assert listener.recv(100) == b"to all"


class Names:
    """A name service that answers when it is told to, and knows `ground` only when it is up."""

    def __init__(self) -> None:
        self.up = False
        self.requested = threading.Semaphore(0)
        self._answers = threading.Semaphore(0)
        self._look_up = socket.getaddrinfo

    def __call__(self, host: str, port: int, *, type: int, flags: int) -> object:
        if host != "ground" or flags & socket.AI_NUMERICHOST:
            return self._look_up(host, port, type=type, flags=flags)
        self.requested.release()
        self._answers.acquire()
        if not self.up:
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return self._look_up(HOST, port, type=type, flags=flags)

    def answer(self) -> None:
        """Answer one question, and wait until that is known."""
        self.requested.acquire()
        self._answers.release()
        for thread in threading.enumerate():
            if thread.name == "host":
                thread.join()


def test_a_name_is_looked_up_without_waiting_for_it(
    settings: VideoSettings,
    source: socket.socket,
    ground: socket.socket,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = Names()
    monkeypatch.setattr(socket, "getaddrinfo", names)
    with closing(VideoForwarder(replace(settings, to_host="ground"))) as forwarder:
        with pytest.raises(OSError, match="ground is being resolved: try again in a moment"):
            forwarder.set_enabled(True)
        names.answer()
        with pytest.raises(OSError, match="unknown host ground"):
            forwarder.set_enabled(True)
        assert not forwarder.enabled
        names.up = True
        names.answer()
        forwarder.set_enabled(True)
        source.send(b"found")
        assert ground.recv(100) == b"found"


USAGE = 2


def settings_file(folder: Path, video: dict[str, object] | None) -> Path:
    """Write settings of a Jackal with another section video, or none."""
    settings = yaml.safe_load((config_folder() / "jackal.yaml").read_text())
    del settings["video"]
    file = folder / "scout.yaml"
    file.write_text(yaml.safe_dump(settings if video is None else {**settings, "video": video}))
    return file


def test_the_jackal_has_a_video_stream() -> None:
    assert load_settings("jackal").video == VideoSettings("127.0.0.1", 5004, "127.0.0.1", 5006)


def test_an_asset_needs_none(tmp_path: Path) -> None:
    assert load_settings(str(settings_file(tmp_path, None))).video is None


@pytest.mark.parametrize(
    "change", [{"to_port": 0}, {"listen_port": 65536}, {"to_host": None}, {"codec": "h264"}]
)
def test_settings_that_make_no_sense(tmp_path: Path, change: dict[str, object]) -> None:
    video = {"listen_host": "a", "listen_port": 1, "to_host": "b", "to_port": 2, **change}
    if video["to_host"] is None:
        del video["to_host"]
    with pytest.raises(SettingsError, match="video"):
        load_settings(str(settings_file(tmp_path, video)))


@pytest.mark.parametrize(
    ("process", "option"),
    [(main, "--video-to"), (main, "--video-from"), (rover_sim, "--video-to"), (rover, "--at")],
)
@pytest.mark.parametrize("at", ["here", "here:0", ":5006", "here:70000", "here:port"])
def test_no_address_is_a_usage_error(process: click.Command, option: str, at: str) -> None:
    typed = [option, at] if process is not rover else ["video", option, at]
    done = CliRunner().invoke(process, typed)
    assert done.exit_code == USAGE
    assert "is not HOST:PORT" in done.output


def test_an_asset_without_video_cannot_receive_a_destination(tmp_path: Path) -> None:
    typed = ["--asset", str(settings_file(tmp_path, None)), "--video-to", "192.0.2.7:5006"]
    done = CliRunner().invoke(main, typed)
    assert done.exit_code == USAGE
    assert "its settings have no section video" in done.output
