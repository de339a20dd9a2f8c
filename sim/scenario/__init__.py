"""Acceptance scenarios: files with the inputs to a rover and the expected results."""
