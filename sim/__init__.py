"""Simulated rovers in simulated worlds, with their display and measurement."""
