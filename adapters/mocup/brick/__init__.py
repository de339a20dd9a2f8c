"""The process `rover-nxt`: MOPS strings between its links and MOCUP's brick on USB (thesis 6.2)."""
