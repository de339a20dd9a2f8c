"""Calibration of a rover, simulated or by its recordings."""
