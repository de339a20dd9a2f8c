"""Relay link: `rover-mops` at the orbiter, `rover-relay` and the executive's end on the rover.

    ground         orbiter: rover-mops                   rover: rover-relay          rover-executive
    MOE ── MAL ──> provider ─> relay ─> bundle agent ==> bundle agent ─> bridge ──── executive_link
        <───────── record (SQLite) <──  bundles.sqlite   relay.sqlite       ROS topics       ledger

Commands are uplinked and reports downlinked as MOPS strings in bundles (thesis 6.3), at least once
between processes; the ledger of the executive recognises a repeat. docs/relay-reference.md lists
the guarantees.
"""
