"""Shared by all server processes: command line, folder, log, signals, exit status; no links."""

from adapters.process.command import EXISTING_FILE as EXISTING_FILE
from adapters.process.command import PORT_NUMBER as PORT_NUMBER
from adapters.process.command import ROS_ARGS as ROS_ARGS
from adapters.process.command import StartError as StartError
from adapters.process.command import Termination as Termination
from adapters.process.command import asset_option as asset_option
from adapters.process.command import data_option as data_option
from adapters.process.command import default_folder as default_folder
from adapters.process.command import exclusive as exclusive
from adapters.process.command import guard_output as guard_output
from adapters.process.command import log_level_option as log_level_option
from adapters.process.command import log_to_stderr as log_to_stderr
from adapters.process.command import metrics_option as metrics_option
from adapters.process.command import process as process
from adapters.process.command import termination_event as termination_event
from adapters.process.service_manager import ALIVE as ALIVE
from adapters.process.service_manager import announce as announce
from adapters.process.service_manager import notify as notify
from adapters.process.service_manager import watchdog_period_s as watchdog_period_s
from adapters.process.start import missing_package as missing_package
from adapters.process.start import program as program
from adapters.process.start import require as require
from adapters.process.usage import NICE as NICE
from adapters.process.usage import ResourceMonitor as ResourceMonitor
from adapters.process.usage import ResourceUsage as ResourceUsage
from adapters.process.usage import take_priority as take_priority
