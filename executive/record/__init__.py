"""Everything durable: the ledger, its retention, recovery after a restart, and plans."""

from executive.record.authority_record import AuthorityRecord, Grant
from executive.record.database import (
    Connect,
    Database,
    LedgerError,
    Synchronous,
    connect_to_file,
)
from executive.record.ledger import PRUNED, LatchedFault, Ledger, digest
from executive.record.notifications import Notifications
from executive.record.plan_store import Outcome, PlanStore
from executive.record.pose_record import PoseRecord
from executive.record.relay_record import RelayedCommand, RelayRecord
from executive.record.retention import Retention
from executive.record.stop_latch import UNWRITTEN_LEDGER, StopLatch

__all__ = [
    "PRUNED",
    "UNWRITTEN_LEDGER",
    "AuthorityRecord",
    "Connect",
    "Database",
    "Grant",
    "LatchedFault",
    "Ledger",
    "LedgerError",
    "Notifications",
    "Outcome",
    "PlanStore",
    "PoseRecord",
    "RelayRecord",
    "RelayedCommand",
    "Retention",
    "StopLatch",
    "Synchronous",
    "connect_to_file",
    "digest",
]
