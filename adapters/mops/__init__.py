"""MOPS, the string messages of the relay link and of MOCUP's brick (thesis 6.1.1)."""
