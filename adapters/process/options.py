"""Options that the command lines of the processes share."""

import os
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Final

HIGHEST_PORT: Final = 65535


def port(text: str) -> int:
    """Return a TCP or UDP port, 0 for any that is free; an argparse type.

    Raises:
        ArgumentTypeError: it is none.
    """
    if not (text.isdecimal() and int(text) <= HIGHEST_PORT):
        raise ArgumentTypeError(f"{text} is not a port of 0 to {HIGHEST_PORT}")
    return int(text)


def existing_file(text: str) -> Path:
    """Return the path of a file; an argparse type.

    Raises:
        ArgumentTypeError: there is none.
    """
    if not Path(text).is_file():
        raise ArgumentTypeError(f"there is no file {text}")
    return Path(text)


def add_data(line: ArgumentParser, contents: str, name: str = "ASSET") -> None:
    """Add `--data`, the folder where a process keeps what must survive it.

    Args:
        line: the command line.
        contents: what lies there.
        name: the folder's name if nobody says otherwise.
    """
    line.add_argument(
        "--data",
        type=Path,
        default=os.environ.get("ROVER_DATA"),
        help=f"folder of {contents} [$ROVER_DATA, or ~/.local/share/rover/{name}]",
    )


def data_folder(options: Namespace, name: str) -> Path:
    """Return the folder that `--data` names, or that of a name."""
    chosen: Path | None = options.data
    return default_folder(name) if chosen is None else chosen


def default_folder(name: str) -> Path:
    """Return where a process keeps its files if nobody says otherwise."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "rover" / name


def add_log_level(line: ArgumentParser) -> None:
    """Add `--log-level`."""
    line.add_argument(
        "--log-level",
        choices=["debug", "info", "warning", "error"],
        default="info",
        help="the least that is logged, on standard error [info]",
    )


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
