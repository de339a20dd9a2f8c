"""`rover-nxt`: the process aboard that speaks to MOCUP's brick."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from adapters.process import (
    EXISTING_FILE,
    data_option,
    default_folder,
    log_level_option,
    process,
    require,
)

if TYPE_CHECKING:
    from usb.backend import IBackend


def brick_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options that `serve_brick` takes, and pass them on with what is for ROS."""
    for option in (
        click.pass_obj,
        log_level_option,
        data_option("what the brick was asked"),
        click.option(
            "--brick-params",
            type=EXISTING_FILE,
            help="The brick and its topics.  [default: ASSET.nxt.yaml in config/]",
        ),
        click.option(
            "--ros-params",
            type=EXISTING_FILE,
            help="Topics of the rover.  [default: ASSET.ros.yaml in config/]",
        ),
        click.option("--asset", default="mocup", show_default=True, help="Namespace of the rover."),
    ):
        function = option(function)
    return function


@process("rover-nxt")
@brick_options
def main(ros_arguments: tuple[str, ...], **options: Any) -> None:
    """Carry MOPS strings between ROS topics and a brick on USB until SIGINT or SIGTERM.

    A brick that is unplugged is looked for until it is there again. What follows --ros-args goes to
    ROS.

    \b
    Examples:
      rover-nxt
      rover-nxt --asset mocup2 --brick-params mocup2.nxt.yaml
      rover-nxt --ros-args -p usb.product_id:=3

    \b
    Exit status:
      0  ended by a signal, the brick released
      1  cannot start; the text says why
      2  the command line or a settings file makes no sense
    """
    require("usb")
    from adapters.mocup.brick.usb import libusb

    serve_brick(libusb(), ros_arguments, **options)


def serve_brick(
    backend: "IBackend",
    ros_arguments: tuple[str, ...],
    *,
    asset: str,
    ros_params: Path | None,
    brick_params: Path | None,
    data: Path | None,
) -> None:
    """Serve as a command line says, by what speaks USB."""
    from adapters.mocup.brick.node import serve
    from executive.settings import config_folder

    topics = ros_params or config_folder() / f"{asset}.ros.yaml"
    brick = brick_params or config_folder() / f"{asset}.nxt.yaml"
    for path, option, what in (
        (topics, "--ros-params", "the rover's topics stand"),
        (brick, "--brick-params", "the brick and its topics stand"),
    ):
        if not path.is_file():
            raise click.UsageError(f"{path}: there is no such file; {option} names where {what}")
    serve(asset, topics, brick, data or default_folder(asset), ros_arguments, backend)


if __name__ == "__main__":
    main()
