"""Sessions with rovers: what is heard as messages, what is commanded as requests."""

from adapters.console.rovers.authority_desk import Act, Asked, AuthorityDesk
from adapters.console.rovers.dictionary import (
    FORMS,
    AssetEntry,
    RecordingEntry,
    command_entries,
    parameter_entries,
    zone_entries,
)
from adapters.console.rovers.fleet import NS_PER_S, Asset, Fleet, figures_of, notified, tree_of
from adapters.console.rovers.posted import BadArgument, args_of, request_of
from adapters.console.rovers.rover_link import Known, RoverLink
from adapters.console.rovers.shared_commands import SharedCommands
from adapters.console.rovers.tracker import HEARD_WITHIN_S, CommandTracker

__all__ = [
    "FORMS",
    "HEARD_WITHIN_S",
    "NS_PER_S",
    "Act",
    "Asked",
    "Asset",
    "AssetEntry",
    "AuthorityDesk",
    "BadArgument",
    "CommandTracker",
    "Fleet",
    "Known",
    "RecordingEntry",
    "RoverLink",
    "SharedCommands",
    "args_of",
    "command_entries",
    "figures_of",
    "notified",
    "parameter_entries",
    "request_of",
    "tree_of",
    "zone_entries",
]
