"""The command `rover video`, on the ground: checks whether pictures arrive, without a player."""

from pathlib import Path
from typing import Final

import click

ADDRESS: Final = "127.0.0.1:5006"
NO_PICTURE_S: Final = 5.0
PROGRESS_S: Final = 1.0
HINT: Final = (
    "no datagrams at {}: send `rover command action VIDEO ON`,"
    " and check that the rover forwards to this address"
)
SDP: Final = """\
v=0
o=- 0 0 IN {family} {host}
s=rover
c=IN {family} {host}
t=0 0
m=video {port} RTP/AVP 26
a=rtpmap:26 JPEG/90000
"""


@click.command()
@click.option(
    "--at",
    default=ADDRESS,
    show_default=True,
    metavar="HOST:PORT",
    help="Address that receives the stream: the rover's --video-to.",
)
@click.option(
    "--save",
    type=click.Path(dir_okay=False, path_type=Path),
    default="video.jpg",
    show_default=True,
    help="The file for the last picture.",
)
@click.option(
    "--pictures", type=click.IntRange(1), metavar="N", help="End after N; Ctrl-C otherwise."
)
@click.option("--sdp", is_flag=True, help="Print the session description (SDP), and end.")
def video(at: str, save: Path, pictures: int | None, sdp: bool) -> None:
    """Receive the rover's video (RTP/JPEG over UDP) and write the last picture to a file.

    \b
    Examples:
      rover video
      rover video --pictures 1 --save now.jpg
      rover video --sdp > rover.sdp && ffplay -protocol_whitelist file,udp,rtp rover.sdp
    """
    from adapters.video.forwarder import parse_address

    try:
        host, port = parse_address(at)
    except ValueError as error:
        raise click.UsageError(f"--at: {error}") from error
    if sdp:
        family = "IP6" if ":" in host else "IP4"
        click.echo(SDP.format(family=family, host=host, port=port), nl=False)
        return
    _receive(host, port, save, pictures)


def _receive(host: str, port: int, save: Path, maximum: int | None) -> None:
    import socket
    from time import monotonic

    from adapters.video.jpeg_stream import JpegStream

    stream, count, shown, shown_at_s = JpegStream(), 0, 0, 0.0
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind((host, port))
        except OSError as error:
            raise click.ClickException(f"cannot listen at {host}:{port}: {error}") from error
        receiver.settimeout(NO_PICTURE_S)
        while maximum is None or count < maximum:
            try:
                picture = stream.add(receiver.recv(1 << 16))
            except TimeoutError:
                click.echo(HINT.format(f"{host}:{port}"), err=True)
                continue
            if picture is None:
                continue
            _replace(save, picture)
            count, now_s = count + 1, monotonic()
            if count == 1:
                click.echo(f"the first picture is in {save}")
                shown, shown_at_s = 1, now_s
            elif now_s - shown_at_s >= PROGRESS_S:
                rate_hz = (count - shown) / (now_s - shown_at_s)
                click.echo(f"{rate_hz:.1f} pictures a second, {stream.lost} lost")
                shown, shown_at_s = count, now_s
    click.echo(f"{count} pictures, {stream.lost} lost")


def _replace(path: Path, content: bytes) -> None:
    """Replace a file atomically, so that readers always see a complete one."""
    fresh = path.with_name(f".{path.name}.new")
    fresh.write_bytes(content)
    fresh.replace(path)
