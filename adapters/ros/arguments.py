"""Which of a command line's arguments are for ROS."""

from collections.abc import Sequence
from typing import Final

ROS_ARGS: Final = "--ros-args"


def split_ros_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return a command line's own arguments, and those between `--ros-args` and `--`."""
    own: list[str] = []
    ros: list[str] = []
    into = own
    for argument in arguments:
        if argument == ROS_ARGS:
            into = ros
        elif argument == "--" and into is ros:
            into = own
        else:
            into.append(argument)
    return own, ros
