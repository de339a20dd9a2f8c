"""Whether the packages that a process needs are there."""

from importlib.util import find_spec


class NoRosError(Exception):
    """ROS 2 is not installed; the text says how to get it."""


def require_ros() -> None:
    """Do nothing where rclpy can be imported.

    Raises:
        NoRosError: it cannot.
    """
    if find_spec("rclpy") is None:
        raise NoRosError(
            "ROS 2 is not installed here. On Linux x86_64 `./rover` brings it along; elsewhere"
            " install ROS 2 Jazzy and source its setup.sh first."
        )
