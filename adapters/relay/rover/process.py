"""The process `rover-relay`, on the rover: its command line. `node` carries MOPS strings."""

from pathlib import Path

import click

from adapters.process import (
    EXISTING_FILE,
    asset_option,
    data_option,
    default_folder,
    log_level_option,
    process,
)


@process("rover-relay")
@asset_option("Namespace of the rover.")
@click.option(
    "--config",
    type=EXISTING_FILE,
    metavar="YAML",
    help="Endpoints, links, contact plan.  [default: ASSET.relay.yaml in config/]",
)
@click.option(
    "--ros-params",
    type=EXISTING_FILE,
    metavar="YAML",
    help="Topics of the relay.  [default: ASSET.nxt.yaml in config/ if it is there, else"
    " ASSET.ros.yaml]",
)
@data_option("the bundles")
@log_level_option
@click.pass_obj
def main(
    ros_arguments: tuple[str, ...],
    asset: str,
    config: Path | None,
    ros_params: Path | None,
    data: Path | None,
) -> None:
    """Carry MOPS strings between ROS topics and bundles of the relay until SIGINT or SIGTERM.

    Bundles that wait for a contact are on the disk, and survive any end of the process. Arguments
    after --ros-args are passed to ROS.

    \b
    Examples:
      rover-relay
      rover-relay --asset mocup
      rover-relay --config jackal2.relay.yaml --data relay2

    \b
    Exit status:
      0  ended by a signal; queued bundles are retained
      1  cannot start or continue; the text gives the reason
      2  the command line or a settings file is invalid
    """
    from adapters.relay.rover.node import serve
    from adapters.relay.rover.settings import load_relay

    topics = ros_params or _topics_file(asset)
    settings, path = load_relay(asset, config)
    if not topics.is_file():
        raise click.UsageError(
            f"{topics}: file not found; --ros-params names the file with the topics"
        )
    serve(asset, settings, path, topics, data or default_folder(asset), ros_arguments)


def _topics_file(asset: str) -> Path:
    """Return the file with the topics: that of the brick if the rover has one, else of ROS."""
    from executive.settings import config_folder

    brick = config_folder() / f"{asset}.nxt.yaml"
    return brick if brick.is_file() else config_folder() / f"{asset}.ros.yaml"


if __name__ == "__main__":
    main()
