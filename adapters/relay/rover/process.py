"""`rover-relay`: the process aboard that carries MOPS strings between ROS topics and bundles."""

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from typing import Final

from adapters.process import (
    add_data,
    add_log_level,
    data_folder,
    existing_file,
    log_to_stderr,
    split_ros_arguments,
)

DESCRIPTION: Final = """\
Carry MOPS strings between ROS topics and bundles of the relay until SIGINT or SIGTERM.

What waits for a contact is on the disk, and stays there however this ends. What follows
--ros-args goes to ROS.
"""

EPILOG: Final = """\
examples:
  rover-relay
  rover-relay --asset mocup
  rover-relay --config jackal2.relay.yaml --data relay2

exit status:
  0  ended by a signal; what waits goes on waiting
  1  cannot start or go on; the text says why
  2  the command line or a settings file makes no sense
"""


def parser() -> ArgumentParser:
    """Return the command line."""
    found = ArgumentParser(
        "rover-relay",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    found.add_argument("--asset", default="jackal", help="namespace of the rover [jackal]")
    found.add_argument(
        "--config",
        type=existing_file,
        metavar="YAML",
        help="endpoints, links, contact plan [ASSET.relay.yaml in config/]",
    )
    found.add_argument(
        "--ros-params",
        type=existing_file,
        metavar="YAML",
        help="topics of the relay [ASSET.nxt.yaml in config/ if it is there, else ASSET.ros.yaml]",
    )
    add_data(found, "the bundles")
    add_log_level(found)
    return found


def main() -> None:
    """Run it."""
    own, ros = split_ros_arguments(sys.argv[1:])
    line = parser()
    options = line.parse_args(own)
    from adapters.process.packages import NoRosError, require_ros

    try:
        require_ros()
    except NoRosError as error:
        sys.exit(f"Error: {error}")
    from adapters.relay.rover.node import Options, StartError, serve
    from adapters.relay.rover.settings import load_relay
    from adapters.ros import ParameterError
    from executive.settings import SettingsError

    log_to_stderr(options.log_level)
    asset = options.asset
    topics = options.ros_params or _topics(asset)
    data = data_folder(options, asset)
    try:
        settings, path = load_relay(asset, options.config)
        if not topics.is_file():
            line.error(
                f"{topics}: there is no such file; --ros-params names where the topics stand"
            )
        serve(Options(asset, settings, path, topics, data, tuple(ros)))
    except (SettingsError, ParameterError) as error:
        line.error(str(error))
    except StartError as error:
        sys.exit(f"Error: {error}")


def _topics(asset: str) -> Path:
    """Return where the topics stand: with the brick, if the rover has one, as it takes commands."""
    from executive.settings import config_folder

    brick = config_folder() / f"{asset}.nxt.yaml"
    return brick if brick.is_file() else config_folder() / f"{asset}.ros.yaml"


if __name__ == "__main__":
    main()
