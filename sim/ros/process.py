"""The process `rover-sim`: its command line. `service` simulates the rover on ROS."""

from pathlib import Path
from typing import Any, Final

import click

from adapters.process import EXISTING_FILE, asset_option, log_level_option, process, take_priority

NO_PICTURES: Final = "off"


def _address(_: click.Context, __: click.Parameter, text: str | None) -> tuple[str, int] | None:
    from adapters.video import parse_address

    try:
        return None if text is None else parse_address(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error


@process("rover-sim")
@asset_option()
@click.option(
    "--world",
    default="rough",
    show_default=True,
    help="Name of a world in config/worlds, or its YAML file.",
)
@click.option("--seed", default=0, show_default=True, help="Seed of all sensor noise.")
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 20.0),
    default=1.0,
    show_default=True,
    help="Simulated seconds per second on /clock. At another speed than 1 the executive"
    " needs --ros-args -p use_sim_time:=true.",
)
@click.option(
    "--paced",
    is_flag=True,
    help="Wait for late ticks of the executive on /clock, which needs use_sim_time as well: slower"
    " than real time while this computer is too busy.",
)
@click.option(
    "--camera",
    type=click.Choice(["auto", "egl", "rays", NO_PICTURES]),
    default="auto",
    show_default=True,
    help="Renderer of the pictures: auto uses EGL if installed, else ray casting.",
)
@click.option(
    "--video-to",
    metavar="HOST:PORT",
    callback=_address,
    help="Stream the camera by UDP as RTP/JPEG, while a receiver listens.  [default: none]",
)
@click.option(
    "--usb-socket",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Socket of the brick, for a rover that has one.  [default: ASSET.usb in /tmp]",
)
@click.option(
    "--ros-params",
    type=EXISTING_FILE,
    help="ROS parameter file.  [default: ASSET.ros.yaml beside the asset, or in config/]",
)
@log_level_option
@click.pass_obj
def main(
    ros_arguments: tuple[str, ...],
    /,
    asset: str,
    world: str,
    usb_socket: Path | None,
    ros_params: Path | None,
    **simulated: Any,
) -> None:
    """Simulate a rover on ROS topics until SIGINT or SIGTERM.

    It publishes odometry, battery, camera angles, pictures if subscribed, the true pose and
    /clock; it executes cmd_vel and camera commands. A rover that executes whole motions is
    controlled by its brick instead, on an emulated USB cable: python -m sim.brick.nxt is the
    other end. Arguments after --ros-args are passed to ROS.

    \b
    Examples:
      rover-sim
      rover-sim --world slope --seed 3 --speed 2
      rover-sim --asset mocup --usb-socket brick.usb
      rover-sim --video-to 127.0.0.1:5004
      rover-sim --ros-args -r __ns:=/rover1
    """
    from tempfile import gettempdir

    from executive.settings import (
        asset_file,
        config_folder,
        load_settings,
        named_file,
        ros_parameter_file,
    )
    from sim.ros.service import SimulationOptions, serve
    from sim.rover import load_world

    file = Path(world) if world.endswith((".yaml", ".yml")) else None
    settings = load_settings(asset)
    ground = load_world(file or named_file("world", world, config_folder() / "worlds"))
    parameters = ros_params or ros_parameter_file(settings.asset, asset_file(asset).parent)
    take_priority()
    usb = usb_socket or Path(gettempdir()) / f"{settings.asset}.usb"
    serve(SimulationOptions(settings, ground, parameters, ros_arguments, usb, **simulated))


if __name__ == "__main__":
    main()
