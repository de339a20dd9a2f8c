"""One way to be a process, for all that serve: command line, folder, log, signals, exit status.

It knows no links and no rovers.
"""

from adapters.process.command import (
    EXISTING_FILE,
    PORT_NUMBER,
    ROS_ARGS,
    StartError,
    asset_option,
    data_option,
    log_level_option,
    process,
)
from adapters.process.folder import default_folder, exclusive
from adapters.process.log import log_to_stderr
from adapters.process.output import guard_output
from adapters.process.signals import Termination, termination_event
from adapters.process.start import missing_package, require
from adapters.process.usage import ProcessUsage, Usage

__all__ = [
    "EXISTING_FILE",
    "PORT_NUMBER",
    "ROS_ARGS",
    "ProcessUsage",
    "StartError",
    "Termination",
    "Usage",
    "asset_option",
    "data_option",
    "default_folder",
    "exclusive",
    "guard_output",
    "log_level_option",
    "log_to_stderr",
    "missing_package",
    "process",
    "require",
    "termination_event",
]
