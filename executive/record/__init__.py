"""Durable records, in SQLite: commands and reports (the ledger), plans, pose, authority, relay."""

from executive.record.database import Connect as Connect
from executive.record.database import Database as Database
from executive.record.database import LedgerError as LedgerError
from executive.record.database import Synchronous as Synchronous
from executive.record.database import connect_to_file as connect_to_file
from executive.record.ledger import PRUNED as PRUNED
from executive.record.ledger import LatchedFault as LatchedFault
from executive.record.ledger import Ledger as Ledger
from executive.record.ledger import digest as digest
from executive.record.notifications import Notifications as Notifications
from executive.record.plan_store import PlanStore as PlanStore
from executive.record.plan_store import StepOutcome as StepOutcome
from executive.record.plan_store import StoredState as StoredState
from executive.record.relay_record import RelayedCommand as RelayedCommand
from executive.record.relay_record import RelayRecord as RelayRecord
from executive.record.retention import LedgerRetention as LedgerRetention
from executive.record.stop_latch import UNWRITTEN_LEDGER as UNWRITTEN_LEDGER
from executive.record.stop_latch import StopLatch as StopLatch
from executive.record.writer import WriterState as WriterState
