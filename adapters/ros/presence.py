"""Whether ROS 2 is here at all."""

from importlib.util import find_spec

import click


def require_ros() -> None:
    """Do nothing where rclpy can be imported.

    Raises:
        click.ClickException: it cannot; the text says how to get it.
    """
    if find_spec("rclpy") is None:
        raise click.ClickException(
            "ROS 2 is not installed here. On Linux x86_64 `./rover` brings it along; elsewhere"
            " install ROS 2 Jazzy and source its setup.sh first."
        )
