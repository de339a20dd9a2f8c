"""Obstacles of a motion, zones and scanned ones, and the detours around them."""
