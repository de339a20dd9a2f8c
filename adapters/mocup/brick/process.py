"""`rover-nxt`: the process aboard that speaks to MOCUP's brick."""

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from adapters.process import (
    add_data,
    add_log_level,
    data_folder,
    existing_file,
    log_to_stderr,
    split_ros_arguments,
)

if TYPE_CHECKING:
    from usb.backend import IBackend

DESCRIPTION: Final = """\
Carry MOPS strings between ROS topics and a brick on USB until SIGINT or SIGTERM.

A brick that is unplugged is looked for until it is there again. What follows --ros-args goes to
ROS.
"""

EPILOG: Final = """\
examples:
  rover-nxt
  rover-nxt --asset mocup2 --brick-params mocup2.nxt.yaml
  rover-nxt --ros-args -p usb.product_id:=3

exit status:
  0  ended by a signal, the brick released
  1  cannot start; the text says why
  2  the command line or a settings file makes no sense
"""


def parser(name: str = "rover-nxt") -> ArgumentParser:
    """Return the command line."""
    found = ArgumentParser(
        name,
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    found.add_argument("--asset", default="mocup", help="namespace of the rover [mocup]")
    found.add_argument(
        "--ros-params", type=existing_file, help="topics of the rover [ASSET.ros.yaml in config/]"
    )
    found.add_argument(
        "--brick-params",
        type=existing_file,
        help="the brick and its topics [ASSET.nxt.yaml in config/]",
    )
    add_data(found, "what the brick was asked")
    add_log_level(found)
    return found


def main() -> None:
    """Run it on this machine's USB."""
    from importlib.util import find_spec

    own, ros = split_ros_arguments(sys.argv[1:])
    line = parser()
    line.parse_args(own)
    if find_spec("usb") is None:
        sys.exit("Error: pyusb is not installed: pip install 'rover-executive[nxt]'")
    from adapters.mocup.brick.usb import NoLibusbError, libusb

    try:
        run(line, own, ros, libusb())
    except NoLibusbError as error:
        sys.exit(f"Error: {error}")


def run(line: ArgumentParser, own: Sequence[str], ros: Sequence[str], backend: "IBackend") -> None:
    """Serve as a command line says, by what speaks USB."""
    from adapters.process.packages import NoRosError, require_ros

    try:
        require_ros()
    except NoRosError as error:
        sys.exit(f"Error: {error}")
    from adapters.mocup.brick.node import Options, StartError, serve
    from adapters.ros import ParameterError
    from executive.settings import SettingsError, config_folder

    options = line.parse_args(own)
    log_to_stderr(options.log_level)
    topics = options.ros_params or config_folder() / f"{options.asset}.ros.yaml"
    brick = options.brick_params or config_folder() / f"{options.asset}.nxt.yaml"
    for path, option, what in (
        (topics, "--ros-params", "the rover's topics stand"),
        (brick, "--brick-params", "the brick and its topics stand"),
    ):
        if not path.is_file():
            line.error(f"{path}: there is no such file; {option} names where {what}")
    try:
        data = data_folder(options, options.asset)
        serve(Options(options.asset, topics, brick, data, tuple(ros)), backend)
    except (SettingsError, ParameterError) as error:
        line.error(str(error))
    except StartError as error:
        sys.exit(f"Error: {error}")


if __name__ == "__main__":
    main()
