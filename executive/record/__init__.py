"""Everything durable: the ledger, its retention, recovery after a restart, and plans."""

from executive.record.ledger import PRUNED, Ledger, LedgerError, Synchronous, digest
from executive.record.plan_store import Outcome, PlanStore
from executive.record.relay_record import RelayedCommand, RelayRecord
from executive.record.retention import Retention

__all__ = [
    "PRUNED",
    "Ledger",
    "LedgerError",
    "Outcome",
    "PlanStore",
    "RelayRecord",
    "RelayedCommand",
    "Retention",
    "Synchronous",
    "digest",
]
