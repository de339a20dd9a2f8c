"""The commands of this room that `rover` finds by entry points."""

from adapters.mrs.command_group import command
from adapters.mrs.files_command import files
from adapters.mrs.plan_command import plan
from adapters.mrs.services_command import services
from adapters.mrs.status_command import status

__all__ = ["command", "files", "plan", "services", "status"]
