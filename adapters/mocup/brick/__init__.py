"""MOCUP's brick: MOPS strings over USB, routed between the links (thesis 6.2)."""
