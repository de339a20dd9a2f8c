"""What the processes that serve have in common."""

from adapters.process.folder import FolderError, exclusive
from adapters.process.logs import log_to_stderr
from adapters.process.options import (
    ROS_ARGS,
    add_data,
    add_log_level,
    data_folder,
    existing_file,
    port,
    split_ros_arguments,
)
from adapters.process.signals import Termination

__all__ = [
    "ROS_ARGS",
    "FolderError",
    "Termination",
    "add_data",
    "add_log_level",
    "data_folder",
    "exclusive",
    "existing_file",
    "log_to_stderr",
    "port",
    "split_ros_arguments",
]
