"""Sessions with rovers: received data as messages, commands as requests of the core."""

from adapters.console.rovers.command_form import InvalidArgument as InvalidArgument
from adapters.console.rovers.command_form import request_of as request_of
from adapters.console.rovers.dictionary import FORMS as FORMS
from adapters.console.rovers.dictionary import AssetEntry as AssetEntry
from adapters.console.rovers.dictionary import ParameterEntry as ParameterEntry
from adapters.console.rovers.dictionary import RecordingEntry as RecordingEntry
from adapters.console.rovers.dictionary import command_entries as command_entries
from adapters.console.rovers.dictionary import parameter_entries as parameter_entries
from adapters.console.rovers.dictionary import zone_entries as zone_entries
from adapters.console.rovers.fleet import NS_PER_S as NS_PER_S
from adapters.console.rovers.fleet import ConnectedAsset as ConnectedAsset
from adapters.console.rovers.fleet import Fleet as Fleet
from adapters.console.rovers.fleet import figures_of as figures_of
from adapters.console.rovers.fleet import notification_message as notification_message
from adapters.console.rovers.fleet import plan_progress as plan_progress
from adapters.console.rovers.fleet import tree_of as tree_of
from adapters.console.rovers.operator_authority import OperatorAuthority as OperatorAuthority
from adapters.console.rovers.rover_link import LINK_HOUSEKEEPING as LINK_HOUSEKEEPING
from adapters.console.rovers.rover_link import LastNotification as LastNotification
from adapters.console.rovers.rover_link import RoverLink as RoverLink
from adapters.console.rovers.tracker import REPORT_TIMEOUT_S as REPORT_TIMEOUT_S
from adapters.console.rovers.tracker import CommandTracker as CommandTracker
from adapters.console.rovers.tracker import SharedCommands as SharedCommands
from adapters.console.rovers.tracker import foreign_status as foreign_status
from adapters.console.rovers.tracker import sent_status as sent_status
