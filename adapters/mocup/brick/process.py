"""The process `rover-nxt`, on the rover: its command line; `serve_brick` connects MOCUP's brick."""

import logging
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.process import (
    EXISTING_FILE,
    StartError,
    Termination,
    announce,
    asset_option,
    data_option,
    default_folder,
    exclusive,
    log_level_option,
    process,
    require,
    take_priority,
)

if TYPE_CHECKING:
    from usb.backend import IBackend

_LOG: Final = logging.getLogger(__name__)


def brick_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of `serve_brick`, and pass on the ROS arguments."""
    for option in (
        click.pass_obj,
        log_level_option,
        data_option("the brick's commands"),
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
        asset_option("Namespace of the rover.", default="mocup"),
    ):
        function = option(function)
    return function


@process("rover-nxt")
@brick_options
def main(ros_arguments: tuple[str, ...], **options: Any) -> None:
    """Carry MOPS strings between ROS topics and a brick on USB until SIGINT or SIGTERM.

        A brick that is unplugged is searched for until it is connected again. Arguments after
        --ros-args are passed to ROS.

    \b
    Examples:
      rover-nxt
      rover-nxt --asset mocup2 --brick-params mocup2.nxt.yaml
      rover-nxt --ros-args -p usb.product_id:=3

    \b
    Exit status:
      0  ended by a signal, the brick released
      1  cannot start; the text gives the cause
      2  the command line or a settings file is invalid
    """
    require("usb")
    from adapters.mocup.brick.usb import libusb

    take_priority()
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
    """Serve the brick until SIGINT or SIGTERM; it is released however the process ends.

    Args:
        backend: USB backend.
        ros_arguments: arguments passed to ROS unchanged.
        asset: namespace of the rover.
        ros_params: ROS parameter file of the rover's topics; None selects that of the asset.
        brick_params: ROS parameter file of the brick; None selects that of the asset.
        data: folder of the record; None selects that of the asset.

    Raises:
        executive.settings.SettingsError: a ROS parameter or argument, or the MOPS dictionary,
            is invalid.
        StartError: the folder or the record cannot be used.
    """
    from adapters.mocup.brick.node import NODE_NAME, NxtNode, declare_settings
    from adapters.mocup.brick.record import BrickRecord
    from adapters.mocup.brick.usb import Brick
    from adapters.ros import declare_topics, ros_node, single_threaded
    from executive.record import LedgerError
    from executive.settings import config_folder

    topics = ros_params or config_folder() / f"{asset}.ros.yaml"
    brick = brick_params or config_folder() / f"{asset}.nxt.yaml"
    for path, option, what in (
        (topics, "--ros-params", "the file of the rover's topics"),
        (brick, "--brick-params", "the file of the brick and its topics"),
    ):
        if not path.is_file():
            raise click.UsageError(f"{path}: there is no such file; {option} names {what}")
    data = data or default_folder(asset)
    termination = Termination()
    try:
        with (
            exclusive(data, "nxt.lock"),
            closing(BrickRecord(data / "nxt.sqlite")) as record,
            ros_node(
                NODE_NAME,
                asset,
                parameters=topics,
                ros_arguments=("--params-file", str(brick), *ros_arguments),
            ) as node,
            single_threaded(node) as executor,
        ):
            settings = declare_settings(node)
            address, measured = settings.address, declare_topics(node)
            served = NxtNode(node, measured, settings, record, lambda: Brick(address, backend))
            with closing(served):
                announce(f"{settings.brick} is served for {asset}, USB {address}")
                while not termination.requested:
                    executor.spin_once()
                _LOG.info("termination requested: the brick is released")
    except LedgerError as error:
        raise StartError(str(error)) from error


if __name__ == "__main__":
    main()
