"""The archive of the console: telemetry, commands, notifications and the operators' objects.

    put(message) ─> waiting ── one thread, a batch each half second ──> SQLite (WAL) or PostgreSQL
    queries, objects <──────── another thread reads ───────────────────+

Several consoles may write to one PostgreSQL. A writer has it alone until its transaction is over
(`begin_writing`), so that each act can look before it writes, and revisions count up in the order
in which other consoles see them; these look for new revisions each second. What two consoles
receive is stored once: a sample by its parameter and time aboard, a notification by its number, a
command by source and number, with the stages that either received
(`adapters.console.command_life`).
"""

from adapters.console.archive.alarms import (
    Change,
    Cleared,
    Raised,
    acknowledge_alarms,
    change_alarms,
    read_alarms,
    standing_alarms,
)
from adapters.console.archive.archive import LOOK_S, Archive, Written, to_us
from adapters.console.archive.database import ArchiveError, cause_of, open_database
from adapters.console.archive.exports import (
    Exported,
    ExportRow,
    Kept,
    Place,
    export_page,
    kept_page,
)
from adapters.console.archive.objects import (
    Conflict,
    Stored,
    delete_object,
    get_object,
    list_objects,
    put_object,
)
from adapters.console.archive.plans import PlanRevision, get_plan, keep_plan, list_plans
from adapters.console.archive.presence import (
    ConsolePages,
    forget_pages,
    read_pages,
    write_pages,
)
from adapters.console.archive.queries import (
    MOST_SAMPLES,
    Page,
    Parameter,
    Strategy,
    Wanted,
    changed_commands,
    find_command,
    find_parameters,
    last_commands,
    last_notification,
    last_revision,
    read_command,
    read_commands,
    read_last_sample,
    read_notifications,
    read_records,
    read_samples,
)
from adapters.console.archive.retention import Retention, delete_old, retain
from adapters.console.archive.tables import METADATA, SAMPLE_MINUTE

__all__ = [
    "LOOK_S",
    "METADATA",
    "MOST_SAMPLES",
    "SAMPLE_MINUTE",
    "Archive",
    "ArchiveError",
    "Change",
    "Cleared",
    "Conflict",
    "ConsolePages",
    "ExportRow",
    "Exported",
    "Kept",
    "Page",
    "Parameter",
    "Place",
    "PlanRevision",
    "Raised",
    "Retention",
    "Stored",
    "Strategy",
    "Wanted",
    "Written",
    "acknowledge_alarms",
    "cause_of",
    "change_alarms",
    "changed_commands",
    "delete_object",
    "delete_old",
    "export_page",
    "find_command",
    "find_parameters",
    "forget_pages",
    "get_object",
    "get_plan",
    "keep_plan",
    "kept_page",
    "last_commands",
    "last_notification",
    "last_revision",
    "list_objects",
    "list_plans",
    "open_database",
    "put_object",
    "read_alarms",
    "read_command",
    "read_commands",
    "read_last_sample",
    "read_notifications",
    "read_pages",
    "read_records",
    "read_samples",
    "retain",
    "standing_alarms",
    "to_us",
    "write_pages",
]
