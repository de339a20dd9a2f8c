"""Acceptance scenarios: files that say what is done to a rover, and what must come of it."""
