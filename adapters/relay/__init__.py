"""The relay link: `rover-mops` at the orbiter, `rover-relay` and the executive's end aboard.

    ground         orbiter: rover-mops                   rover: rover-relay          rover-executive
    MOE ── MAL ──> provider ─> relay ─> bundle agent ==> bundle agent ─> bridge ──── executive_link
        <───────── record (SQLite) <──  bundles.sqlite   relay.sqlite       ROS topics       ledger

Commands go up and reports come down as MOPS strings in bundles (thesis 6.3), between processes at
least once; the ledger of the executive recognises a repeat. docs/relay-reference.md lists what is
promised.
"""
