"""The commands of this room that `rover` finds by entry points."""

from adapters.mrs.cli.command_group import command
from adapters.mrs.cli.files_command import files
from adapters.mrs.cli.plan_command import plan
from adapters.mrs.cli.services_command import services
from adapters.mrs.cli.status_command import status

__all__ = ["command", "files", "plan", "services", "status"]
