"""What the console keeps: telemetry, commands, notifications and what operators make."""

from adapters.console.archive.archive import Archive, Written, to_us
from adapters.console.archive.database import ArchiveError, open_database
from adapters.console.archive.objects import (
    Conflict,
    Stored,
    delete_object,
    get_object,
    list_objects,
    put_object,
)
from adapters.console.archive.plans import PlanRevision, get_plan, keep_plan, list_plans
from adapters.console.archive.queries import (
    MOST_SAMPLES,
    ExportRow,
    Page,
    Parameter,
    Strategy,
    Wanted,
    export_page,
    find_parameters,
    last_commands,
    last_notification,
    read_command,
    read_commands,
    read_last_sample,
    read_notifications,
    read_records,
    read_samples,
)
from adapters.console.archive.retention import Retention, delete_old, retain
from adapters.console.archive.tables import METADATA

__all__ = [
    "METADATA",
    "MOST_SAMPLES",
    "Archive",
    "ArchiveError",
    "Conflict",
    "ExportRow",
    "Page",
    "Parameter",
    "PlanRevision",
    "Retention",
    "Stored",
    "Strategy",
    "Wanted",
    "Written",
    "delete_object",
    "delete_old",
    "export_page",
    "find_parameters",
    "get_object",
    "get_plan",
    "keep_plan",
    "last_commands",
    "last_notification",
    "list_objects",
    "list_plans",
    "open_database",
    "put_object",
    "read_command",
    "read_commands",
    "read_last_sample",
    "read_notifications",
    "read_records",
    "read_samples",
    "retain",
    "to_us",
]
