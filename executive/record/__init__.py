"""Everything durable: the ledger, its retention, recovery after a restart, and plans."""
