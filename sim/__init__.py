"""Simulated rovers in simulated worlds, and what is shown and measured with them."""
