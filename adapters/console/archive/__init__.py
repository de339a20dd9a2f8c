"""The archive of the console: telemetry, commands, notifications and the operators' objects.

    put(message) ─> queue ──── one thread, a batch each half second ──> SQLite (WAL) or PostgreSQL
    queries, objects <──────── another thread reads ───────────────────+

Several consoles may write to one PostgreSQL. Write transactions are exclusive (`begin_writing`), so
a transaction can read before it writes, and revisions increase in the order in which other consoles
see them. Consoles poll for new revisions every second. Data that two consoles receive is stored
once: a sample by its parameter and time aboard, a notification by its number. A command is merged
by source and number, with the stages that either received
(`adapters.console.command_states`).
"""

from adapters.console.archive.alarms import AlarmCleared as AlarmCleared
from adapters.console.archive.alarms import AlarmCommand as AlarmCommand
from adapters.console.archive.alarms import AlarmRaised as AlarmRaised
from adapters.console.archive.alarms import Change as Change
from adapters.console.archive.alarms import acknowledge_alarms as acknowledge_alarms
from adapters.console.archive.alarms import change_alarms as change_alarms
from adapters.console.archive.alarms import open_alarms as open_alarms
from adapters.console.archive.alarms import read_alarms as read_alarms
from adapters.console.archive.alarms import shelve_alarm as shelve_alarm
from adapters.console.archive.archive import POLL_S as POLL_S
from adapters.console.archive.archive import Archive as Archive
from adapters.console.archive.archive import Written as Written
from adapters.console.archive.archive import to_us as to_us
from adapters.console.archive.database import ArchiveError as ArchiveError
from adapters.console.archive.database import cause_of as cause_of
from adapters.console.archive.database import open_database as open_database
from adapters.console.archive.exports import ExportCursor as ExportCursor
from adapters.console.archive.exports import Exported as Exported
from adapters.console.archive.exports import ExportRecord as ExportRecord
from adapters.console.archive.exports import ExportRow as ExportRow
from adapters.console.archive.exports import export_page as export_page
from adapters.console.archive.exports import record_page as record_page
from adapters.console.archive.objects import PlanRevision as PlanRevision
from adapters.console.archive.objects import RevisionConflict as RevisionConflict
from adapters.console.archive.objects import StoredObject as StoredObject
from adapters.console.archive.objects import add_plan_revision as add_plan_revision
from adapters.console.archive.objects import delete_object as delete_object
from adapters.console.archive.objects import get_object as get_object
from adapters.console.archive.objects import get_plan as get_plan
from adapters.console.archive.objects import list_objects as list_objects
from adapters.console.archive.objects import list_plans as list_plans
from adapters.console.archive.objects import put_object as put_object
from adapters.console.archive.queries import MAX_SAMPLES as MAX_SAMPLES
from adapters.console.archive.queries import ArchivedParameter as ArchivedParameter
from adapters.console.archive.queries import ConsolePages as ConsolePages
from adapters.console.archive.queries import SampleQuery as SampleQuery
from adapters.console.archive.queries import Strategy as Strategy
from adapters.console.archive.queries import TablePage as TablePage
from adapters.console.archive.queries import changed_commands as changed_commands
from adapters.console.archive.queries import find_command as find_command
from adapters.console.archive.queries import find_parameters as find_parameters
from adapters.console.archive.queries import forget_pages as forget_pages
from adapters.console.archive.queries import last_commands as last_commands
from adapters.console.archive.queries import last_notification as last_notification
from adapters.console.archive.queries import last_revision as last_revision
from adapters.console.archive.queries import read_command as read_command
from adapters.console.archive.queries import read_commands as read_commands
from adapters.console.archive.queries import read_last_sample as read_last_sample
from adapters.console.archive.queries import read_notifications as read_notifications
from adapters.console.archive.queries import read_pages as read_pages
from adapters.console.archive.queries import read_records as read_records
from adapters.console.archive.queries import read_samples as read_samples
from adapters.console.archive.queries import write_pages as write_pages
from adapters.console.archive.retention import RetentionPolicy as RetentionPolicy
from adapters.console.archive.retention import delete_old as delete_old
from adapters.console.archive.retention import run_retention as run_retention
from adapters.console.archive.tables import METADATA as METADATA
