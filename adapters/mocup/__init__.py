"""MOCUP: whole motions of the executive as MOPS commands, replies as facts (thesis 6.1)."""
