"""The process `rover-executive`, on the rover: its command line. `service` serves the asset."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from adapters.mal import is_loopback
from adapters.mrs.cli import add_terms_options
from adapters.mrs.spec import PORT
from adapters.mrs.transport import TransportSettings
from adapters.process import (
    EXISTING_FILE,
    PORT_NUMBER,
    asset_option,
    data_option,
    default_folder,
    log_level_option,
    metrics_option,
    process,
    take_priority,
)
from adapters.video import parse_address

if TYPE_CHECKING:
    from executive.settings import Settings

Address = tuple[str, int]


def _udp_address(_: click.Context, __: click.Parameter, text: str | None) -> Address | None:
    try:
        return None if text is None else parse_address(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error


@process("rover-executive")
@asset_option()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address of the MRS link.")
@click.option(
    "--port",
    type=PORT_NUMBER,
    default=PORT,
    show_default=True,
    help="TCP port of the MRS link; 0 takes a free one, which is printed.",
)
@add_terms_options("rover")
@click.option(
    "--video-from",
    callback=_udp_address,
    metavar="HOST:PORT",
    help="UDP address that receives the video stream.  [default: section video of the asset]",
)
@click.option(
    "--video-to",
    callback=_udp_address,
    metavar="HOST:PORT",
    help="UDP address to forward the video stream to.  [default: section video of the asset]",
)
@click.option(
    "--service-layer",
    metavar="URI",
    help="MRS link of another rover, to register at: both then connect.  [default: none]",
)
@click.option(
    "--relay",
    is_flag=True,
    help="Serve the relay link too: MOPS strings on ROS topics, to and from rover-relay.",
)
@metrics_option
@data_option("ledger and files")
@click.option(
    "--ros-params",
    type=EXISTING_FILE,
    help="ROS parameter file.  [default: ASSET.ros.yaml beside the asset, or in config/]",
)
@log_level_option
@click.pass_obj
def main(
    ros_arguments: tuple[str, ...],
    asset: str,
    host: str,
    port: int,
    terms: TransportSettings,
    clear_text: bool,
    video_from: Address | None,
    video_to: Address | None,
    service_layer: str | None,
    relay: bool,
    metrics: Address | None,
    data: Path | None,
    ros_params: Path | None,
) -> None:
    """Run the executive of an asset until SIGINT or SIGTERM.

    It prints the address of its MRS link, then logs one line per event. At the end the rover
    stops, and active commands end CANCELLED. Arguments after --ros-args are passed to ROS.

    \b
    Examples:
      rover-executive
      rover-executive --port 0 --data rover1
      rover-executive --host 0.0.0.0 --certificate rover.pem --key rover.key \\
          --authorities ground.pem
      rover-executive --video-to 192.0.2.7:5006
      rover-executive --asset scout --port 21001 --service-layer 127.0.0.1:21000
      rover-executive --ros-args -p use_sim_time:=true -r __ns:=/rover1

    \b
    Exit status:
      0  ended by a signal, the rover standing
      1  cannot start; the text gives the cause
      2  the command line or a settings file is invalid
    """
    from adapters.mrs.ground import parse_address as parse_mrs_address
    from adapters.onboard.service import ExecutiveOptions, serve
    from executive.settings import asset_file, load_settings, ros_parameter_file

    settings = _with_video(load_settings(asset), video_from, video_to).for_access(
        by_others=not is_loopback(host)
    )
    try:
        above = None if service_layer is None else parse_mrs_address(service_layer)
    except ValueError as error:
        raise click.UsageError(f"--service-layer: {error}") from error
    take_priority()
    serve(
        ExecutiveOptions(
            settings,
            host,
            port,
            data or default_folder(settings.asset),
            ros_params or ros_parameter_file(settings.asset, asset_file(asset).parent),
            ros_arguments,
            clear_text,
            terms,
            above,
            relay,
            metrics,
        )
    )


def _with_video(
    settings: "Settings", listen: Address | None, destination: Address | None
) -> "Settings":
    """Return the settings with the video addresses of the command line."""
    if listen is None and destination is None:
        return settings
    video = settings.video
    if video is None:
        raise click.UsageError(f"{settings.asset} has no video: its settings have no section video")
    if listen is not None:
        video = replace(video, listen_host=listen[0], listen_port=listen[1])
    if destination is not None:
        video = replace(video, to_host=destination[0], to_port=destination[1])
    return replace(settings, video=video)


if __name__ == "__main__":
    main()
